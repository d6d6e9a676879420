// SPDX-License-Identifier: MIT
// Brings the tiles that several ranks drew into one picture.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "pgl/balance.hpp"
#include "viewer/cuda_picture.hpp"
#include "viewer/ranks.hpp"
#include "viewer/renderer.hpp"

namespace pgl::viewer {

/// The way of the tiles to rank 0: none with one rank; through memory of rank 0's GPU that the others write into (CUDA
/// IPC), where all are on one machine and can; else as messages of MPI.
///
/// Made and destroyed by all, in the same order as their other calls of Ranks. Both must outlive it. Before
/// Renderer::draw_offscreen() is called again it must be gone: a picture of another size needs another one.
class PictureExchange {
 public:
  /// The picture is that of draw_offscreen(), of this size. `cuda`: whether a frame is prepared by CUDA; the same in
  /// all ranks. Throws what Ranks throws, in all ranks.
  PictureExchange(Ranks& ranks, Renderer& renderer, int width, int height, bool cuda);
  ~PictureExchange();
  PictureExchange(const PictureExchange&) = delete;
  PictureExchange& operator=(const PictureExchange&) = delete;

  /// By all, after they drew: resolves the own tile, and on rank 0 puts those of the others into the picture. There it
  /// is whole after this, if the tiles cover it: Renderer::read_picture() and present() give it. Empty tiles cost
  /// nothing. Throws std::runtime_error for what OpenGL or CUDA reports, only where it happened: see Ranks::abort().
  ///
  /// The memory of rank 0's GPU has one picture: a rank may write the next one only after rank 0 has read this one. So
  /// between two calls something must come to all from rank 0, which it sends after the first: the camera of the next
  /// frame does.
  /// Preconditions: one tile for each rank, equal in all ranks; they lie in the picture and do not overlap.
  void exchange(std::span<const Tile> tiles);

  /// "alone", "CUDA IPC" or "MPI".
  const char* how() const;

  /// On rank 0, why the tiles do not come by CUDA IPC although all are on one machine and CUDA was asked for; else
  /// empty.
  const std::string& note() const { return note_; }

 private:
  void open();
  void exchange_by_cuda(std::span<const Tile> tiles);
  void exchange_messages(std::span<const Tile> tiles);

  Ranks& ranks_;
  Renderer& renderer_;
  std::unique_ptr<CudaPicture> cuda_;
  std::uint64_t pixels_;           ///< of the picture
  std::vector<std::byte> bytes_;   ///< of one tile
  std::vector<PlacedTile> tiles_;  ///< of the others
  std::string note_;
  int exceptions_;  ///< under way when this was made
};

}  // namespace pgl::viewer
