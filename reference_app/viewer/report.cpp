// SPDX-License-Identifier: MIT
// What a run measured.
#include "viewer/report.hpp"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "scene/tell.hpp"
#include "scene/version.hpp"

namespace pgl::viewer {

using scene::grouped;

std::string to_json(const Report& report) {
  using Json = nlohmann::ordered_json;
  auto vector = [](const glm::dvec3& v) { return Json::array({v.x, v.y, v.z}); };
  Json ms = Json::object();
  for (const auto& [step, time] : report.ms) ms[step] = time;
  Json mean_ms = Json::object();
  for (const auto& [step, time] : report.mean_ms) mean_ms[step] = time;
  const auto hex = [](std::uint64_t number) {
    char text[17];
    std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(number));
    return std::string(text);
  };
  Json checksums = Json::array();
  for (const std::uint64_t checksum : report.checksums) checksums.push_back(hex(checksum));
  Json sent = Json::array();
  for (const Sent& frame : report.sent) {
    sent.push_back({{"vertices", frame.vertices},
                    {"triangles", frame.triangles},
                    {"bytes", frame.bytes},
                    {"missing_bytes", frame.missing_bytes}});
  }
  Json json = {{"pgl", scene::version()},
               {"objects", report.objects},
               {"model",
                {{"vertices", report.model_vertices},
                 {"triangles", report.model_triangles},
                 {"meshes", report.meshes},
                 {"open_vertices", report.open_vertices}}},
               {"budget", report.budget},
               {"drawn",
                {{"objects", report.drawn_objects},
                 {"vertices", report.drawn_vertices},
                 {"triangles", report.drawn_triangles},
                 {"checksum", hex(report.drawn_checksum)}}},
               {"checksums", checksums},
               {"culled", {{"frustum", report.culled_frustum}, {"occlusion", report.culled_occlusion}}},
               {"occluders", report.occluders},
               {"stream",
                {{"streams", report.memory.streams},
                 {"sent", sent},
                 {"memory",
                  {{"resident", report.memory.resident},
                   {"blocks", report.memory.blocks},
                   {"drawn", report.memory.drawn},
                   {"vertices", report.memory.vertices},
                   {"triangles", report.memory.triangles}}}}},
               {"file", {{"bytes", report.file_bytes}, {"bytes_read", report.file_bytes_read}}},
               {"ms", ms},
               {"mean_ms", mean_ms},
               {"frame_ms", report.frame_ms},
               {"load_ms", report.load_ms},
               {"frames", report.frames},
               {"threads", report.threads},
               {"size", {report.width, report.height}},
               {"camera",
                {{"eye", vector(report.camera.eye)},
                 {"target", vector(report.camera.target)},
                 {"up", vector(report.camera.up)},
                 {"fov", report.camera.fov_degrees}}},
               {"backend", {{"name", report.backend}, {"gpu", report.gpu}, {"interop", report.interop}}},
               {"gl",
                {{"vendor", report.gl_vendor},
                 {"renderer", report.gl_renderer},
                 {"version", report.gl_version},
                 {"samples", report.samples}}}};
  if (report.threshold > 0.0f) json["threshold"] = report.threshold;
  if (!report.pictures.empty()) {
    const Tile& tile = report.tile;
    json["rank"] = report.rank;
    json["tile"] = {tile.x0, tile.y0, tile.x1, tile.y1};
    json["weight"] = report.weight;
    json["pictures"] = report.pictures;
    json["imbalance"] = {{"mean", report.imbalance}, {"worst", report.worst_imbalance}};
  }
  if (!report.ranks.empty()) {
    json["ranks"] = Json::array();
    for (const std::string& rank : report.ranks) json["ranks"].push_back(Json::parse(rank));
  }
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string to_table(const Report& report) {
  std::string table;
  auto line = [&](const std::string& name, const std::string& value) {
    char row[96];
    std::snprintf(row, sizeof row, "%-24s %14s\n", name.c_str(), value.c_str());
    table += row;
  };
  line("objects", grouped(report.objects));
  line("triangles in the model", grouped(report.model_triangles));
  line("vertices in the model", grouped(report.model_vertices));
  line("budget, vertices", grouped(report.budget));
  const std::string here = report.ranks.empty() ? "" : ", rank 0";
  line("vertices drawn" + here, grouped(report.drawn_vertices));
  line("triangles drawn" + here, grouped(report.drawn_triangles));
  line("objects drawn", grouped(report.drawn_objects));
  line("culled, frustum", grouped(report.culled_frustum));
  line("culled, occlusion", grouped(report.culled_occlusion));
  line("occluders", grouped(report.occluders));
  line("backend", report.backend);
  if (!report.pictures.empty()) {
    line("ranks", grouped(report.ranks.size()));
    line("pictures come by", report.pictures);
    char percent[16];
    std::snprintf(percent, sizeof percent, "%.1f", 100.0 * report.imbalance);
    line("imbalance, %", percent);
  }
  if (report.memory.streams && !report.sent.empty()) {
    Sent all, most;
    for (const Sent& frame : report.sent) {
      all.bytes += frame.bytes;
      most.bytes = std::max(most.bytes, frame.bytes);
    }
    line("streamed, KiB a frame", grouped(all.bytes / report.sent.size() / 1024));
    line("most of a frame, KiB", grouped(most.bytes / 1024));
    line("still missing, KiB", grouped(report.sent.back().missing_bytes / 1024));
    line("memory planned, MiB", grouped((report.memory.resident + report.memory.blocks + report.memory.drawn) >> 20));
  }
  if (report.file_bytes > 0) {
    line("model file, MiB", grouped(report.file_bytes >> 20));
    line("read of it, MiB", grouped(report.file_bytes_read >> 20));
  }
  for (const auto& [step, time] : report.ms) {
    char value[32];
    std::snprintf(value, sizeof value, "%.2f", time);
    line("ms " + step, value);
  }
  return table;
}

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace pgl::viewer
