// SPDX-License-Identifier: MIT
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "pgl/config.hpp"
#include "pgl/host/bounds.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/select_occluders.hpp"
#include "scene/model_file.hpp"
#include "scene/model_format.hpp"

namespace pgl::scene {
namespace {

using format::page_bytes;

constexpr std::size_t chunk_bytes = std::size_t{8} << 20;
constexpr std::uint64_t mebibyte = 1 << 20;

[[noreturn]] void fail_to_write(const std::filesystem::path& file) {
  throw Error(file, std::string("cannot be written: ") + std::strerror(errno));
}

/// A file of ours in the folder of the model file, gone when this is, unless it is given a name that stays.
class TemporaryFile {
 public:
  /// Unnamed, if the system lets it be so; else with a name for as long as `keep_name` says, or until it is open.
  TemporaryFile(const std::filesystem::path& model, TemporaryFiles kind, bool keep_name) : model_(model) {
    std::filesystem::path folder = model.parent_path();
    if (folder.empty()) folder = ".";
#if defined(O_TMPFILE)
    // A file without a name gets one by way of /proc.
    if (kind == TemporaryFiles::unnamed && (!keep_name || access("/proc/self/fd", X_OK) == 0))
      descriptor_ = open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0666);
    if (descriptor_ >= 0) return;
#endif
    name_ = free_name([&](const std::filesystem::path& name) {
      descriptor_ = open(name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0666);
      return descriptor_ >= 0;
    });
    if (!keep_name) remove_name();
  }
  TemporaryFile(TemporaryFile&& other) noexcept
      : model_(std::move(other.model_)),
        name_(std::exchange(other.name_, {})),
        descriptor_(std::exchange(other.descriptor_, -1)) {}
  ~TemporaryFile() {
    remove_name();
    if (descriptor_ >= 0) close(descriptor_);
  }

  [[nodiscard]] int descriptor() const {
    return descriptor_;
  }

  /// Makes this file what `model` names, at one moment, whether there is a file already or not.
  void take_place() {
    if (name_.empty()) {
      const std::string self = "/proc/self/fd/" + std::to_string(descriptor_);
      if (linkat(AT_FDCWD, self.c_str(), AT_FDCWD, model_.c_str(), AT_SYMLINK_FOLLOW) == 0) return;
      if (errno != EEXIST) fail_to_write(model_);
      name_ = free_name([&](const std::filesystem::path& name) {
        return linkat(AT_FDCWD, self.c_str(), AT_FDCWD, name.c_str(), AT_SYMLINK_FOLLOW) == 0;
      });
    }
    if (rename(name_.c_str(), model_.c_str()) != 0) fail_to_write(model_);
    name_.clear();
  }

 private:
  /// Tries names beside the model until `take` takes one, or fails for another reason than that it is taken.
  template <class Take>
  std::filesystem::path free_name(Take&& take) const {
    static std::atomic<unsigned> number{0};
    for (;;) {
      std::filesystem::path name = model_;
      name.replace_filename(".pgl-" + std::to_string(getpid()) + "-" + std::to_string(number++) + ".tmp");
      if (take(name)) return name;
      if (errno != EEXIST) fail_to_write(model_);
    }
  }
  void remove_name() {
    if (!name_.empty()) unlink(name_.c_str());
    name_.clear();
  }

  std::filesystem::path model_, name_;
  int descriptor_ = -1;
};

void write_at(const std::filesystem::path& model, int descriptor, std::span<const std::byte> bytes,
              std::uint64_t offset) {
  while (!bytes.empty()) {
    const ssize_t n = pwrite(descriptor, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) fail_to_write(model);
    bytes = bytes.subspan(static_cast<std::size_t>(n));
    offset += static_cast<std::uint64_t>(n);
  }
}

/// What has come of one of the large arrays.
struct Spill {
  Spill(const std::filesystem::path& model, TemporaryFiles kind) : file(model, kind, false) {}

  /// Some elements after each other, all of one width of indices.
  struct Run {
    std::uint64_t count;
    bool wide;
  };
  TemporaryFile file;
  std::uint64_t bytes = 0;
  std::uint64_t count = 0;
  std::vector<Run> runs;

  template <class Element>
  void append(const std::filesystem::path& model, std::span<const Element> elements, bool wide) {
    if (elements.empty()) return;
    write_at(model, file.descriptor(), std::as_bytes(elements), bytes);
    bytes += elements.size_bytes();
    count += elements.size();
    if (runs.empty() || runs.back().wide != wide) runs.push_back({0, wide});
    runs.back().count += elements.size();
  }
};

/// Writes the file page by page after the header, and keeps the checksums.
class PageWriter {
 public:
  PageWriter(const std::filesystem::path& model, int descriptor, std::uint64_t total, const Progress& progress)
      : model_(model), descriptor_(descriptor), total_(total), progress_(progress), buffer_(chunk_bytes) {}

