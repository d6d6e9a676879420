// SPDX-License-Identifier: MIT
#include "scene/read_file.hpp"

#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <assimp/Importer.hpp>
#include <assimp/ProgressHandler.hpp>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <map>
#include <system_error>
#include <utility>

#include "scene/check_file.hpp"
#include "scene/error.hpp"
#include "scene/read_vrml.hpp"

namespace pgl::scene {
namespace {

// ---- what the child sends -------------------------------------------------------------------------------------------

enum class Tag : std::uint64_t { progress, mesh, object, points_and_lines, error, end };

struct Record {
  Tag tag;
  std::uint64_t a = 0, b = 0;
};

void send(std::FILE* out, const void* data, std::size_t bytes) {
  if (bytes != 0 && std::fwrite(data, 1, bytes, out) != bytes) _exit(1);  // the parent is gone
}
void send(std::FILE* out, const Record& record) {
  send(out, &record, sizeof record);
}

void send(std::FILE* out, const MeshData& mesh) {
  send(out, Record{Tag::mesh, mesh.positions.size(), mesh.triangles.size()});
  send(out, mesh.positions.data(), mesh.positions.size() * sizeof mesh.positions[0]);
  send(out, mesh.triangles.data(), mesh.triangles.size() * sizeof mesh.triangles[0]);
}

// ---- the child ------------------------------------------------------------------------------------------------------

struct Placement {
  const aiNode* node;
  std::array<std::array<double, 3>, 4> world;
};

/// parent * local, for affine matrices, in double.
std::array<std::array<double, 3>, 4> compose(const std::array<std::array<double, 3>, 4>& parent,
                                             const aiMatrix4x4& local) {
  std::array<std::array<double, 3>, 4> result;
  for (unsigned column = 0; column < 4; ++column)
    for (unsigned row = 0; row < 3; ++row) {
      double sum = column == 3 ? parent[3][row] : 0.0;
      for (unsigned k = 0; k < 3; ++k) sum += parent[k][row] * static_cast<double>(local[k][column]);
      result[column][row] = sum;
    }
  return result;
}

/// Throws when an index is out of range or triangles are missing; true when some face has more than three corners.
/// Makes every mesh say truly which kinds of faces it has: some importers do not, and the step that cuts polygons
/// aborts then.
bool check_faces(const aiScene& scene, std::uint64_t promised_triangles) {
  std::uint64_t triangles = 0;
  bool polygons = false;
  for (unsigned m = 0; m < scene.mNumMeshes; ++m) {
    aiMesh& mesh = *scene.mMeshes[m];
    mesh.mPrimitiveTypes = 0;
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      const aiFace& face = mesh.mFaces[f];
      for (unsigned k = 0; k < face.mNumIndices; ++k)
        if (face.mIndices[k] >= mesh.mNumVertices) throw std::runtime_error("a vertex index is out of range");
      mesh.mPrimitiveTypes |= face.mNumIndices > 3    ? aiPrimitiveType_POLYGON
                              : face.mNumIndices == 3 ? aiPrimitiveType_TRIANGLE
                                                      : aiPrimitiveType_LINE;
      triangles += face.mNumIndices >= 3;
    }
    polygons = polygons || (mesh.mPrimitiveTypes & aiPrimitiveType_POLYGON);
  }
  if (triangles < promised_triangles) throw std::runtime_error("a vertex index is out of range");
  return polygons;
}

/// The meshes of one node as one; points and lines are counted, not kept.
MeshData merge(const aiScene& scene, const std::vector<unsigned>& parts, std::uint64_t& points_and_lines) {
  MeshData mesh;
  for (const unsigned part : parts) {
    const aiMesh& from = *scene.mMeshes[part];
    const std::size_t first = mesh.positions.size();
    if (first + from.mNumVertices >= (std::size_t{1} << 31))
      throw std::runtime_error("a mesh has 2^31 or more vertices");
    mesh.positions.resize(first + from.mNumVertices);
    static_assert(sizeof(aiVector3D) == sizeof(glm::vec3));
    if (from.mNumVertices) std::memcpy(&mesh.positions[first], from.mVertices, from.mNumVertices * sizeof(glm::vec3));
    for (unsigned f = 0; f < from.mNumFaces; ++f) {
      const aiFace& face = from.mFaces[f];
      if (face.mNumIndices < 3) ++points_and_lines;
      const auto corner = [&](unsigned k) { return static_cast<std::uint32_t>(first + face.mIndices[k]); };
      for (unsigned k = 2; k < face.mNumIndices; ++k) mesh.triangles.push_back({{corner(0), corner(k - 1), corner(k)}});
    }
  }
  return mesh;
}

class Reporter : public Assimp::ProgressHandler {
 public:
  explicit Reporter(std::FILE* out) : out_(out) {}
  bool Update(float) override { return true; }
  void UpdateFileRead(int step, int steps) override {
    if (step < 0 || steps <= 0 || step > steps) return;
    send(out_, Record{Tag::progress, static_cast<std::uint64_t>(step), static_cast<std::uint64_t>(steps)});
    std::fflush(out_);
  }

