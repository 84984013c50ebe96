#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "cellmap/geometry/lattice.hpp"
#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/simd/moments.hpp"

namespace cellmap {

/// Neighbours in a cloud that lie in the same patch. A scanner's neighbours mostly do, so that
/// there are four times fewer runs to sort than points, and points move only once.
struct PointRun {
  std::uint32_t first;       ///< position of the first point in the cloud
  std::uint32_t patch : 20;  ///< a lattice has at most 1,000,000
  std::uint32_t count : 12;

  static constexpr std::size_t kMostPoints = 2'048;
};
static_assert(sizeof(PointRun) == 8, "runs are sorted by moving them");

/// Lattice points are worked on in bands of this many neighbours, whose points fit the cache.
constexpr std::size_t kPatchesABand = 512;
inline std::size_t bands_of(const Lattice& lattice) {
  return (lattice.size() + kPatchesABand - 1) / kPatchesABand;
}

/// Runs of consecutive parts of a cloud.
using RunParts = std::vector<std::vector<PointRun>>;

/// Appends the runs of the points from position `begin` to `end` to `parts`; points without a
/// direction are in none. Parallel; the parts do not depend on the threads.
void append_runs(const PointCloud& cloud, std::size_t begin, std::size_t end,
                 const Lattice& lattice, int threads, RunParts& parts);

/// Runs sorted by band, in the order of the cloud within one.
struct BandedRuns {
  std::unique_ptr<PointRun[]> runs;
  std::vector<std::uint32_t> begin;  ///< of each band and, one more, the end

  std::span<const PointRun> of(std::size_t band) const {
    return {runs.get() + begin[band], begin[band + 1] - begin[band]};
  }
};

/// Counting sort (paper, Sec. III-B, step 2, first half).
BandedRuns sort_by_band(std::span<const std::vector<PointRun>> parts, std::size_t bands,
                        int threads);

/// The points of one patch, cell frame, in place among those of its band.
class PatchPoints {
 public:
  PatchPoints() = default;
  PatchPoints(float* x, float* y, float* z, std::size_t count)
      : x_(x), y_(y), z_(z), count_(count) {}

  std::size_t size() const { return count_; }
  Eigen::Vector3d operator[](std::size_t i) const { return {x_[i], y_[i], z_[i]}; }
  void swap_points(std::size_t i, std::size_t j);
  /// Keeps the first `count` >= 1 points, the origin is the first one. To be called once at least.
  void keep(std::size_t count);
  /// What moments are taken about.
  Eigen::Vector3d origin() const { return {origin_[0], origin_[1], origin_[2]}; }
  void set_origin(const Eigen::Vector3d& origin);
  simd::PatchView view() const { return {x_, y_, z_, count_, origin_}; }

 private:
  float *x_ = nullptr, *y_ = nullptr, *z_ = nullptr;
  std::size_t count_ = 0;
  std::array<float, 3> origin_{};
};

/// The points of one band sorted by patch, in the order of the cloud within one (step 2, second
/// half). Reused from band to band.
class BandPoints {
 public:
  void sort(const PointCloud& cloud, std::span<const PointRun> band);

  /// Of the lattice point `patch_in_band` places after the first one of the band.
  PatchPoints of(std::size_t patch_in_band);

 private:
  std::array<std::uint32_t, kPatchesABand + 1> begin_{}, end_{};  ///< of each patch
  std::size_t room_ = 0;
  std::unique_ptr<float[]> x_, y_, z_;  // not zeroed: every band would pay for it
};

}  // namespace cellmap