  void write(std::span<const std::byte> bytes) {
    while (!bytes.empty()) {
      const std::size_t n = std::min(bytes.size(), buffer_.size() - used_);
      std::memcpy(buffer_.data() + used_, bytes.data(), n);
      used_ += n;
      bytes = bytes.subspan(n);
      if (used_ == buffer_.size()) flush();
    }
  }
  template <class Element>
  void write_section(std::span<const Element> elements) {
    write(std::as_bytes(elements));
    end_page();
  }
  void end_page() {
    const std::size_t rest = (page_bytes - used_ % page_bytes) % page_bytes;
    std::memset(buffer_.data() + used_, 0, rest);
    used_ += rest;
    if (used_ == buffer_.size()) flush();
  }
  /// Writes what is left and returns the checksums of all pages since the last time.
  std::vector<std::uint64_t> take_checksums() {
    PGL_ASSERT(used_ % page_bytes == 0);
    flush();
    return std::exchange(checksums_, {});
  }
  [[nodiscard]] std::uint64_t page() const { return (written_ + used_) / page_bytes; }

 private:
  void flush() {
    const std::size_t pages = used_ / page_bytes, before = checksums_.size();
    checksums_.resize(before + pages);
    pgl::host::parallel_for(pages, 64, [&](std::size_t p) {
      checksums_[before + p] = format::checksum(std::span(buffer_).subspan(p * page_bytes, page_bytes));
    });
    write_at(model_, descriptor_, std::span(buffer_).first(used_), written_);
    written_ += used_;
    used_ = 0;
    if (progress_ && written_ < total_)
      progress_("write", static_cast<std::size_t>(written_ / mebibyte),
                static_cast<std::size_t>(total_ / mebibyte + 1));
  }

  const std::filesystem::path& model_;
  int descriptor_;
  std::uint64_t total_;
  const Progress& progress_;
  std::vector<std::byte> buffer_;
  std::size_t used_ = 0;
  std::uint64_t written_ = page_bytes;  // the header comes last
  std::vector<std::uint64_t> checksums_;
};

std::uint32_t widened(std::uint16_t target) {
  return target == no_target<std::uint16_t> ? no_target<std::uint32_t> : target;
}
pgl::Triangle<std::uint32_t> widened(const pgl::Triangle<std::uint16_t>& t) {
  return {{t.v[0], t.v[1], t.v[2]}};
}

/// Copies a spill into the file, and gives its room on the disk back on the way.
template <class Narrow, class Wide>
void write_spill(const std::filesystem::path& model, const Spill& spill, bool wide, PageWriter& out) {
  const int descriptor = spill.file.descriptor();
  std::vector<std::byte> chunk;
  std::vector<Wide> converted;
  std::uint64_t offset = 0;
  for (const Spill::Run& run : spill.runs) {
    const std::size_t size = run.wide ? sizeof(Wide) : sizeof(Narrow);
    for (std::uint64_t left = run.count; left > 0;) {
      const auto n = static_cast<std::size_t>(std::min<std::uint64_t>(left, chunk_bytes / size));
      chunk.resize(n * size);
      for (std::size_t done = 0; done < chunk.size();) {
        const ssize_t got =
            pread(descriptor, chunk.data() + done, chunk.size() - done, static_cast<off_t>(offset + done));
        if (got < 0 && errno == EINTR) continue;
        if (got == 0) errno = EIO;
        if (got <= 0) fail_to_write(model);
        done += static_cast<std::size_t>(got);
      }
      if constexpr (!std::is_same_v<Narrow, Wide>) {
        if (wide && !run.wide) {
          converted.resize(n);
          const std::span narrow(reinterpret_cast<const Narrow*>(chunk.data()), n);
          std::transform(narrow.begin(), narrow.end(), converted.begin(), [](const Narrow& x) { return widened(x); });
          out.write(std::as_bytes(std::span<const Wide>(converted)));
        } else {
          out.write(chunk);
        }
      } else {
        out.write(chunk);
      }
      left -= n;
      offset += chunk.size();
#if defined(FALLOC_FL_PUNCH_HOLE)
      // Whole blocks before `offset`; where that cannot be done, the room is given back at the end.
      (void)fallocate(descriptor, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, 0, static_cast<off_t>(offset));
#endif
    }
  }
  out.end_page();
}

/// Where the file really goes: at the end of symbolic links.
std::filesystem::path target_of(const std::filesystem::path& file) {
  std::error_code error;
  std::filesystem::path target = file;
  for (int links = 0; std::filesystem::is_symlink(std::filesystem::symlink_status(target, error)); ++links) {
    if (links == 40) throw Error(file, "cannot be written: too many symbolic links");
    const std::filesystem::path next = std::filesystem::read_symlink(target, error);
    if (error) throw Error(file, "cannot be written: " + error.message());
    target = target.parent_path() / next;  // next alone if it is absolute
  }
  const std::filesystem::file_status status = std::filesystem::status(target, error);
  if (std::filesystem::is_directory(status)) throw Error(file, "cannot be written: it is a folder");
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
    throw Error(file, "cannot be written: it is not a regular file");
  if (!target.has_filename()) throw Error(file, "cannot be written: it has no name");
  return target;
}

}  // namespace

