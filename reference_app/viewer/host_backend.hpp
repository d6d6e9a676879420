// SPDX-License-Identifier: MIT
// The CPU as a backend of the frame.
#pragma once

#include <utility>
#include <vector>

#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/gather.hpp"
#include "pgl/host/project.hpp"
#include "pgl/host/reform.hpp"

namespace pgl::viewer {

/// What Frame needs of a backend: arrays that only grow, workspaces, the steps under the names of pgl::host, and
/// finish(), after which the results are there.
struct HostBackend {
  template <class T>
  using Array = std::vector<T>;
  using BudgetWorkspace = host::BudgetWorkspace;
  template <class Index>
  using ReformWorkspace = host::ReformWorkspace<Index>;

  static void vertex_limits(auto&&... arguments) { host::vertex_limits(arguments...); }
  static void cull_frustum(auto&&... arguments) { host::cull_frustum(arguments...); }
  static void project(auto&&... arguments) { host::project(arguments...); }
  static auto distribute_budget(auto&&... arguments) { return host::distribute_budget(arguments...); }
  static void lay_out(auto&&... arguments) { host::lay_out(arguments...); }
  static void reform(auto&&... arguments) { host::reform(arguments...); }
  static void gather(auto&&... arguments) { host::gather(arguments...); }
  static void finish() {}
};

}  // namespace pgl::viewer