 private:
  std::FILE* out_;
};

void parse_and_send(const std::filesystem::path& file, std::FILE* out) {
  const std::uint64_t promised_triangles = check_file(file);
  // Never destroyed: the process ends, and a deep node tree cannot overflow the stack then.
  auto* importer = new Assimp::Importer;
  importer->SetProgressHandler(new Reporter(out));
  const aiScene* scene = importer->ReadFile(file.native(), 0);
  if (!scene || !scene->mRootNode)
    throw std::runtime_error(std::string("cannot be read: ") + importer->GetErrorString());
  if (check_faces(*scene, promised_triangles)) scene = importer->ApplyPostProcessing(aiProcess_Triangulate);
  if (!scene) throw std::runtime_error("cannot be read: its polygons cannot be cut into triangles");

  // From the meshes of a node to ours; no_mesh where they have no triangles.
  std::map<std::vector<unsigned>, std::uint64_t> known;
  constexpr std::uint64_t no_mesh = ~std::uint64_t{0};
  std::uint64_t mesh_count = 0, points_and_lines = 0;
  std::vector<Placement> stack{
      {scene->mRootNode, compose({{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}}}, scene->mRootNode->mTransformation)}};
  while (!stack.empty()) {
    const Placement at = stack.back();
    stack.pop_back();
    const aiNode& node = *at.node;
    for (unsigned k = node.mNumChildren; k-- > 0;)
      stack.push_back({node.mChildren[k], compose(at.world, node.mChildren[k]->mTransformation)});
    if (node.mNumMeshes == 0) continue;
    const std::vector<unsigned> parts(node.mMeshes, node.mMeshes + node.mNumMeshes);
    const auto [entry, is_new] = known.try_emplace(parts, no_mesh);
    if (is_new) {
      const MeshData mesh = merge(*scene, parts, points_and_lines);
      if (!mesh.triangles.empty()) {
        entry->second = mesh_count++;
        send(out, mesh);
      }
    }
    if (entry->second == no_mesh) continue;
    send(out, Record{Tag::object, entry->second, node.mName.length});
    send(out, at.world.data(), sizeof at.world);
    send(out, node.mName.data, node.mName.length);
  }
  send(out, Record{Tag::points_and_lines, points_and_lines});
}

void parse_vrml_and_send(const std::filesystem::path& file, std::FILE* out) {
  check_file(file);
  const FileContent content = read_vrml(file);
  for (const MeshData& mesh : content.meshes) send(out, mesh);
  for (const FileObject& object : content.objects) {
    send(out, Record{Tag::object, object.mesh, object.name.size()});
    send(out, object.transform, sizeof object.transform);
    send(out, object.name.data(), object.name.size());
  }
  send(out, Record{Tag::points_and_lines, content.points_and_lines});
}

/// Bounds what the child may use, by the size of the file: generous for any real model, harmless for the machine.
void limit_resources(std::uint64_t file_bytes) {
  const auto set = [](auto resource, std::uint64_t value) {
    rlimit limit{};
    if (getrlimit(resource, &limit) != 0) return;
    limit.rlim_cur = std::min<rlim_t>(value, limit.rlim_max);
    setrlimit(resource, &limit);
  };
  std::uint64_t pages[6] = {};  // size resident shared text lib data, of the parent at the fork
  if (std::ifstream statm("/proc/self/statm"); statm)
    for (auto& p : pages) statm >> p;
  constexpr std::uint64_t gib = std::uint64_t{1} << 30;
  set(RLIMIT_DATA, pages[5] * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE)) + 4 * gib + 256 * file_bytes);
  set(RLIMIT_CPU, 60 + file_bytes / 100'000);
  set(RLIMIT_CORE, 0);
}

[[noreturn]] void child(const std::filesystem::path& file, std::uint64_t file_bytes, int pipe_end) {
  // What a broken heap or a sanitizer would print is told by the parent in one line.
  if (const int null = open("/dev/null", O_WRONLY); null >= 0) {
    dup2(null, STDOUT_FILENO);
    dup2(null, STDERR_FILENO);
  }
  for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT}) std::signal(signal, SIG_DFL);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP})  // what is ignored, as under nohup, stays so
    if (std::signal(signal, SIG_DFL) == SIG_IGN) std::signal(signal, SIG_IGN);
  limit_resources(file_bytes);
  std::FILE* out = fdopen(pipe_end, "wb");
  if (!out) _exit(1);
  std::string problem;
  try {
    is_vrml(file) ? parse_vrml_and_send(file, out) : parse_and_send(file, out);
  } catch (const std::bad_alloc&) {
    problem = "needs too much memory for a file of its size";
  } catch (const std::exception& error) {
    problem = error.what();
  } catch (...) {
    problem = "cannot be read";
  }
  if (!problem.empty()) {  // may quote the file, and at length
    std::replace_if(
        problem.begin(), problem.end(), [](unsigned char c) { return c < 32 || c > 126; }, '?');
    problem.resize(std::min<std::size_t>(problem.size(), 160));
    send(out, Record{Tag::error, problem.size()});
    send(out, problem.data(), problem.size());
  } else {
    send(out, Record{Tag::end});
  }
  std::fflush(out);
  _exit(0);
}

