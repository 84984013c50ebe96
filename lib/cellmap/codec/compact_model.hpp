#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "cellmap/codec/compact_planes.hpp"
#include "cellmap/codec/index_coding.hpp"
#include "cellmap/codec/plane_prediction.hpp"
#include "cellmap/codec/range_coder.hpp"

namespace cellmap {

// What writer and reader of compact planes share (FORMAT.md, "Compact planes"). All numbers here
// are part of the format; they were tuned on simulated and real CELLs.

constexpr int kContextLevels = 8;
constexpr int kMaxStepDigits = 24;
constexpr double kMaxCompactRangeM = 10'000;

/// Of the steps, in half octaves. The scale after the finest says that a plane is kept as it is.
constexpr int kFinestScale = -24, kCoarsestScale = 12, kEscapeScale = kFinestScale - 1;

/// Models of a scale: zero or not, its sign, its magnitude in unary.
struct ScaleModel {
  static constexpr int kDigits = 8;  ///< those after share a model
  BitModel is_zero, is_negative;
  std::array<std::array<BitModel, kDigits>, 2> more;
};

/// Version 1 has the models of nominal steps for all.
struct CompactModel {
  using RangeModels = std::array<IntegerModel, std::size_t{4} * kContextLevels>;
  using SlopeModels = std::array<IntegerModel, std::size_t{3} * kContextLevels>;
  IndexModel index;
  std::array<ScaleModel, std::size_t{4} * kContextLevels> scale;
  std::array<RangeModels, 3> range;  ///< by kind of steps: nominal, finer, coarser
  std::array<std::array<SlopeModels, 3>, 2> slopes;
};
using CompactModels = std::array<CompactModel, kPlaneLayers>;

/// All models, in the order of version 2's table of first probabilities.
std::span<BitModel> bit_models(CompactModels& models);
CompactModels first_compact_models(CompactVersion version);

/// A plane as its patch sees it: the range of its centre, and the slopes of the plane there along
/// the two tangents: the tangents of the angles at which it leans away from facing the origin.
struct LeaningPlane {
  double range_m = 0, s1 = 0, s2 = 0;

  /// How far a point moves along its ray for each metre along the normal.
  double secant() const { return std::sqrt((1 + s1 * s1) + s2 * s2); }
  bool is_valid() const {
    return range_m > 0 && range_m <= kMaxCompactRangeM && std::isfinite(s1) && std::isfinite(s2);
  }
};

/// Steps of a plane's numbers at a scale.
class StepRule {
 public:
  StepRule(double bound_m, double patch_radius_rad, CompactVersion version);

  double of_range(double secant, int scale) const {
    return range_ * factors_[scale - kFinestScale] * secant;
  }
  double of_slopes(double secant, int scale, double range_m) const {
    return slope_ * factors_[scale - kFinestScale] * secant / range_m;
  }
  simd::FacingSteps facing() const {
    const double one = factors_[1 - kFinestScale];  // that of scale 0 is 1
    return {{range_, range_ * one}, {slope_, slope_ * one}};
  }

 private:
  double range_, slope_;
  std::array<double, kCoarsestScale - kFinestScale + 1> factors_;
};

/// How often `step` must be doubled to be more than `spread`, as simd::expect_planes counts.
inline int doublings(double spread, double step) {
  const auto by = std::bit_cast<std::int64_t>(spread) - std::bit_cast<std::int64_t>(step);
  return static_cast<int>(by >> 52) + 1;
}

constexpr int level_of(std::int64_t doublings) {
  return static_cast<int>(std::clamp<std::int64_t>(doublings, 0, kContextLevels - 1));
}

/// Of a scale: which models code what is counted in its steps.
constexpr std::size_t kind_of_steps(int scale) { return scale == 0 ? 0 : scale < 0 ? 1 : 2; }

/// What is written of a plane.
struct CodedPlane {
  int scale = kEscapeScale;
  std::int64_t range = 0, s1 = 0, s2 = 0;  ///< steps from the prediction
  std::array<std::uint32_t, 4> raw{};
};

/// What the planes of a batch are coded with. Known before a plane's first number is, so that
/// nothing waits for it.
struct BatchContext {
  simd::ExpectedPlanes expected;
  std::array<std::uint8_t, simd::kMostPatches> row;  ///< by how many neighbours agree: 0 to 3
  std::array<bool, simd::kMostPatches> has_two;      ///< or more that agree
  std::array<bool, simd::kMostPatches> has_outliers;

  /// Of the patches from `begin` to `end`.
  void set(const simd::PatchPredictions& predictions, const StepRule& rule, std::size_t begin,
           std::size_t end);
};

/// What one plane is coded with.
class PlaneContext {
 public:
  PlaneContext(const BatchContext& batch, std::size_t k, const StepRule& rule)
      : batch_(batch), k_(k), rule_(rule) {}

  LeaningPlane expected() const {
    return {batch_.expected.range_m[k_], batch_.expected.s1[k_], batch_.expected.s2[k_]};
  }
  double secant() const { return batch_.expected.secant[k_]; }
  double range_step(int scale) const { return rule_.of_range(secant(), scale); }
  double slope_step(int scale, double range_m) const {
    return rule_.of_slopes(secant(), scale, range_m);
  }

