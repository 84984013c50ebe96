#include "cellmap/codec/compact_planes.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <string>

#include "cellmap/codec/index_coding.hpp"
#include "cellmap/codec/plane_displacement.hpp"
#include "cellmap/codec/plane_prediction.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

// Tuned on simulated and real CELLs; part of the format.
constexpr double kCentreStep = 0.9;     // of the bound
constexpr double kSlopeToCentre = 2.0;  // step of the slopes at the patch's rim to the centre's
constexpr double kCoarser = 0.6;        // the encoder tries scales from here on: half octaves
constexpr int kFinest = -24, kCoarsest = 12;  // scales, half octaves
constexpr int kEscape = -32;
constexpr int kMaxDigits = 24;
constexpr double kMaxStep = 0x1p30;
constexpr int kLevels = 8;

struct CompactModel {
  IndexModel index;
  std::array<IntegerModel, 6> scale;
  std::array<IntegerModel, 4 * kLevels> centre;
  std::array<std::array<IntegerModel, 3 * kLevels>, 2> slopes;
};

struct Steps {
  std::int64_t w = 1, s = 1;
};

/// Steps of a plane's three numbers at each scale.
class StepRule {
 public:
  StepRule(double bound_m, double patch_radius_rad) : slope_(kSlopeToCentre / patch_radius_rad) {
    for (int scale = kFinest; scale <= kCoarsest; ++scale) {
      const int octave = scale >> 1;  // rounded down
      const double factor = std::ldexp(scale & 1 ? 1.5 : 1.0, octave - kInverseRangeBits);
      per_product_[scale - kFinest] = kCentreStep * bound_m * factor;
    }
  }

  /// w |m| of a plane: proportional to how much inverse range a millimetre along its normal is.
  static double product(const PatchPlane& plane) {
    return static_cast<double>(plane.w) * magnitude(plane);
  }

  Steps at(double product, int scale) const {
    const double w = std::clamp(product * per_product_[scale - kFinest], 1.0, kMaxStep);
    return {static_cast<std::int64_t>(w),
            static_cast<std::int64_t>(std::clamp(w * slope_, 1.0, kMaxStep))};
  }

 private:
  double slope_;
  std::array<double, kCoarsest - kFinest + 1> per_product_;
};

/// The multiple of `step` nearest to value.
std::int64_t rounded(std::int64_t value, std::int64_t step) {
  const std::int64_t up = 2 * value + step;
  return up >= 0 ? up / (2 * step) : -((-up + 2 * step - 1) / (2 * step));
}

/// How wide neighbours are spread, in half steps: 0 to kLevels - 1.
int level(std::int64_t spread, std::int64_t step, int count) {
  const auto halves = static_cast<std::uint64_t>(2 * spread / (step * count));
  return std::min<int>(std::bit_width(halves), kLevels - 1);
}

int size_class(std::int64_t value) { return value == 0 ? 0 : std::abs(value) == 1 ? 1 : 2; }

/// The plane that a decoder makes of its coded numbers.
Plane to_plane(const PatchPlane& patch, const InversePlane& m) {
  const auto x = static_cast<double>(m.x), y = static_cast<double>(m.y),
             z = static_cast<double>(m.z);
  const double norm = std::sqrt(x * x + y * y + z * z);
  const double unit = std::ldexp(1.0, kInverseRangeBits);
  return {static_cast<float>(unit / static_cast<double>(patch.w)), static_cast<float>(-x / norm),
          static_cast<float>(-y / norm), static_cast<float>(-z / norm)};
}

/// What is written of a plane.
struct CodedPlane {
  int scale = kEscape;
  std::int64_t w = 0, s1 = 0, s2 = 0;
  std::array<std::uint32_t, 4> raw{};
};

PatchPlane rebuilt(const PatchPlane& predicted, const Steps& steps, const CodedPlane& coded) {
  return {predicted.w + coded.w * steps.w, predicted.s1 + coded.s1 * steps.s,
          predicted.s2 + coded.s2 * steps.s};
}

