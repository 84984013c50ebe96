#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/evaluation/point_bytes.hpp"
#include "cellmap/evaluation/representation.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kMaxFileBytes = std::size_t{4} << 30;
constexpr int kSmallestLevel = 19;

std::string metres(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%g m", value);
  return text;
}

/// Interleaves the low 21 bits of three numbers: neighbours in space are neighbours in order.
std::uint64_t spread(std::uint64_t v) {
  std::uint64_t result = 0;
  for (int bit = 0; bit < 21; ++bit) result |= (v >> bit & 1) << (3 * bit);
  return result;
}
std::uint64_t gather(std::uint64_t v) {
  std::uint64_t result = 0;
  for (int bit = 0; bit < 21; ++bit) result |= (v >> (3 * bit) & 1) << bit;
  return result;
}

void put_varint(Bytes& bytes, std::uint64_t value) {
  for (; value >= 0x80; value >>= 7) bytes.push_back(static_cast<std::byte>(value | 0x80));
  bytes.push_back(static_cast<std::byte>(value));
}

std::uint64_t take_varint(std::span<const std::byte>& bytes) {
  std::uint64_t value = 0;
  for (int shift = 0; shift < 64 && !bytes.empty(); shift += 7) {
    const auto byte = std::to_integer<std::uint64_t>(bytes.front());
    bytes = bytes.subspan(1);
    value |= (byte & 0x7f) << shift;
    if (byte < 0x80) return value;
  }
  throw Error(ErrorCode::kCorruptData, "expected a number of at most ten bytes, found none");
}

/// A voxel and the step within it, axis by axis.
struct GridPoint {
  std::uint64_t voxel = 0;  // Morton order
  std::array<std::uint8_t, 3> step{};
};

std::vector<GridPoint> on_grid(const PointCloud& points, double voxel_m, int steps) {
  std::vector<GridPoint> grid(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const float xyz[] = {points.x[i], points.y[i], points.z[i]};
    for (int axis = 0; axis < 3; ++axis) {
      const double at = xyz[axis] / voxel_m, voxel = std::floor(at);
      grid[i].voxel |= spread(static_cast<std::uint64_t>(voxel + (1 << 20))) << axis;
      grid[i].step[axis] =
          static_cast<std::uint8_t>(std::min(steps - 1, static_cast<int>((at - voxel) * steps)));
    }
  }
  std::sort(grid.begin(), grid.end(),
            [](const GridPoint& a, const GridPoint& b) { return a.voxel < b.voxel; });
  return grid;
}

Bytes grid_bytes(const std::vector<GridPoint>& grid) {
  Bytes bytes;
  put_varint(bytes, grid.size());
  std::uint64_t last = 0;
  for (const GridPoint& point : grid) {
    put_varint(bytes, point.voxel - last);
    last = point.voxel;
  }
  for (int axis = 0; axis < 3; ++axis) {
    for (const GridPoint& point : grid) bytes.push_back(std::byte{point.step[axis]});
  }
  return bytes;
}

PointCloud points_of_grid(std::span<const std::byte> bytes, double voxel_m, int steps) {
  const std::uint64_t count = take_varint(bytes);
  std::vector<std::uint64_t> voxels;
  std::uint64_t last = 0;
  for (std::uint64_t i = 0; i < count; ++i) voxels.push_back(last += take_varint(bytes));
  if (bytes.size() != 3 * count) {
    throw Error(ErrorCode::kCorruptData, "expected three steps for each point of the grid");
  }
  PointCloud points;
  points.reserve(count);
  for (std::uint64_t i = 0; i < count; ++i) {
    Eigen::Vector3d p;
    for (int axis = 0; axis < 3; ++axis) {
      const double voxel = static_cast<double>(gather(voxels[i] >> axis)) - (1 << 20);
      const double step = std::to_integer<int>(bytes[axis * count + i]);
      p[axis] = voxel_m * (voxel + (step + 0.5) / steps);
    }
    points.push_back(p.cast<float>());
  }
  return points;
}

}  // namespace

Representation raw_points(std::optional<int> zstd_level) {
  Representation raw;
  raw.name = "raw points" + (zstd_level ? ", zstd " + std::to_string(*zstd_level) : "");
  raw.encode = [zstd_level](const ComparedDrive& drive) {
    Bytes bytes = pcd_bytes(stacked_points(drive));
    if (!zstd_level) return MapFiles{{"points.pcd", std::move(bytes)}};
    return MapFiles{{"points.pcd.zst", zstd_compress(bytes, *zstd_level)}};
  };
  raw.decode = [zstd_level](const MapFiles& files) {
    const Bytes& bytes = files.at(0).bytes;
    DecodedMap map;
    map.points = points_of_pcd(zstd_level ? zstd_decompress(bytes, kMaxFileBytes) : bytes);
    return map;
  };
  return raw;
}

Representation voxel_points(double voxel_m) {
  return {metres(voxel_m) + " voxels",
          [voxel_m](const ComparedDrive& drive) {
            return MapFiles{{"points.pcd", pcd_bytes(voxel_means(stacked_points(drive), voxel_m))}};
          },
          [](const MapFiles& files) {
            DecodedMap map;
            map.points = points_of_pcd(files.at(0).bytes);
            return map;
          }};
}

Representation quantised_voxels(double voxel_m, double step_m) {
  const int steps = static_cast<int>(std::lround(voxel_m / step_m));
  if (steps < 1 || steps > 256 || std::abs(steps * step_m - voxel_m) > 1e-9) {
    throw Error(ErrorCode::kInvalidArgument,
                "expected a step that divides the voxel into 1 to 256 steps");
  }
  return {metres(voxel_m) + " voxels, grid of " + metres(step_m) + ", zstd",
          [=](const ComparedDrive& drive) {
            const PointCloud means = voxel_means(stacked_points(drive), voxel_m);
            return MapFiles{
                {"points.grid.zst",
                 zstd_compress(grid_bytes(on_grid(means, voxel_m, steps)), kSmallestLevel)}};
          },
          [=](const MapFiles& files) {
            DecodedMap map;
            map.points =
                points_of_grid(zstd_decompress(files.at(0).bytes, kMaxFileBytes), voxel_m, steps);
            return map;
          }};
}

}  // namespace cellmap
