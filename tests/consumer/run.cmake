# Configures, builds and runs the consumer. Arguments: SOURCE, BUILD (pgl's build tree), WORK, FROM, GENERATOR, COMPILER;
# CUDA_COMPILER where the consumer wants pgl::cuda too. FROM: a way to get pgl, or host_only, a pgl without pgl::cuda.
function(must)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(result)
    message(FATAL_ERROR "${ARGN}\n${output}")
  endif()
endfunction()

# The command fails and says `why`.
function(must_not why)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output)
  string(REGEX REPLACE "[ \n]+" " " output "${output}")
  string(FIND "${output}" "${why}" at)
  if(NOT result OR at EQUAL -1)
    message(FATAL_ERROR "${ARGN}\nshould have failed with: ${why}\n${output}")
  endif()
endfunction()

set(no_toolkit -D CMAKE_DISABLE_FIND_PACKAGE_CUDAToolkit=ON)
file(REMOVE_RECURSE ${WORK})
set(how -D PGL_FROM=${FROM} -D PGL_SOURCE_DIR=${SOURCE})
if(FROM STREQUAL "find_package")
  must(${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/prefix)
  list(APPEND how -D CMAKE_PREFIX_PATH=${WORK}/prefix)
elseif(FROM STREQUAL "host_only")
  # As on a machine without a toolkit.
  must(${CMAKE_COMMAND} -S ${SOURCE} -B ${WORK}/pgl -G ${GENERATOR} -D CMAKE_CXX_COMPILER=${COMPILER} ${no_toolkit}
    -D PGL_BUILD_TESTS=OFF -D PGL_BUILD_BENCH=OFF -D PGL_BUILD_EXAMPLES=OFF -D PGL_BUILD_APP=OFF)
  must(${CMAKE_COMMAND} --install ${WORK}/pgl --prefix ${WORK}/prefix)
  set(how -D PGL_FROM=find_package -D CMAKE_PREFIX_PATH=${WORK}/prefix)
elseif(FROM STREQUAL "FetchContent")
  # A clean copy, as a download would be: FetchContent copies the whole folder.
  file(COPY ${SOURCE}/CMakeLists.txt ${SOURCE}/cmake ${SOURCE}/include ${SOURCE}/LICENSE DESTINATION ${WORK}/download/pgl)
  must(${CMAKE_COMMAND} -E chdir ${WORK}/download ${CMAKE_COMMAND} -E tar czf pgl.tar.gz pgl)
  set(how -D PGL_FROM=${FROM} -D PGL_SOURCE_DIR=${WORK}/download/pgl.tar.gz)
endif()
set(configure ${CMAKE_COMMAND} -S ${SOURCE}/tests/consumer -G ${GENERATOR} -D CMAKE_CXX_COMPILER=${COMPILER} ${how})

if(CUDA_COMPILER)
  must(${configure} -B ${WORK}/build -D PGL_WITH_CUDA=ON -D CMAKE_CUDA_COMPILER=${CUDA_COMPILER})
else()
  must(${configure} -B ${WORK}/build ${no_toolkit})  # what was installed with a toolkit needs none either
endif()
must(${CMAKE_COMMAND} --build ${WORK}/build)
must(${WORK}/build/consumer)
must(${WORK}/build/rules_only)
if(CUDA_COMPILER)
  execute_process(COMMAND ${WORK}/build/consumer_cuda COMMAND_ERROR_IS_FATAL ANY)  # shows whether there was a GPU
endif()

# Who asks for the GPU drivers where they are not is told so, unless they may be left out.
set(ask ${CMAKE_COMMAND} -S ${SOURCE}/tests/consumer/ask -G ${GENERATOR} -D CMAKE_CXX_COMPILER=${COMPILER} ${how})
if(FROM STREQUAL "host_only")
  must_not("installed without component cuda" ${ask} -B ${WORK}/ask -D PGL_ASK=COMPONENTS)
  must(${ask} -B ${WORK}/ask_optional -D PGL_ASK=OPTIONAL_COMPONENTS)
elseif(FROM STREQUAL "find_package" AND CUDA_COMPILER)
  must_not("component cuda needs the CUDA toolkit" ${ask} -B ${WORK}/ask -D PGL_ASK=COMPONENTS ${no_toolkit})
  must(${ask} -B ${WORK}/ask_optional -D PGL_ASK=OPTIONAL_COMPONENTS ${no_toolkit})
endif()