// ---- the parent -----------------------------------------------------------------------------------------------------

/// Ends the child when the parent is done with it, one way or another.
struct Child {
  pid_t pid = -1;
  int in = -1;
  std::vector<unsigned char> buffer = std::vector<unsigned char>(1 << 16);
  std::size_t used = 0, filled = 0;  ///< of the buffer

  /// Waits; the signal that ended the child, or 0.
  int wait() {
    int status = 0;
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR) {
    }
    pid = -1;
    return WIFSIGNALED(status) ? WTERMSIG(status) : 0;
  }

  /// False when the child has ended before. Calls `waiting` several times a second until the bytes are there.
  template <class Waiting>
  bool receive(void* data, std::size_t bytes, const Waiting& waiting) {
    for (auto* to = static_cast<unsigned char*>(data); bytes != 0;) {
      if (used == filled) {
        pollfd ready{in, POLLIN, 0};
        if (poll(&ready, 1, 100) <= 0) {  // nothing yet, or a signal
          waiting();
          continue;
        }
        const ssize_t got = ::read(in, buffer.data(), buffer.size());
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return false;
        used = 0;
        filled = static_cast<std::size_t>(got);
      }
      const std::size_t part = std::min(bytes, filled - used);
      std::memcpy(to, &buffer[used], part);
      to += part;
      used += part;
      bytes -= part;
    }
    return true;
  }

  ~Child() {
    if (in >= 0) close(in);
    if (pid > 0) {
      kill(pid, SIGKILL);
      wait();
    }
  }
};

std::string reason_of_death(int signal) {
  if (signal == SIGXCPU || signal == SIGKILL) return "malformed: takes too much time or memory for a file of its size";
  return "malformed: the reader failed on it" + (signal ? " (signal " + std::to_string(signal) + ")" : std::string());
}

}  // namespace

FileContent read_file(const std::filesystem::path& file, const Progress& progress) {
  std::error_code problem;
  const auto status = std::filesystem::status(file, problem);
  if (!std::filesystem::exists(status)) throw Error(file, problem ? problem.message() : "does not exist");
  if (std::filesystem::is_directory(status)) throw Error(file, "is a directory");
  if (!std::filesystem::is_regular_file(status)) throw Error(file, "is not a regular file");
  const std::uint64_t bytes = std::filesystem::file_size(file, problem);
  if (problem) throw Error(file, problem.message());
  if (bytes == 0) throw Error(file, "is empty");
  if (!has_known_extension(file)) throw Error(file, "unknown format (expected .obj, .ply, .stl, .gltf, .glb or .wrl)");

  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) throw Error(file, std::string("cannot start reading: ") + std::strerror(errno));
  Child reader;
  reader.pid = fork();
  if (reader.pid == 0) {
    close(ends[0]);
    child(file, bytes, ends[1]);
  }
  close(ends[1]);
  reader.in = ends[0];
  if (reader.pid < 0) throw Error(file, std::string("cannot start reading: ") + std::strerror(errno));

  FileContent content;
  std::uint64_t step = 0, steps = 1;
  const auto tell = [&] {
    if (progress) progress("read", step, steps);
  };
  const auto receive = [&](void* data, std::size_t size) { return reader.receive(data, size, tell); };
  try {
    for (Record record; receive(&record, sizeof record);) {
      switch (record.tag) {
        case Tag::progress:
          step = record.a;
          steps = record.b;
          tell();
          break;
        case Tag::mesh: {
          MeshData mesh;
          mesh.positions.resize(record.a);
          mesh.triangles.resize(record.b);
          if (!receive(mesh.positions.data(), record.a * sizeof mesh.positions[0])) break;
          if (!receive(mesh.triangles.data(), record.b * sizeof mesh.triangles[0])) break;
          content.meshes.push_back(std::move(mesh));
          break;
        }
        case Tag::object: {
          FileObject object{static_cast<std::uint32_t>(record.a), {}, std::string(record.b, '\0')};
          if (!receive(object.transform, sizeof object.transform)) break;
          if (!receive(object.name.data(), object.name.size())) break;
          content.objects.push_back(std::move(object));
          break;
        }
        case Tag::points_and_lines:
          content.points_and_lines = record.a;
          break;
        case Tag::error: {
          std::string text(record.a, '\0');
          if (!receive(text.data(), text.size())) break;
          throw Error(file, text);
        }
        case Tag::end:
          return content;
      }
    }
  } catch (const std::bad_alloc&) {
    throw Error(file, "does not fit in memory");
  }
  throw Error(file, reason_of_death(reader.wait()));
}

}  // namespace pgl::scene
