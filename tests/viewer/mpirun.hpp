// SPDX-License-Identifier: MIT
// How the tests start several ranks, here and in continuous integration.
#pragma once

#include <string>

namespace viewer_tests {

/// What comes before the program on the command line: as root too, with more ranks than cores, none of them bound to
/// one.
inline std::string mpirun(int ranks) {
  return "env OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1 "
         "OMPI_MCA_hwloc_base_binding_policy=none timeout -k 5 60 mpirun -n " +
         std::to_string(ranks);
}

}  // namespace viewer_tests
