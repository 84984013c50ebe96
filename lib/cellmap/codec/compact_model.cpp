#include "cellmap/codec/compact_model.hpp"

#include <type_traits>

#include "cellmap/codec/first_probabilities.hpp"

namespace cellmap {
namespace {

constexpr double kRangeStep = 0.9;  // of the bound
constexpr double kSlopeStep = 1.8;  // of the bound, at the rim of the patch

}  // namespace

std::span<BitModel> bit_models(CompactModels& models) {
  static_assert(std::is_standard_layout_v<CompactModels> && sizeof(BitModel) == 4);
  return {reinterpret_cast<BitModel*>(&models), sizeof(CompactModels) / sizeof(BitModel)};
}

CompactModels first_compact_models() {
  CompactModels models;
  const std::span<BitModel> bits = bit_models(models);
  const std::span<const std::uint8_t> table = compact_first_probabilities();
  if (table.size() == bits.size()) {
    for (std::size_t i = 0; i < bits.size(); ++i) bits[i] = BitModel(table[i]);
  }
  return models;
}

StepRule::StepRule(double bound_m, double patch_radius_rad)
    : range_(kRangeStep * bound_m), slope_(kSlopeStep * bound_m / patch_radius_rad) {
  for (int scale = kFinestScale; scale <= kCoarsestScale; ++scale) {
    factors_[scale - kFinestScale] = std::ldexp(scale & 1 ? 1.5 : 1.0, scale >> 1);
  }
}

void BatchContext::set(const simd::PatchPredictions& predictions, const StepRule& rule,
                       std::size_t begin, std::size_t end) {
  simd::expect_planes(predictions, begin, end, expected);
  for (std::size_t k = begin; k < end; ++k) {
    const int agree = std::min(static_cast<int>(predictions.agreeing[k]), 5);
    agreeing[k] = static_cast<std::uint8_t>(agree);
    row[k] = static_cast<std::uint8_t>(agree == 0 ? 0 : agree / 2 + 1);
    has_outliers[k] = predictions.neighbours[k] > predictions.agreeing[k];
    const double step = rule.of_slopes(expected.secant[k], 0, expected.range_m[k]);
    const int level = doublings(expected.slope_spread[k], step * agree);
    scale_level[k] = static_cast<std::uint8_t>(agree < 2 ? has_outliers[k] : level);
  }
}

CompactState::CompactState(CodingLattice& coding_lattice, std::size_t planes, double bound_m)
    : lattice(coding_lattice), known(coding_lattice, planes), index(coding_lattice) {
  for (const LatticeSphere& sphere : lattice.spheres) {
    rules.emplace_back(bound_m, sphere.patch_radius_rad());
  }
}

}  // namespace cellmap
