// SPDX-License-Identifier: MIT
// The .pgl file: a preprocessed model that is mapped into memory instead of being read, every byte of it checked before
// it is first used. docs/file_format.md says what lies where.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <stop_token>

#include "scene/build_model.hpp"
#include "scene/error.hpp"
#include "scene/mesh_data.hpp"
#include "scene/model_view.hpp"
#include "scene/up_axis.hpp"

namespace pgl::scene {

/// How a writer's temporary files are made. Unnamed ones vanish even with a process that is killed; where the file
/// system has none, named ones are taken in any case.
enum class TemporaryFiles : std::uint8_t { unnamed, named };

/// Writes a model file from parts, one at a time, in bounded memory.
///
/// Vertices, triangles, ecol, map and errors go to temporary files in the folder of `file` as they come; of meshes and
/// objects the tables stay in memory, 172 bytes for an object with a mesh of its own and 64 more in finish(). Until
/// finish() returns nothing is to be seen at `file`; then the model is there as a whole, in the place of what was there
/// before. Without it the destructor leaves nothing behind. Every function throws Error, one line that names the file,
/// where it cannot be written; after that only the destructor may be called.
class ModelFileWriter {
 public:
  /// Makes the temporary files. Throws Error where that cannot be done, or `file` is there and no regular file. A
  /// symbolic link is followed.
  explicit ModelFileWriter(std::filesystem::path file, TemporaryFiles temporary = TemporaryFiles::unnamed);
  ~ModelFileWriter();
  ModelFileWriter(ModelFileWriter&&) noexcept;
  ModelFileWriter& operator=(ModelFileWriter&&) noexcept;

  /// Adds a part: its meshes and objects follow those already there, and are numbered on from them. Of its tables of
  /// objects only `objects` is read; the others are made in finish(). Parts of 16 and of 32 bits may be mixed: one of
  /// 32 makes all the file so. Either all parts that have meshes have errors, or none has (finish() throws Error).
  /// Throws Error where there would be more than 2^32 - 1 meshes or 2^31 objects.
  /// Precondition: the part is as Model says.
  template <class Index>
  void append(const ModelView<Index>& part);
  template <class Index>
  void append(const Model<Index>& part) {
    append(ModelView<Index>(part));
  }

  /// The objects so far, to be placed anew before finish(): their transforms may be written, and `mesh`, if it names a
  /// mesh that is there. Valid until the next append() or finish().
  [[nodiscard]] std::span<pgl::Object> objects();

  /// Says which axis points up, for who looks at the model; it is not told unless this is called.
  void set_up(UpAxis up);

  /// Makes the tables of the objects, puts everything together with its checksums, waits until the disk has it, and
  /// lets it appear at `file`. Progress: stages "write" and "sync", in MiB. What `progress` throws goes through. On the
  /// disk there is at most a little more than the file at any time. Called once, last.
  void finish(const Progress& progress = {});

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// A model file, mapped into memory.
///
/// The constructor reads the first page. Everything else is checked when its part of the file is first asked for, page
/// by page against the checksums, then for what it says: after view() and require() nothing that is within their reach
/// leads out of the arrays, whatever is in the file, by damage or by intent (the checksums are no signature). Parts
/// that have been checked are not checked again. The file may be replaced meanwhile, which leaves this one as it was,
/// but must not be written in place. If it shrinks, or the disk fails, what is gone reads as zeros, and the next call
/// throws.
///
/// Errors are thrown as Error, one line that names the file and the section. Any function may run on any number of
/// threads at the same time. (To that end the first ModelFile of a process installs a handler of SIGBUS, which passes
/// on what is not about a model file.)
class ModelFile {
 public:
  /// Opens the file: its first page only, in microseconds whatever its size. Throws Error where it is no model file, of
  /// another version, truncated, or has sections that are not where they must be.
  explicit ModelFile(const std::filesystem::path& file);
  ~ModelFile();
  ModelFile(ModelFile&&) noexcept;
  ModelFile& operator=(ModelFile&&) noexcept;

  [[nodiscard]] const std::filesystem::path& path() const;
  [[nodiscard]] bool wide() const;  ///< whether Index is std::uint32_t, else std::uint16_t
  [[nodiscard]] UpAxis up() const;
  [[nodiscard]] std::uint64_t bytes() const;  ///< of the whole file
  [[nodiscard]] std::uint64_t meshes() const;
  [[nodiscard]] std::uint64_t objects() const;
  [[nodiscard]] std::uint64_t vertices() const;
  [[nodiscard]] std::uint64_t triangles() const;
  [[nodiscard]] bool has_errors() const;  ///< whether an error is recorded beside every entry of map

  /// Returns the arrays, valid as long as this ModelFile or the one that it was moved to. The first call checks the
  /// tables: all arrays of one entry per mesh or object. Of vertices, triangles, ecol and map only what require()
  /// has let pass may be read, of errors what require_errors() has; errors are empty without has_errors(). meshes and
  /// objects are copies in memory, so that where is read does not depend on the file any more. Precondition: Index is
  /// of the width that wide() says.
  template <class Index>
  [[nodiscard]] ModelView<Index> view();

  /// Checks what drawing counts[i] vertices of object i reads, for every i, where that has not been done yet: map and
  /// ecol of its mesh, the first counts[i] vertices and the triangles that it has then. In parallel. O(objects) when
  /// nothing is new. Precondition: one count per object, each 0 or in [min_vertices, max_vertices] of its mesh.
  void require(std::span<const std::uint32_t> counts);

  /// Checks the maps of the meshes of all objects with counts[i] > 0, so that lay_out may read them. One count per
  /// object; O(objects) when nothing is new.
  void require_maps(std::span<const std::uint32_t> counts);

  /// Checks all of a section that is read as a whole, as for a copy to a GPU. Nothing to do the second time.
  void require_map();
  void require_ecol();
  /// The same; throws Error without has_errors().
  void require_errors();

  /// Does what require does, on the calling thread alone and without throwing, so that a later require finds it done:
  /// for a thread in the background. What is wrong is left for require to tell. Of what has been checked before, it
  /// asks the system to read again what the objects have more of than in the last prefetch, in case it has been dropped
  /// from memory since. Returns early once a stop is requested.
  void prefetch(std::span<const std::uint32_t> counts, std::stop_token stop = {}) noexcept;

  /// Throws Error if the file is shorter than it was, or part of it could not be read. The functions above call it.
  void check() const;

  /// What has been compared with its checksum so far, for statistics; page by page, each counted once.
  [[nodiscard]] std::uint64_t bytes_verified() const;

  /// Checks the whole file, also what has been checked before: every page against its checksum, that what lies between
  /// sections is zero, and all that the other functions check. Progress: stages "checksums" (in MiB) and "meshes".
  void verify(const Progress& progress = {});

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace pgl::scene