struct ModelFileWriter::State {
  State(std::filesystem::path path, TemporaryFiles kind)
      : file(target_of(path)),
        out(file, kind, true),
        vertices(file, kind),
        triangles(file, kind),
        ecol(file, kind),
        map(file, kind),
        errors(file, kind) {}

  std::filesystem::path file;
  TemporaryFile out;
  Spill vertices, triangles, ecol, map, errors;
  bool wide = false;
  UpAxis up = UpAxis::not_told;
  std::vector<pgl::Mesh> meshes;
  std::vector<pgl::Object> objects;
  std::vector<pgl::Box> mesh_boxes;
  std::vector<pgl::OrientedBox> oriented_boxes;
  std::vector<float> compactness;

  format::Layout layout() const {
    format::Counts counts;
    counts[format::meshes] = counts[format::mesh_boxes] = counts[format::oriented_boxes] = counts[format::compactness] =
        meshes.size();
    counts[format::objects] = counts[format::object_boxes] = counts[format::faces] = counts[format::compactness_order] =
        objects.size();
    counts[format::map] = map.count;
    counts[format::ecol] = counts[format::vertices] = vertices.count;
    counts[format::triangles] = triangles.count;
    counts[format::errors] = errors.count;
    const auto found = format::layout_of(counts, wide);
    if (!found) throw Error(file, "cannot be written: it would be too large");
    return *found;
  }
};

ModelFileWriter::ModelFileWriter(std::filesystem::path file, TemporaryFiles temporary)
    : state_(std::make_unique<State>(std::move(file), temporary)) {}
ModelFileWriter::~ModelFileWriter() = default;
ModelFileWriter::ModelFileWriter(ModelFileWriter&&) noexcept = default;
ModelFileWriter& ModelFileWriter::operator=(ModelFileWriter&&) noexcept = default;

template <class Index>
void ModelFileWriter::append(const ModelView<Index>& part) {
  State& s = *state_;
  constexpr bool wide = sizeof(Index) == 4;
  PGL_ASSERT(part.mesh_boxes.size() == part.meshes.size() && part.oriented_boxes.size() == part.meshes.size());
  PGL_ASSERT(part.compactness.size() == part.meshes.size() && part.ecol.size() == part.vertices.size());
  PGL_ASSERT(part.errors.empty() || part.errors.size() == part.map.size());
  if (part.meshes.size() > 0xffffffffu - s.meshes.size()) throw Error(s.file, "cannot be written: too many meshes");
  if (part.objects.size() > (std::size_t{1} << 31) - s.objects.size())
    throw Error(s.file, "cannot be written: too many objects");

  const auto first_mesh = static_cast<std::uint32_t>(s.meshes.size());
  for (pgl::Mesh mesh : part.meshes) {
    mesh.first_vertex += s.vertices.count;
    mesh.first_triangle += s.triangles.count;
    mesh.first_map += s.map.count;
    s.meshes.push_back(mesh);
  }
  for (pgl::Object object : part.objects) {
    PGL_ASSERT(object.mesh < part.meshes.size());
    object.mesh += first_mesh;
    s.objects.push_back(object);
  }
  s.mesh_boxes.insert(s.mesh_boxes.end(), part.mesh_boxes.begin(), part.mesh_boxes.end());
  s.oriented_boxes.insert(s.oriented_boxes.end(), part.oriented_boxes.begin(), part.oriented_boxes.end());
  s.compactness.insert(s.compactness.end(), part.compactness.begin(), part.compactness.end());
  s.wide = s.wide || wide;
  s.vertices.append(s.file, part.vertices, wide);
  s.triangles.append(s.file, part.triangles, wide);
  s.ecol.append(s.file, part.ecol, wide);
  s.map.append(s.file, part.map, wide);
  s.errors.append(s.file, part.errors, wide);
}
template void ModelFileWriter::append(const ModelView<std::uint16_t>&);
template void ModelFileWriter::append(const ModelView<std::uint32_t>&);

