#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace cellmap::simd {

/// What decoding a CELL computes for each of its planes, for many patches side by side (FORMAT.md,
/// "Predicted planes" and "Compact planes"). Numbers that are called whole are integers, and every
/// sum of their products is below 2^53, so exact; the others are single IEEE operations in the
/// order of FORMAT.md. So all have the same bits on every instruction set.

constexpr std::size_t kMostPatches = 64;  ///< at once; a multiple of every vector's lanes

/// A number of each patch. Those beyond the last patch are computed too, and mean nothing.
using PatchNumbers = std::array<double, kMostPatches>;
using PatchCounts = std::array<std::int64_t, kMostPatches>;
using PatchVectors = std::array<PatchNumbers, 3>;

/// Directions u of patches and two tangents, t1 horizontal and t2 = u x t1.
struct PatchFrames {
  PatchVectors u{}, t1{}, t2{};
  PatchVectors whole_u{}, whole_t1{}, whole_t2{};  ///< in units of 2^-20
};

/// The rest of the frames from their directions. About 3 ns a patch with AVX2.
void complete_frames(PatchFrames& frames, std::size_t count);

/// Planes around each patch; zeros where there are fewer.
struct PatchNeighbours {
  static constexpr std::size_t kMost = 6;
  /// A plane's inverse-range vector m, whole numbers in units of 2^-28 per metre, and the direction
  /// u of its patch, for `fit_planes`: m.x, m.y, m.z, u.x, u.y, u.z.
  using Numbers = std::array<double, 6>;

  /// Neighbour n of patch k. Three copies of 16 bytes.
  void set(std::size_t n, std::size_t k, const Numbers& numbers) {
    for (std::size_t i = 0; i < 3; ++i) {
      std::copy_n(numbers.data() + 2 * i, 2, pairs[n][i].data() + 2 * k);
    }
  }
  Numbers at(std::size_t n, std::size_t k) const {
    Numbers numbers;
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = pairs[n][i / 2][2 * k + i % 2];
    return numbers;
  }

  /// By neighbour and pair of its numbers: those of patch 0, of patch 1 and so on.
  std::array<std::array<std::array<double, 2 * kMostPatches>, 3>, kMost> pairs{};
};

/// What the planes around a patch say about its own, in its frame: the mean of those that agree, or
/// the plane through their centres. The mean is whole numbers.
struct PatchPredictions {
  PatchNumbers w{}, s1{}, s2{};
  PatchVectors m{};  ///< the same in the CELL's frame
  PatchNumbers neighbours{}, agreeing{};
  PatchNumbers w_spread{}, s_spread{};  ///< sums over those that agree
};

/// Where there are no neighbours only `neighbours` says something. About 12 ns a patch with AVX2.
void predict_planes(const PatchFrames& frames, const PatchNeighbours& around, std::size_t count,
                    PatchPredictions& predictions);

/// The same, but w, slopes and spreads (that of w twice) are of the plane that is fitted to the
/// centres of those that agree (FORMAT.md, "The fitted plane"). Its slopes are held to their mean
/// by `held_rad2`: as much as by centres so far aside, squared. `m` stays that of the mean.
/// Takes 1.6 times as long.
void fit_planes(const PatchFrames& frames, const PatchNeighbours& around, double held_rad2,
                std::size_t count, PatchPredictions& predictions);

/// Lengths of the steps of scales 0 and 1 of a plane that faces the origin, those of slopes at 1 m.
struct FacingSteps {
  std::array<double, 2> range, slope;
};

/// Predictions as ranges and slopes, and what else steps are made of.
struct ExpectedPlanes {
  PatchNumbers range_m{}, s1{}, s2{};
  PatchNumbers secant{};  ///< how far a point moves along its ray for each metre along the normal
  PatchNumbers slope_spread{};  ///< sums over those that agree
  PatchNumbers agreeing{};      ///< at most 5
  /// How often steps of scales 0 and 1 must be doubled to be more than twice the spread of ranges
  /// and than that of slopes, on average; less than 0 where they are to be halved. Steps of slopes
  /// are those in the expected range.
  std::array<PatchCounts, 2> range_doublings{}, slope_doublings{};
};

/// Of the patches from `begin` to `end`, and some around them. About 3 ns a patch with AVX2.
void expect_planes(const PatchPredictions& predictions, const FacingSteps& steps, std::size_t begin,
                   std::size_t end, ExpectedPlanes& expected);

/// Ranges of planes at the centres of their patches, and their slopes there along the tangents.
struct LeaningPlanes {
  PatchNumbers range_m{}, s1{}, s2{};
};

/// Planes as a CELL keeps them, and as later patches see them.
struct RebuiltPlanes {
  std::array<float, kMostPatches> distance_m{};
  std::array<std::array<float, kMostPatches>, 3> normal{};
  PatchVectors m{};        ///< whole, in units of 2^-28 per metre
  PatchNumbers is_seen{};  ///< 1 where `m` is in range, else 0
};

/// Of the patches from `begin` to `end`, and some around them. About 8 ns a patch with AVX2.
void rebuild_planes(const PatchFrames& frames, const LeaningPlanes& planes, std::size_t begin,
                    std::size_t end, RebuiltPlanes& rebuilt);

}  // namespace cellmap::simd
