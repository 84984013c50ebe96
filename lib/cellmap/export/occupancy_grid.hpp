#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <utility>

#include "cellmap/cell/cell.hpp"

namespace cellmap {

struct OccupancyOptions {
  double resolution_m = 0.1;  ///< edge of a pixel
  /// What stands between these heights above the ground of its CELL is an obstacle.
  double lowest_m = 0.3, highest_m = 2.0;
  /// Farther patches say nothing: their ground and height are uncertain.
  double max_range_m = 40;

  /// Throws Error{kInvalidArgument} naming the option and its range.
  void validate() const;
};

/// A level slice through a map as nav2's map_server reads it: a PGM (P5; 0 occupied, 254 free, 205
/// unknown) and a YAML file beside it. Obstacles are patches between two heights above the ground
/// of their CELL (place/ground.hpp), free is where the ground was seen and no obstacle stands, and
/// the rest is unknown. Memory: a byte for each pixel of the blocks of 256 x 256 that hold any, not
/// the CELLs. One owner.
class OccupancyGrid {
 public:
  explicit OccupancyGrid(const OccupancyOptions& options);

  /// `T_map_cell` turns the CELL upright as the map is.
  void add(const Cell& cell, const Lattice& lattice, const Pose& T_map_cell);

  /// Writes `file` (which ends in .yaml) and the image of the same name with .pgm. Throws
  /// Error{kInvalidArgument} for another name or a map without a pixel, {kTooLarge} where a side
  /// were longer than 65,535 pixels, {kIo}.
  void write(const std::filesystem::path& file) const;

  std::int64_t width() const { return high_.first - low_.first + 1; }  ///< pixels
  std::int64_t height() const { return high_.second - low_.second + 1; }

 private:
  static constexpr std::int64_t kBlock = 256;
  using Pixel = std::pair<std::int64_t, std::int64_t>;  // x, y
  using Block = std::array<std::uint8_t, kBlock * kBlock>;

  std::uint8_t& at(const Pixel& pixel);
  std::uint8_t value(const Pixel& pixel) const;

  OccupancyOptions options_;
  std::map<Pixel, Block> blocks_;
  Pixel low_{1, 1}, high_{0, 0};
};

}  // namespace cellmap