std::span<pgl::Object> ModelFileWriter::objects() {
  return state_->objects;
}

void ModelFileWriter::set_up(UpAxis up) {
  PGL_ASSERT(up <= UpAxis::z);
  state_->up = up;
}

void ModelFileWriter::finish(const Progress& progress) {
  State& s = *state_;
  for (const pgl::Object& object : s.objects)
    if (object.mesh >= s.meshes.size()) throw Error(s.file, "cannot be written: an object has no mesh");
  if (s.errors.count != 0 && s.errors.count != s.map.count)
    throw Error(s.file, "cannot be written: some parts have errors, others none");
  const format::Layout layout = s.layout();
  PageWriter out(s.file, s.out.descriptor(), layout.file_bytes, progress);

  out.write_section(std::span<const pgl::Mesh>(s.meshes));
  out.write_section(std::span<const pgl::Object>(s.objects));
  out.write_section(std::span<const pgl::Box>(s.mesh_boxes));
  std::vector<pgl::Box> object_boxes(s.objects.size());
  pgl::host::object_bounds(s.objects, s.mesh_boxes, object_boxes);
  out.write_section(std::span<const pgl::Box>(object_boxes));
  out.write_section(std::span<const pgl::OrientedBox>(s.oriented_boxes));
  out.write_section(std::span<const float>(s.compactness));
  std::vector<pgl::OccluderFace> faces(s.objects.size());
  pgl::host::occluder_faces(s.objects, s.oriented_boxes, s.compactness, faces);
  out.write_section(std::span<const pgl::OccluderFace>(faces));
  std::vector<std::uint32_t> order(s.objects.size());
  pgl::host::OccluderWorkspace workspace;
  pgl::host::compactness_order(faces, workspace, order);
  out.write_section(std::span<const std::uint32_t>(order));

  PGL_ASSERT(out.page() * page_bytes == layout.first_byte[format::map]);
  write_spill<std::uint32_t, std::uint32_t>(s.file, s.map, s.wide, out);
  write_spill<std::uint16_t, std::uint32_t>(s.file, s.ecol, s.wide, out);
  write_spill<pgl::Triangle<std::uint16_t>, pgl::Triangle<std::uint32_t>>(s.file, s.triangles, s.wide, out);
  write_spill<glm::vec3, glm::vec3>(s.file, s.vertices, s.wide, out);
  write_spill<float, float>(s.file, s.errors, s.wide, out);
  PGL_ASSERT(out.page() * page_bytes == layout.first_byte[format::checksums]);

  std::vector<std::uint64_t> checksums = out.take_checksums();
  for (std::size_t level = 1; level < layout.levels; ++level) {
    PGL_ASSERT(out.page() == layout.level_first[level]);
    out.write_section(std::span<const std::uint64_t>(checksums));
    checksums = out.take_checksums();
  }
  PGL_ASSERT(out.page() * page_bytes == layout.file_bytes);

  format::Header header{};
  header.magic = format::magic;
  header.version = format::version;
  header.byte_order = format::byte_order;
  header.bytes_per_page = page_bytes;
  header.index_bits = s.wide ? 32 : 16;
  header.file_bytes = layout.file_bytes;
  header.root = checksums.empty() ? 0 : checksums[0];
  header.number_of_sections = format::section_count;
  header.up = static_cast<std::uint32_t>(s.up);
  for (std::uint32_t section = 0; section < format::section_count; ++section)
    header.sections[section] = {section, static_cast<std::uint32_t>(format::element_bytes(section, s.wide)),
                                layout.first_byte[section], layout.count[section]};
  const auto header_bytes = std::as_bytes(std::span(&header, 1));
  header.checksum = format::checksum(header_bytes.first(offsetof(format::Header, checksum)));
  write_at(s.file, s.out.descriptor(), header_bytes, 0);

  const auto mebibytes = static_cast<std::size_t>(layout.file_bytes / mebibyte + 1);
  if (progress) progress("write", mebibytes, mebibytes);
  if (progress) progress("sync", 0, mebibytes);
  if (fsync(s.out.descriptor()) != 0) fail_to_write(s.file);
  if (progress) progress("sync", mebibytes, mebibytes);
  s.out.take_place();
  // The file is there; that its name outlives a loss of power is all that is left, and cannot be had everywhere.
  std::filesystem::path folder = s.file.parent_path();
  if (folder.empty()) folder = ".";
  const int descriptor = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor >= 0) {
    (void)fsync(descriptor);
    close(descriptor);
  }
}

}  // namespace pgl::scene
