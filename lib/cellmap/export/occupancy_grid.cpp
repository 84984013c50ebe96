#include "cellmap/export/occupancy_grid.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/export/patch_points.hpp"
#include "cellmap/place/ground.hpp"

namespace cellmap {
namespace {

namespace fs = std::filesystem;

constexpr std::uint8_t kOccupied = 0, kUnknown = 205, kFree = 254;
constexpr std::int64_t kMaxSide = 65'535;
/// How far from the fitted ground, and how level, a patch of the ground may be.
constexpr double kGroundM = 0.2, kGroundCosine = 0.9;

std::int64_t divided(std::int64_t value, std::int64_t by) {
  return value >= 0 ? value / by : -((by - 1 - value) / by);
}

/// Written beside its place first, so that nobody reads a half.
class AtomicFile {
 public:
  explicit AtomicFile(const fs::path& file) : file_(file), part_(file.string() + ".part") {
    out.open(part_, std::ios::binary | std::ios::trunc);
  }
  void finish() {
    out.close();
    std::error_code failed;
    if (out) fs::rename(part_, file_, failed);
    if (!out || failed) throw Error(ErrorCode::kIo, file_.string() + ": cannot be written");
  }
  std::ofstream out;

 private:
  fs::path file_, part_;
};

}  // namespace

void OccupancyOptions::validate() const {
  const auto require = [](bool holds, const char* message) {
    if (!holds) throw Error(ErrorCode::kInvalidArgument, message);
  };
  require(resolution_m >= 0.01 && resolution_m <= 10, "resolution_m: expected 0.01 to 10");
  require(lowest_m > -10 && lowest_m < highest_m && highest_m <= 100,
          "lowest_m, highest_m: expected -10 < lowest < highest <= 100");
  require(max_range_m > 0 && max_range_m <= 10'000, "max_range_m: expected 0 to 10,000");
}

OccupancyGrid::OccupancyGrid(const OccupancyOptions& options) : options_(options) {
  options_.validate();
}

std::uint8_t& OccupancyGrid::at(const Pixel& pixel) {
  const bool first = high_ < low_;
  low_ =
      first ? pixel : Pixel(std::min(low_.first, pixel.first), std::min(low_.second, pixel.second));
  high_ = first ? pixel
                : Pixel(std::max(high_.first, pixel.first), std::max(high_.second, pixel.second));
  const Pixel block{divided(pixel.first, kBlock), divided(pixel.second, kBlock)};
  const auto [found, is_new] = blocks_.try_emplace(block);
  if (is_new) found->second.fill(kUnknown);
  const std::int64_t x = pixel.first - block.first * kBlock;
  const std::int64_t y = pixel.second - block.second * kBlock;
  return found->second[static_cast<std::size_t>(y * kBlock + x)];
}

std::uint8_t OccupancyGrid::value(const Pixel& pixel) const {
  const Pixel block{divided(pixel.first, kBlock), divided(pixel.second, kBlock)};
  const auto found = blocks_.find(block);
  if (found == blocks_.end()) return kUnknown;
  const std::int64_t x = pixel.first - block.first * kBlock;
  const std::int64_t y = pixel.second - block.second * kBlock;
  return found->second[static_cast<std::size_t>(y * kBlock + x)];
}

void OccupancyGrid::add(const Cell& cell, const Lattice& lattice, const Pose& T_map_cell) {
  const Pose T_ground_cell = fit_ground(reconstruct_points(cell, lattice)).T_ground_sensor;
  // Half a pixel apart, so that no pixel of a patch is left out.
  const PointsOnPatches patches =
      patch_points(cell, lattice, Pose::Identity(), options_.resolution_m / 2);
  for (std::size_t i = 0; i < patches.points.size(); ++i) {
    const Eigen::Vector3d p = patches.points[i].cast<double>();
    if (p.norm() > options_.max_range_m) continue;
    const Eigen::Vector3d normal = T_ground_cell.linear() * patches.normals[i].cast<double>();
    const double height = (T_ground_cell * p).z();
    const bool is_obstacle = height >= options_.lowest_m && height <= options_.highest_m;
    const bool is_ground = std::abs(height) <= kGroundM && normal.z() >= kGroundCosine;
    if (!is_obstacle && !is_ground) continue;
    const Eigen::Vector3d in_map = T_map_cell * p;
    std::uint8_t& pixel =
        at({static_cast<std::int64_t>(std::floor(in_map.x() / options_.resolution_m)),
            static_cast<std::int64_t>(std::floor(in_map.y() / options_.resolution_m))});
    if (is_obstacle) pixel = kOccupied;
    if (is_ground && pixel == kUnknown) pixel = kFree;
  }
}

void OccupancyGrid::write(const fs::path& file) const {
  if (file.extension() != ".yaml") {
    throw Error(ErrorCode::kInvalidArgument,
                "expected a name that ends in .yaml, not '" + file.string() + "'");
  }
  if (blocks_.empty()) {
    throw Error(ErrorCode::kInvalidArgument, "the map has no ground and no obstacle to draw");
  }
  if (width() > kMaxSide || height() > kMaxSide) {
    throw Error(ErrorCode::kTooLarge, "the image would be " + std::to_string(width()) + " x " +
                                          std::to_string(height()) +
                                          " pixels, at most 65,535 a side; take a coarser one");
  }
  fs::path image = file;
  image.replace_extension(".pgm");
  AtomicFile pgm(image);
  pgm.out << "P5\n" << width() << " " << height() << "\n255\n";
  for (std::int64_t y = high_.second; y >= low_.second; --y) {  // the first row is the northernmost
    std::string row;
    for (std::int64_t x = low_.first; x <= high_.first; ++x) {
      row += static_cast<char>(value({x, y}));
    }
    pgm.out << row;
  }
  pgm.finish();
  char text[512];
  std::snprintf(text, sizeof(text),
                "image: %s\nmode: trinary\nresolution: %.9g\norigin: [%.9g, %.9g, 0]\nnegate: 0\n"
                "occupied_thresh: 0.65\nfree_thresh: 0.196\n",
                image.filename().string().c_str(), options_.resolution_m,
                static_cast<double>(low_.first) * options_.resolution_m,
                static_cast<double>(low_.second) * options_.resolution_m);
  AtomicFile yaml(file);
  yaml.out << text;
  yaml.finish();
}

}  // namespace cellmap
