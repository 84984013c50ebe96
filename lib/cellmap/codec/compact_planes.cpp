#include "cellmap/codec/compact_planes.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <string>
#include <type_traits>
#include <utility>

#include "cellmap/codec/first_probabilities.hpp"
#include "cellmap/codec/plane_displacement.hpp"
#include "cellmap/codec/plane_prediction.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

// Tuned on simulated and real CELLs; part of the format.
constexpr double kRangeStep = 0.9;  // of the bound
constexpr double kSlopeStep = 1.8;  // of the bound, at the rim of the patch
// The encoder tries scales from kCoarser above the ideal one on, where that is kWorthSaying. Half
// octaves.
constexpr double kCoarser = 1, kWorthSaying = 2.5;
constexpr int kFinest = -24, kCoarsest = 12;  // scales, half octaves
constexpr int kEscape = kFinest - 1;
constexpr int kMaxDigits = 24;
constexpr double kMaxRangeM = 10'000;
constexpr int kLevels = 8;

/// Models of a scale: zero or not, its sign, its magnitude in unary.
struct ScaleModel {
  static constexpr int kDigits = 8;  ///< those after share a model
  BitModel is_zero, is_negative;
  std::array<std::array<BitModel, kDigits>, 2> more;
};

struct CompactModel {
  IndexModel index;
  std::array<ScaleModel, 4 * kLevels> scale;
  std::array<IntegerModel, 4 * kLevels> range;
  std::array<std::array<IntegerModel, 3 * kLevels>, 2> slopes;
};
using CompactModels = std::array<CompactModel, kPlaneLayers>;

constexpr std::size_t kBitModels = sizeof(CompactModels) / sizeof(BitModel);

std::span<BitModel> bit_models(CompactModels& models) {
  static_assert(std::is_standard_layout_v<CompactModels> && sizeof(BitModel) == 4);
  return {reinterpret_cast<BitModel*>(&models), kBitModels};
}

CompactModels first_models() {
  CompactModels models;
  const std::span<const std::uint8_t> table = compact_first_probabilities();
  if (table.size() == kBitModels) {
    for (std::size_t i = 0; i < kBitModels; ++i) bit_models(models)[i] = BitModel(table[i]);
  }
  return models;
}

/// A plane as its patch sees it: the range of its centre, and the slopes of the plane there along
/// the two tangents: the tangents of the angles at which it leans away from facing the origin.
struct LeaningPlane {
  double range_m = 0, s1 = 0, s2 = 0;

  /// How far a point moves along its ray for each metre along the normal.
  double secant() const { return std::sqrt((1 + s1 * s1) + s2 * s2); }
  bool is_valid() const {
    return range_m > 0 && range_m <= kMaxRangeM && std::isfinite(s1) && std::isfinite(s2);
  }
};

/// Steps of a plane's numbers at a scale.
class StepRule {
 public:
  StepRule(double bound_m, double patch_radius_rad)
      : range_(kRangeStep * bound_m), slope_(kSlopeStep * bound_m / patch_radius_rad) {
    for (int scale = kFinest; scale <= kCoarsest; ++scale) {
      factors_[scale - kFinest] = std::ldexp(scale & 1 ? 1.5 : 1.0, scale >> 1);
    }
  }

  double of_range(double secant, int scale) const {
    return range_ * factors_[scale - kFinest] * secant;
  }
  double of_slopes(double secant, int scale, double range_m) const {
    return slope_ * factors_[scale - kFinest] * secant / range_m;
  }

 private:
  double range_, slope_;
  std::array<double, kCoarsest - kFinest + 1> factors_;
};

/// How often `step` must be doubled to be more than `spread`, at most kLevels - 1 times.
int level(double spread, double step) {
  int doubled = 0;
  while (doubled < kLevels - 1 && spread >= step) {
    step *= 2;
    ++doubled;
  }
  return doubled;
}

int size_class(std::int64_t value) { return value == 0 ? 0 : std::abs(value) == 1 ? 1 : 2; }

/// The plane that a decoder makes of its numbers.
Plane to_plane(const PatchFrame& frame, const LeaningPlane& p) {
  const auto& [t1, t2] = frame.tangents;
  std::array<double, 3> n;
  for (int i = 0; i < 3; ++i) n[i] = (frame.direction[i] + p.s1 * t1[i]) + p.s2 * t2[i];
  const double scale = -1 / std::sqrt((n[0] * n[0] + n[1] * n[1]) + n[2] * n[2]);
  return {static_cast<float>(p.range_m), static_cast<float>(n[0] * scale),
          static_cast<float>(n[1] * scale), static_cast<float>(n[2] * scale)};
}