  /// By how many neighbours agree: 0 to 3.
  int row() const { return batch_.row[k_]; }
  // By how far neighbours that agree are apart, in steps: 0 to kContextLevels - 1. Steps of scale s
  // are 2^(s >> 1) times as long as those of s & 1.
  int scale_level() const { return expected_slope_level(0); }
  int range_level(int scale) const {
    if (!batch_.has_two[k_]) return level_of(scale + 3);
    return level_of(batch_.expected.range_doublings[scale & 1][k_] - (scale >> 1));
  }
  int slope_level(const CodedPlane& coded) const {
    const int expected = expected_slope_level(coded.scale);
    if (coded.range == 0 || !batch_.has_two[k_]) return expected;
    const double step = std::abs(slope_step(coded.scale, range_m(coded)));
    const int level =
        level_of(doublings(batch_.expected.slope_spread[k_], step * batch_.expected.agreeing[k_]));
    // Nearly always the same, and then nothing waits for the division.
    if (level != expected) [[unlikely]]
      return unexpected(level);
    return expected;
  }

  double range_m(const CodedPlane& coded) const {
    return expected().range_m + static_cast<double>(coded.range) * range_step(coded.scale);
  }
  LeaningPlane rebuilt(const CodedPlane& coded) const {
    LeaningPlane p = expected();
    p.range_m = range_m(coded);
    const double step = slope_step(coded.scale, p.range_m);
    p.s1 += static_cast<double>(coded.s1) * step;
    p.s2 += static_cast<double>(coded.s2) * step;
    return p;
  }

 private:
  /// For a plane in the expected range.
  int expected_slope_level(int scale) const {
    if (!batch_.has_two[k_]) return batch_.has_outliers[k_];
    return level_of(batch_.expected.slope_doublings[scale & 1][k_] - (scale >> 1));
  }
  /// A call, so that the processor goes on with what is expected instead of a conditional move.
  [[gnu::noinline, gnu::cold]] static int unexpected(int level);

  const BatchContext& batch_;
  std::size_t k_;
  const StepRule& rule_;
};

template <typename Coder>
[[gnu::always_inline]] inline int code_scale(Coder& coder, ScaleModel& model, int scale) {
  if (coder.bit(model.is_zero, scale == 0)) return 0;
  const bool is_negative = coder.bit(model.is_negative, scale < 0);
  const int largest = is_negative ? -kEscapeScale : kCoarsestScale;
  int read = 1;
  while (read < largest &&
         coder.bit(model.more[is_negative][std::min(read, ScaleModel::kDigits) - 1],
                   std::abs(scale) > read)) {
    ++read;
  }
  return is_negative ? -read : read;
}

template <typename Coder>
[[gnu::always_inline]] inline void code_plane(Coder& coder, CompactModel& model,
                                              CompactVersion version, const PlaneContext& context,
                                              CodedPlane& coded) {
  const int rows = context.row() * kContextLevels;
  coded.scale = code_scale(coder, model.scale[rows + context.scale_level()], coded.scale);
  if (coded.scale == kEscapeScale) {
    for (std::uint32_t& word : coded.raw) word = coder.bits(32, word);
    return;
  }
  const std::size_t kind = version == CompactVersion::k1 ? 0 : kind_of_steps(coded.scale);
  const CodedInteger range =
      code_integer(coder, model.range[kind][rows + context.range_level(coded.scale)],
                   kMaxStepDigits, coded.range);
  coded.range = range.value;
  const int row = context.slope_level(coded);
  const CodedInteger s1 = code_integer(
      coder, model.slopes[0][kind][range.size * kContextLevels + row], kMaxStepDigits, coded.s1);
  coded.s1 = s1.value;
  coded.s2 = code_integer(coder, model.slopes[1][kind][s1.size * kContextLevels + row],
                          kMaxStepDigits, coded.s2)
                 .value;
}

/// What is kept from plane to plane.
struct CompactState {
  CompactState(CodingLattice& coding_lattice, std::size_t planes, double bound_m,
               CompactVersion coding_version);

  CodingLattice& lattice;
  CompactVersion version;
  CompactModels models;
  KnownPlanes known;
  CodedIndex index;
  std::vector<StepRule> rules;  ///< of each sphere
};

/// The planes of a batch as a decoder makes them of their numbers.
class RebuiltBatch {
 public:
  /// Of patch k; not to be settled where its plane is kept as it is.
  void set(std::size_t k, const LeaningPlane& plane) {
    leaning_.range_m[k] = plane.range_m;
    leaning_.s1[k] = plane.s1;
    leaning_.s2[k] = plane.s2;
  }
  void rebuild(const PatchBatch& batch, std::size_t begin, std::size_t end) {
    simd::rebuild_planes(batch.frames, leaning_, begin, end, rebuilt_);
  }

  Plane plane(std::size_t k) const {
    return {rebuilt_.distance_m[k], rebuilt_.normal[0][k], rebuilt_.normal[1][k],
            rebuilt_.normal[2][k]};
  }
  /// Lets later patches see the plane, but for one that is too near or leans too far.
  void add_to(KnownPlanes& known, const PatchBatch& batch, std::size_t k) const {
    if (rebuilt_.is_seen[k] == 0) return;
    known.add(batch, k, {rebuilt_.m[0][k], rebuilt_.m[1][k], rebuilt_.m[2][k]});
  }

 private:
  simd::LeaningPlanes leaning_;
  simd::RebuiltPlanes rebuilt_;
};

}  // namespace cellmap
