// SPDX-License-Identifier: MIT
// What the GPU benchmarks found: one row per measurement, as JSON and as a table.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace pgl::bench {

/// One measurement. Milliseconds are medians; what was not measured is left out.
struct Row {
  std::string name{};
  std::optional<double> ms{};           ///< device: as a graph where it is one, caches filled with other data before
  std::optional<double> stream_ms{};    ///< device: the same calls put on a stream one by one
  std::optional<double> warm_ms{};      ///< device: the graph again and again, data left in the caches
  std::uint64_t bytes = 0;              ///< the least: each input read once, each output written once
  std::optional<double> host_1_ms{};    ///< the same call of pgl::host on one core
  std::optional<double> host_all_ms{};  ///< and on all cores
  std::optional<bool> equal{};          ///< device and host gave the same bytes
  std::optional<double> target_ms{};
  std::string note{};
};

/// Everything of one run. Context holds strings (GPU, driver, commit, ...), figures holds numbers.
struct Report {
  std::vector<std::pair<std::string, std::string>> context;
  std::vector<std::pair<std::string, double>> figures;
  std::optional<double> copy_gb_per_s{};  ///< bytes read and bytes written by a large copy on the device
  std::vector<Row> rows;
};

/// Gigabytes (1e9) per second, and their part of the copy bandwidth, where both are known.
std::optional<double> gb_per_s(const Row& row);
std::optional<double> fraction_of_copy(const Row& row, const Report& report);

std::string to_json(const Report& report);
std::string to_table(const Report& report);

/// Writes a file as a whole or not at all. Throws std::runtime_error.
void write_file(const std::string& path, const std::string& content);

}  // namespace pgl::bench