/// As later patches see it; not in range where it is too near or leans too far.
PatchPlane inverse(const LeaningPlane& p) {
  const double w = kInverseRangeUnit / p.range_m;
  const double s1 = p.s1 * w, s2 = p.s2 * w;
  const auto is_small = [](double v) { return std::abs(v) < double(kMaxInverseRange); };
  if (!is_small(w) || !is_small(s1) || !is_small(s2)) return {};
  return {floor_of(w + 0.5), floor_of(s1 + 0.5), floor_of(s2 + 0.5)};
}

/// What is written of a plane.
struct CodedPlane {
  int scale = kEscape;
  std::int64_t range = 0, s1 = 0, s2 = 0;  ///< steps from the prediction
  std::array<std::uint32_t, 4> raw{};
};

/// What a plane is coded with.
class PlaneContext {
 public:
  PlaneContext(const PlanePrediction& prediction, const StepRule& rule)
      : rule_(rule),
        agreeing_(std::min(prediction.agreeing, 5)),
        has_outliers_(prediction.neighbours > prediction.agreeing) {
    const double per_w = 1 / static_cast<double>(prediction.plane.w);
    expected_ = {kInverseRangeUnit * per_w, static_cast<double>(prediction.plane.s1) * per_w,
                 static_cast<double>(prediction.plane.s2) * per_w};
    secant_ = expected_.secant();
    range_spread_ = static_cast<double>(prediction.w_spread) * expected_.range_m * per_w;
    slope_spread_ = static_cast<double>(prediction.s_spread) * per_w;
  }

  const LeaningPlane& expected() const { return expected_; }
  double secant() const { return secant_; }
  double range_step(int scale) const { return rule_.of_range(secant_, scale); }
  double slope_step(int scale, double range_m) const {
    return rule_.of_slopes(secant_, scale, range_m);
  }

  /// By how many neighbours agree: 0 to 3.
  int row() const { return agreeing_ < 2 ? agreeing_ : agreeing_ < 4 ? 2 : 3; }
  /// By how far neighbours that agree are apart, in steps: 0 to kLevels - 1.
  int scale_level() const { return slope_level(slope_step(0, expected_.range_m)); }
  int range_level(int scale) const {
    if (agreeing_ < 2) return std::clamp(scale + 3, 0, kLevels - 1);
    return level(2 * range_spread_, range_step(scale) * agreeing_);
  }
  int slope_level(double step) const {
    return agreeing_ < 2 ? has_outliers_ : level(slope_spread_, step * agreeing_);
  }

  double range_m(const CodedPlane& coded) const {
    return expected_.range_m + static_cast<double>(coded.range) * range_step(coded.scale);
  }
  LeaningPlane rebuilt(const CodedPlane& coded) const {
    LeaningPlane p;
    p.range_m = range_m(coded);
    const double step = slope_step(coded.scale, p.range_m);
    p.s1 = expected_.s1 + static_cast<double>(coded.s1) * step;
    p.s2 = expected_.s2 + static_cast<double>(coded.s2) * step;
    return p;
  }

 private:
  const StepRule& rule_;
  LeaningPlane expected_;
  double secant_ = 1;
  int agreeing_;
  bool has_outliers_;
  double range_spread_ = 0, slope_spread_ = 0;  ///< sums over those that agree
};

template <typename Coder>
int code_scale(Coder& coder, ScaleModel& model, int scale) {
  if (coder.bit(model.is_zero, scale == 0)) return 0;
  const bool is_negative = coder.bit(model.is_negative, scale < 0);
  const int largest = is_negative ? -kEscape : kCoarsest;
  int read = 1;
  while (read < largest &&
         coder.bit(model.more[is_negative][std::min(read, ScaleModel::kDigits) - 1],
                   std::abs(scale) > read)) {
    ++read;
  }
  return is_negative ? -read : read;
}

template <typename Coder>
void code_plane(Coder& coder, CompactModel& model, const PlaneContext& context, CodedPlane& coded) {
  const int rows = context.row() * kLevels;
  coded.scale = code_scale(coder, model.scale[rows + context.scale_level()], coded.scale);
  if (coded.scale == kEscape) {
    for (std::uint32_t& word : coded.raw) word = coder.bits(32, word);
    return;
  }
  coded.range = code_integer(coder, model.range[rows + context.range_level(coded.scale)],
                             kMaxDigits, coded.range);
  const int row =
      context.slope_level(std::abs(context.slope_step(coded.scale, context.range_m(coded))));
  coded.s1 = code_integer(coder, model.slopes[0][size_class(coded.range) * kLevels + row],
                          kMaxDigits, coded.s1);
  coded.s2 = code_integer(coder, model.slopes[1][size_class(coded.s1) * kLevels + row], kMaxDigits,
                          coded.s2);
}

