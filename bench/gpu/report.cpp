// SPDX-License-Identifier: MIT
#include "report.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <stdexcept>

namespace pgl::bench {
namespace {

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (static_cast<unsigned char>(c) < 0x20) {
      char code[8];
      std::snprintf(code, sizeof code, "\\u%04x", static_cast<unsigned>(c));
      out += code;
    } else {
      out += c;
    }
  }
  return out + '"';
}

/// JSON knows neither NaN nor infinities.
std::string number(double value) {
  if (!std::isfinite(value)) return "null";
  char text[40];
  const bool whole = std::fabs(value) < 1e15 && value == std::floor(value);
  std::snprintf(text, sizeof text, whole ? "%.0f" : "%.6g", value);
  return text;
}

class Fields {
 public:
  void add(const char* name, std::string value) {
    if (!text_.empty()) text_ += ", ";
    text_ += quoted(name) + ": " + std::move(value);
  }
  void add(const char* name, const std::optional<double>& value) {
    if (value) add(name, number(*value));
  }
  std::string object() const { return "{" + text_ + "}"; }

 private:
  std::string text_;
};

/// Right-aligned; a dash for what is not there.
std::string cell(const std::optional<double>& value, int width, int decimals, double scale = 1.0) {
  char text[40];
  if (!value) {
    std::snprintf(text, sizeof text, "%*s", width, "-");
  } else {
    std::snprintf(text, sizeof text, "%*.*f", width, decimals, *value * scale);
  }
  return text;
}

}  // namespace

std::optional<double> gb_per_s(const Row& row) {
  if (!row.ms || row.bytes == 0 || *row.ms <= 0) return std::nullopt;
  return static_cast<double>(row.bytes) / *row.ms * 1e-6;
}

std::optional<double> fraction_of_copy(const Row& row, const Report& report) {
  const auto rate = gb_per_s(row);
  if (!rate || !report.copy_gb_per_s) return std::nullopt;
  return *rate / *report.copy_gb_per_s;
}

std::string to_json(const Report& report) {
  std::string out = "{\n  \"schema\": 1,\n";
  for (const auto& [key, value] : report.context) out += "  " + quoted(key) + ": " + quoted(value) + ",\n";
  if (report.copy_gb_per_s) out += "  \"copy_gb_per_s\": " + number(*report.copy_gb_per_s) + ",\n";
  for (const auto& [key, value] : report.figures) out += "  " + quoted(key) + ": " + number(value) + ",\n";
  out += "  \"rows\": [";
  for (std::size_t i = 0; i < report.rows.size(); ++i) {
    const Row& row = report.rows[i];
    Fields fields;
    fields.add("name", quoted(row.name));
    fields.add("ms", row.ms);
    fields.add("stream_ms", row.stream_ms);
    fields.add("warm_ms", row.warm_ms);
    if (row.bytes > 0) fields.add("bytes", std::to_string(row.bytes));
    fields.add("gb_per_s", gb_per_s(row));
    fields.add("fraction_of_copy", fraction_of_copy(row, report));
    fields.add("host_1_ms", row.host_1_ms);
    fields.add("host_all_ms", row.host_all_ms);
    if (row.equal) fields.add("equal", *row.equal ? "true" : "false");
    fields.add("target_ms", row.target_ms);
    if (!row.note.empty()) fields.add("note", quoted(row.note));
    out += (i == 0 ? "\n    " : ",\n    ") + fields.object();
  }
  return out + "\n  ]\n}\n";
}

std::string to_table(const Report& report) {
  std::string out;
  for (const auto& [key, value] : report.context) out += key + ": " + value + "\n";
  for (const auto& [key, value] : report.figures) out += key + ": " + number(value) + "\n";
  if (report.copy_gb_per_s) out += "copy_gb_per_s: " + number(*report.copy_gb_per_s) + "\n";
  std::size_t width = 4;
  for (const Row& row : report.rows) width = std::max(width, row.name.size());
  const auto padded = [&](const std::string& text) { return text + std::string(width - text.size(), ' '); };
  out += '\n';
  out += padded("name");
  out += "         ms     stream       warm         MB   of copy     host 1   host all  equal  target\n";
  for (const Row& row : report.rows) {
    out += padded(row.name) + cell(row.ms, 11, 4) + cell(row.stream_ms, 11, 4) + cell(row.warm_ms, 11, 4);
    out += row.bytes == 0 ? cell({}, 11, 1) : cell(static_cast<double>(row.bytes), 11, 1, 1e-6);
    out += cell(fraction_of_copy(row, report), 10, 3) + cell(row.host_1_ms, 11, 2) + cell(row.host_all_ms, 11, 2);
    out += !row.equal ? "      -" : *row.equal ? "    yes" : "     NO";
    if (row.target_ms) {
      out += cell(row.target_ms, 8, 2);
      if (row.ms) out += *row.ms <= *row.target_ms ? " met" : " MISSED";
    }
    out += "\n";
    if (!row.note.empty()) out += "    " + row.note + "\n";
  }
  return out;
}

void write_file(const std::string& path, const std::string& content) {
  const std::string draft = path + ".part";
  std::ofstream file(draft, std::ios::binary | std::ios::trunc);
  file << content;
  file.close();
  if (!file || std::rename(draft.c_str(), path.c_str()) != 0) throw std::runtime_error("cannot write " + path);
}

}  // namespace pgl::bench
