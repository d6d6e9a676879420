# The package: find_package(pgl) gives pgl::pgl (rules) and pgl::host (CPU drivers), which need no CUDA toolkit, and with
# COMPONENTS cuda also pgl::cuda (GPU drivers), which is in a set of its own. The headers are always all there.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

install(TARGETS pgl pgl_host EXPORT pglTargets)
install(DIRECTORY include/pgl DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} PATTERN "README.md" EXCLUDE)
install(EXPORT pglTargets NAMESPACE pgl:: DESTINATION ${CMAKE_INSTALL_DATADIR}/cmake/pgl)
set(pgl_has_cuda FALSE)
if(TARGET pgl_cuda)
  set(pgl_has_cuda TRUE)
  install(TARGETS pgl_cuda EXPORT pglCudaTargets)
  install(EXPORT pglCudaTargets NAMESPACE pgl:: DESTINATION ${CMAKE_INSTALL_DATADIR}/cmake/pgl)
endif()

configure_package_config_file(cmake/pglConfig.cmake.in ${CMAKE_CURRENT_BINARY_DIR}/pglConfig.cmake
  INSTALL_DESTINATION ${CMAKE_INSTALL_DATADIR}/cmake/pgl)
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/pglConfigVersion.cmake
  COMPATIBILITY SameMinorVersion ARCH_INDEPENDENT)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/pglConfig.cmake ${CMAKE_CURRENT_BINARY_DIR}/pglConfigVersion.cmake
  DESTINATION ${CMAKE_INSTALL_DATADIR}/cmake/pgl)
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