/// Chooses what is written of each plane.
class PlaneEncoder {
 public:
  PlaneEncoder(const PatchFrame& frame, const Plane& plane, const PlaneContext& context,
               double radius_rad, double bound_m)
      : frame_(frame),
        plane_(plane),
        context_(context),
        radius_rad_(radius_rad),
        bound_m_(bound_m) {}

  CodedPlane encode() const {
    CodedPlane coded;
    coded.raw = {std::bit_cast<std::uint32_t>(plane_.distance_m),
                 std::bit_cast<std::uint32_t>(plane_.nx), std::bit_cast<std::uint32_t>(plane_.ny),
                 std::bit_cast<std::uint32_t>(plane_.nz)};
    const Eigen::Vector3d n(plane_.nx, plane_.ny, plane_.nz);
    const auto slope = [&](const std::array<double, 3>& t) {
      return (n.x() * t[0] + n.y() * t[1] + n.z() * t[2]) / n.dot(frame_.direction);
    };
    const LeaningPlane source{plane_.distance_m, slope(frame_.tangents[0]),
                              slope(frame_.tangents[1])};
    const double ideal = 2 * std::log2(source.secant() / context_.secant());
    // Less than an octave coarser does not pay for saying so.
    int scale = ideal < kWorthSaying
                    ? 0
                    : static_cast<int>(std::lround(std::min<double>(ideal + kCoarser, kCoarsest)));
    for (; scale >= kFinest; --scale) {
      CodedPlane candidate = coded;
      candidate.scale = scale;
      if (round_at(source, candidate) && serves(candidate)) return candidate;
    }
    return coded;
  }

 private:
  static bool round(double value, double step, std::int64_t& steps) {
    const double exact = value / step;
    if (!(std::abs(exact) < (1 << kMaxDigits) - 1)) return false;
    steps = std::llround(exact);
    return true;
  }
  bool round_at(const LeaningPlane& source, CodedPlane& coded) const {
    const LeaningPlane& expected = context_.expected();
    const double step = context_.range_step(coded.scale);
    if (!round(source.range_m - expected.range_m, step, coded.range)) return false;
    const double range_m = context_.range_m(coded);
    if (!(range_m > 0)) return false;
    const double slope_step = context_.slope_step(coded.scale, range_m);
    return round(source.s1 - expected.s1, slope_step, coded.s1) &&
           round(source.s2 - expected.s2, slope_step, coded.s2);
  }
  bool serves(const CodedPlane& coded) const {
    const LeaningPlane rebuilt = context_.rebuilt(coded);
    if (!rebuilt.is_valid()) return false;
    return plane_displacement_m(plane_, to_plane(frame_, rebuilt), frame_.direction, radius_rad_) <=
           bound_m_;
  }

  const PatchFrame& frame_;
  const Plane& plane_;
  const PlaneContext& context_;
  double radius_rad_, bound_m_;
};

/// What is kept from plane to plane.
struct CompactState {
  CompactState(CodingLattice& coding_lattice, std::size_t planes, double bound_m)
      : lattice(coding_lattice), known(coding_lattice, planes), index(coding_lattice) {
    for (const LatticeSphere& sphere : lattice.spheres) {
      rules.emplace_back(bound_m, sphere.patch_radius_rad());
    }
  }

  CodingLattice& lattice;
  CompactModels models = first_models();
  KnownPlanes known;
  CodedIndex index;
  std::vector<StepRule> rules;  ///< of each sphere
};

/// Counts instead of writing.
class BitCounter {
 public:
  BitCounter(CompactModels& models, BitCounts& counts)
      : first_(bit_models(models).data()), counts_(counts) {
    counts_.resize(kBitModels);
  }
  bool bit(BitModel& model, bool value) {
    ++counts_[static_cast<std::size_t>(&model - first_)][value];
    model.learn(value);
    return value;
  }
  std::uint32_t bits(int, std::uint32_t value) { return value; }

 private:
  const BitModel* first_;
  BitCounts& counts_;
};

void add(KnownPlanes& known, const PatchFrame& frame, const LeaningPlane& plane) {
  const PatchPlane seen = inverse(plane);
  if (seen.is_in_range()) known.add(frame.to_cell(seen));
}

