// SPDX-License-Identifier: MIT
// Brings the tiles that several ranks drew into one picture.
#include "viewer/picture_exchange.hpp"

#include <algorithm>
#include <exception>
#include <stdexcept>

#include "pgl/config.hpp"
#include "viewer/cuda_frame.hpp"

namespace pgl::viewer {

namespace {

std::uint64_t area(const Tile& tile) {
  return std::uint64_t{tile.x1 - tile.x0} * (tile.y1 - tile.y0);
}

}  // namespace

PictureExchange::PictureExchange(Ranks& ranks, Renderer& renderer, int width, int height, bool cuda)
    : ranks_(ranks), renderer_(renderer), pixels_(area(whole(width, height))), exceptions_(std::uncaught_exceptions()) {
  if (cuda && ranks.size() > 1 && ranks.on_one_machine()) open();
}

void PictureExchange::open() {
  struct Offer {
    bool good;
    SharedMemory memory;
  };
  Offer offer{};
  std::string failure;
  const auto attempt = [&](auto&& open) {
    if constexpr (built_with_cuda) {
      try {
        open();
        cuda_->put({{0, 0, 1, 1}, 0});  // what fails, fails now; nobody reads it
      } catch (const std::runtime_error& error) {
        failure = error.what();
      }
    } else {
      failure = "built without CUDA";
    }
  };
  if (ranks_.rank() == 0) {
    attempt([&] {
      cuda_ = take_cuda_picture(renderer_.picture(), renderer_.vendor(), pixels_);
      offer.memory = cuda_->memory();
    });
    offer.good = failure.empty();
  }
  ranks_.broadcast(offer);
  if (ranks_.rank() > 0 && offer.good) {
    attempt([&] { cuda_ = open_cuda_picture(renderer_.picture(), renderer_.vendor(), offer.memory); });
  }
  if (ranks_.least(failure.empty() && offer.good ? 1 : 0) == 1) return;

  if (ranks_.rank() > 0) cuda_.reset();  // before rank 0, which waits for the texts
  const std::vector<std::string> failures = ranks_.gather_texts(failure);
  cuda_.reset();
  const auto first = std::ranges::find_if(failures, [](const std::string& text) { return !text.empty(); });
  if (first != failures.end()) {
    note_ = "the tiles come through MPI, since rank " + std::to_string(first - failures.begin()) +
            " cannot share memory of the GPU: " + *first;
  }
}

PictureExchange::~PictureExchange() {
  if (cuda_ == nullptr) return;
  if (ranks_.rank() > 0) cuda_.reset();
  try {
    if (std::uncaught_exceptions() > exceptions_) throw std::runtime_error("the others do not wait here");
    (void)ranks_.least(0);
  } catch (...) {
    (void)cuda_.release();  // the others may still have it open: it goes with the process
  }
}

void PictureExchange::exchange(std::span<const Tile> tiles) {
  PGL_ASSERT(tiles.size() == static_cast<std::size_t>(ranks_.size()));
  const Tile& own = tiles[static_cast<std::size_t>(ranks_.rank())];
  if (area(own) > 0) renderer_.resolve(own);
  if (ranks_.size() == 1) return;
  if (cuda_ != nullptr) {
    exchange_by_cuda(tiles);
  } else {
    exchange_messages(tiles);
  }
}

void PictureExchange::exchange_by_cuda(std::span<const Tile> tiles) {
  tiles_.clear();
  std::uint64_t pixel = 0;
  for (std::size_t rank = 1; rank < tiles.size(); ++rank) {
    tiles_.push_back({tiles[rank], pixel});
    pixel += area(tiles[rank]);
  }
  PGL_ASSERT(pixel <= pixels_);
  if (ranks_.rank() > 0) {
    const PlacedTile& own = tiles_[static_cast<std::size_t>(ranks_.rank() - 1)];
    if (area(own.tile) > 0) cuda_->put(own);
  }
  (void)ranks_.least(0);  // all have written
  if (ranks_.rank() > 0) return;
  std::erase_if(tiles_, [](const PlacedTile& placed) { return area(placed.tile) == 0; });
  if (!tiles_.empty()) cuda_->take(tiles_);
}

void PictureExchange::exchange_messages(std::span<const Tile> tiles) {
  for (std::size_t rank = 1; rank < tiles.size(); ++rank) {
    const bool mine = static_cast<std::size_t>(ranks_.rank()) == rank;
    if (area(tiles[rank]) == 0 || (ranks_.rank() > 0 && !mine)) continue;
    bytes_.resize(area(tiles[rank]) * 4);
    if (mine) {
      renderer_.read_tile(tiles[rank], bytes_);
      ranks_.send(0, bytes_);
    } else {
      ranks_.receive(static_cast<int>(rank), bytes_);
      renderer_.write_tile(tiles[rank], bytes_);
    }
  }
}

const char* PictureExchange::how() const {
  return ranks_.size() == 1 ? "alone" : cuda_ != nullptr ? "CUDA IPC" : "MPI";
}

}  // namespace pgl::viewer