template <typename Coder>
void code_plane(Coder& coder, CompactModel& model, const PlanePrediction& prediction,
                const StepRule& rule, double product, CodedPlane& coded) {
  const int n = std::min(prediction.agreeing, 5);
  const int outliers = prediction.neighbours > prediction.agreeing;
  IntegerModel& scale_model = model.scale[n == 0 ? 0 : n == 1 ? 1 : 2 + 2 * (n > 3) + outliers];
  coded.scale = static_cast<int>(code_integer(coder, scale_model, 6, coded.scale));
  if (coded.scale == kEscape) {
    for (std::uint32_t& word : coded.raw) word = coder.bits(32, word);
    return;
  }
  if (coded.scale < kFinest || coded.scale > kCoarsest) {
    throw Error(ErrorCode::kCorruptData,
                "a coded plane has the scale " + std::to_string(coded.scale) + ", of -24 to 12");
  }
  const Steps steps = rule.at(product, coded.scale);
  const int row = n == 0 ? 0 : n == 1 ? 1 : n < 4 ? 2 : 3;
  const int count = std::max(n, 1);
  const int w_level =
      n <= 1 ? std::clamp(coded.scale + 3, 0, 7) : level(prediction.w_spread, steps.w, count);
  const int s_level = n <= 1 ? outliers : level(prediction.s_spread, 2 * steps.s, count);
  coded.w = code_integer(coder, model.centre[row * kLevels + w_level], kMaxDigits, coded.w);
  coded.s1 = code_integer(coder, model.slopes[0][size_class(coded.w) * kLevels + s_level],
                          kMaxDigits, coded.s1);
  coded.s2 = code_integer(coder, model.slopes[1][size_class(coded.s1) * kLevels + s_level],
                          kMaxDigits, coded.s2);
}

/// Calls `use(k, frame, patch radius)` for each plane's patch.
template <typename Use>
void visit_patches(const Lattice& lattice, const std::vector<LatticeSphere>& spheres,
                   std::span<const std::uint32_t> indices, const Use& use) {
  constexpr std::size_t kBlock = 256;
  std::array<double, kBlock> x, y, z;
  std::size_t sphere = 0;
  for (std::size_t begin = 0; begin < indices.size(); begin += kBlock) {
    const auto part = indices.subspan(begin, std::min(kBlock, indices.size() - begin));
    lattice.directions(part, x.data(), y.data(), z.data());
    for (std::size_t k = 0; k < part.size(); ++k) {
      while (part[k] >= spheres[sphere].first + spheres[sphere].count) ++sphere;
      use(begin + k, sphere, PatchFrame({x[k], y[k], z[k]}));
    }
  }
}

std::vector<StepRule> step_rules(const std::vector<LatticeSphere>& spheres, double bound_m) {
  std::vector<StepRule> rules;
  for (const LatticeSphere& sphere : spheres) {
    rules.emplace_back(bound_m, sphere.patch_radius_rad());
  }
  return rules;
}

/// Chooses what is written of each plane.
class PlaneEncoder {
 public:
  PlaneEncoder(const PatchFrame& frame, const Plane& plane, const PatchPlane& predicted,
               const StepRule& rule, double radius_rad, double bound_m)
      : frame_(frame),
        plane_(plane),
        predicted_(predicted),
        rule_(rule),
        radius_rad_(radius_rad),
        bound_m_(bound_m) {}

  CodedPlane encode() const {
    CodedPlane coded;
    coded.raw = {std::bit_cast<std::uint32_t>(plane_.distance_m),
                 std::bit_cast<std::uint32_t>(plane_.nx), std::bit_cast<std::uint32_t>(plane_.ny),
                 std::bit_cast<std::uint32_t>(plane_.nz)};
    const Eigen::Vector3d n(plane_.nx, plane_.ny, plane_.nz);
    const Eigen::Vector3d& u = frame_.direction;
    const Eigen::Vector3d m =
        n * (std::ldexp(1.0, kInverseRangeBits) / (n.dot(u) * double{plane_.distance_m}));
    const auto along = [&](const std::array<std::int64_t, 3>& v) {
      return std::ldexp(m.x() * double(v[0]) + m.y() * double(v[1]) + m.z() * double(v[2]),
                        -kDirectionBits);
    };
    const std::array<double, 3> exact = {along(frame_.u), along(frame_.t1), along(frame_.t2)};
    for (const double v : exact) {
      if (!(std::abs(v) < double(kMaxInverseRange))) return coded;
    }
    const PatchPlane source{std::llround(exact[0]), std::llround(exact[1]), std::llround(exact[2])};
    if (!source.is_in_range()) return coded;
    const double product = StepRule::product(predicted_);
    const double ideal = 2 * std::log2(StepRule::product(source) / product);
    // Less than half an octave off does not pay for saying so.
    const bool is_as_predicted = std::abs(ideal) < 1;
    int scale = is_as_predicted ? 0
                                : static_cast<int>(std::lround(
                                      std::clamp<double>(ideal + kCoarser, kFinest, kCoarsest)));
    for (; scale >= kFinest; --scale) {
      CodedPlane candidate = coded;
      candidate.scale = scale;
      const Steps steps = rule_.at(product, scale);
      candidate.w = rounded(source.w - predicted_.w, steps.w);
      candidate.s1 = rounded(source.s1 - predicted_.s1, steps.s);
      candidate.s2 = rounded(source.s2 - predicted_.s2, steps.s);
      if (serves(candidate, steps)) return candidate;
    }
    return coded;
  }