template <typename Coder>
std::size_t encode_layer(Coder& coder, CompactState& state, int layer,
                         std::span<const std::uint32_t> indices, std::span<const Plane> planes,
                         double bound_m) {
  CompactModel& model = state.models[static_cast<std::size_t>(layer)];
  code_index(coder, model.index, state.lattice, layer, state.index);
  std::size_t count = 0;
  visit_patches(state.lattice, indices, [&](std::size_t k, const Patch& patch) {
    if (layer_of(patch.point) != layer) return;
    ++count;
    const StepRule& rule = state.rules[patch.sphere];
    state.known.move_to(patch.sphere, patch.point);
    const PlaneContext context(state.known.predict(patch.frame), rule);
    CodedPlane coded = PlaneEncoder(patch.frame, planes[k], context,
                                    state.lattice.spheres[patch.sphere].patch_radius_rad(), bound_m)
                           .encode();
    code_plane(coder, model, context, coded);
    if (coded.scale == kEscape) return;
    add(state.known, patch.frame, context.rebuilt(coded));
  });
  return count;
}

Plane decode_plane(RangeDecoder& coder, CompactState& state, CompactModel& model,
                   const Patch& patch) {
  const StepRule& rule = state.rules[patch.sphere];
  state.known.move_to(patch.sphere, patch.point);
  const PlaneContext context(state.known.predict(patch.frame), rule);
  CodedPlane coded;
  code_plane(coder, model, context, coded);
  if (coded.scale == kEscape) {
    return {std::bit_cast<float>(coded.raw[0]), std::bit_cast<float>(coded.raw[1]),
            std::bit_cast<float>(coded.raw[2]), std::bit_cast<float>(coded.raw[3])};
  }
  const LeaningPlane plane = context.rebuilt(coded);
  if (!plane.is_valid()) throw Error(ErrorCode::kCorruptData, "a coded plane is out of range");
  add(state.known, patch.frame, plane);
  return to_plane(patch.frame, plane);
}

std::size_t planes_in(std::span<const LayerView> layers) {
  std::size_t planes = 0;
  for (const LayerView& layer : layers) planes += layer.planes;
  return planes;
}

CompactState state_to_encode(CodingLattice& lattice, std::span<const std::uint32_t> indices,
                             double bound_m) {
  CompactState state(lattice, indices.size(), bound_m);
  for (const std::uint32_t index : indices) state.index.has_plane[index] = 1;
  return state;
}

}  // namespace

CodedLayers encode_compact_planes(CodingLattice& lattice, std::span<const std::uint32_t> indices,
                                  std::span<const Plane> planes, double bound_m) {
  CompactState state = state_to_encode(lattice, indices, bound_m);
  CodedLayers layers;
  for (int layer = 0; layer < kPlaneLayers; ++layer) {
    RangeEncoder coder;
    layers[layer].planes = encode_layer(coder, state, layer, indices, planes, bound_m);
    layers[layer].bytes = std::move(coder).finish();
  }
  return layers;
}

void count_compact_bits(CodingLattice& lattice, std::span<const std::uint32_t> indices,
                        std::span<const Plane> planes, double bound_m, BitCounts& counts) {
  CompactState state = state_to_encode(lattice, indices, bound_m);
  BitCounter counter(state.models, counts);
  for (int layer = 0; layer < kPlaneLayers; ++layer) {
    encode_layer(counter, state, layer, indices, planes, bound_m);
  }
}

DecodedPlanes decode_compact_planes(CodingLattice& lattice, std::span<const LayerView> layers,
                                    double bound_m) {
  CompactState state(lattice, planes_in(layers), bound_m);
  DecodedPlanes result;
  for (std::size_t layer = 0; layer < layers.size(); ++layer) {
    CompactModel& model = state.models[layer];
    RangeDecoder coder(layers[layer].bytes);
    code_index(coder, model.index, lattice, static_cast<int>(layer), state.index);
    coder.check();
    DecodedPlanes decoded;
    decoded.indices = std::move(state.index.of_layer);
    check_count(decoded.indices, layers[layer].planes);
    decoded.planes.reserve(decoded.indices.size());
    visit_patches(lattice, decoded.indices, [&](std::size_t k, const Patch& patch) {
      decoded.planes.push_back(decode_plane(coder, state, model, patch));
      if (k % 64 == 0) coder.check();
    });
    coder.finish();
    merge_layer(result, std::move(decoded));
  }
  return result;
}

}  // namespace cellmap