 private:
  bool serves(const CodedPlane& coded, const Steps& steps) const {
    for (const std::int64_t v : {coded.w, coded.s1, coded.s2}) {
      if (std::abs(v) >= std::int64_t{1} << kMaxDigits) return false;
    }
    const PatchPlane patch = rebuilt(predicted_, steps, coded);
    if (!patch.is_in_range()) return false;
    const Plane decoded = to_plane(patch, frame_.to_cell(patch));
    return decoded.distance_m <= 10'000 &&
           plane_displacement_m(plane_, decoded, frame_.direction, radius_rad_) <= bound_m_;
  }

  const PatchFrame& frame_;
  const Plane& plane_;
  const PatchPlane& predicted_;
  const StepRule& rule_;
  double radius_rad_, bound_m_;
};

}  // namespace

Bytes encode_compact_planes(const LatticeSpec& spec, std::span<const std::uint32_t> indices,
                            std::span<const Plane> planes, double bound_m) {
  const Lattice lattice(spec);
  const std::vector<LatticeSphere> spheres = spheres_of(lattice);
  CompactModel model;
  RangeEncoder coder;
  std::vector<std::uint8_t> has_plane(lattice.size());
  for (const std::uint32_t index : indices) has_plane[index] = 1;
  code_index(coder, model.index, spheres, has_plane);
  const std::vector<StepRule> rules = step_rules(spheres, bound_m);
  KnownPlanes known(spheres, planes.size());
  visit_patches(lattice, spheres, indices,
                [&](std::size_t k, std::size_t sphere, const PatchFrame& frame) {
                  known.move_to(indices[k]);
                  const PlanePrediction prediction = known.predict(frame);
                  const double product = StepRule::product(prediction.plane);
                  CodedPlane coded = PlaneEncoder(frame, planes[k], prediction.plane, rules[sphere],
                                                  spheres[sphere].patch_radius_rad(), bound_m)
                                         .encode();
                  code_plane(coder, model, prediction, rules[sphere], product, coded);
                  if (coded.scale == kEscape) return;
                  known.add(frame.to_cell(
                      rebuilt(prediction.plane, rules[sphere].at(product, coded.scale), coded)));
                });
  return std::move(coder).finish();
}

DecodedPlanes decode_compact_planes(const LatticeSpec& spec, std::size_t count,
                                    std::span<const std::byte> bytes, double bound_m) {
  const Lattice lattice(spec);
  const std::vector<LatticeSphere> spheres = spheres_of(lattice);
  CompactModel model;
  RangeDecoder coder(bytes);
  std::vector<std::uint8_t> has_plane(lattice.size());
  code_index(coder, model.index, spheres, has_plane);
  DecodedPlanes result;
  coder.check();
  result.indices = indices_of(has_plane, count);
  const std::vector<StepRule> rules = step_rules(spheres, bound_m);
  KnownPlanes known(spheres, count);
  result.planes.reserve(count);
  visit_patches(lattice, spheres, result.indices,
                [&](std::size_t k, std::size_t sphere, const PatchFrame& frame) {
                  known.move_to(result.indices[k]);
                  const PlanePrediction prediction = known.predict(frame);
                  const double product = StepRule::product(prediction.plane);
                  CodedPlane coded;
                  code_plane(coder, model, prediction, rules[sphere], product, coded);
                  if (coded.scale == kEscape) {
                    result.planes.push_back(
                        {std::bit_cast<float>(coded.raw[0]), std::bit_cast<float>(coded.raw[1]),
                         std::bit_cast<float>(coded.raw[2]), std::bit_cast<float>(coded.raw[3])});
                    return;
                  }
                  const PatchPlane patch =
                      rebuilt(prediction.plane, rules[sphere].at(product, coded.scale), coded);
                  if (!patch.is_in_range())
                    throw Error(ErrorCode::kCorruptData, "a coded plane is out of range");
                  const InversePlane m = frame.to_cell(patch);
                  known.add(m);
                  result.planes.push_back(to_plane(patch, m));
                  if (k % 64 == 0) coder.check();
                });
  coder.finish();
  return result;
}

}  // namespace cellmap
