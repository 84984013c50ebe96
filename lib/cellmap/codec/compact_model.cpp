#include "cellmap/codec/compact_model.hpp"

#include <type_traits>

#include "cellmap/codec/first_probabilities.hpp"

namespace cellmap {
namespace {

constexpr double kRangeStep1 = 0.9, kRangeStep2 = 0.7;  // of the bound, by version
constexpr double kSlopeStep = 1.8;                      // of the bound, at the rim of the patch

/// Models from the front of the table, which is in the order in which they lie.
template <typename Part>
void take(std::span<const std::uint8_t>& table, Part& part) {
  static_assert(std::is_standard_layout_v<Part>);
  auto* const bits = reinterpret_cast<BitModel*>(&part);
  constexpr std::size_t kCount = sizeof(Part) / sizeof(BitModel);
  for (std::size_t i = 0; i < kCount; ++i) bits[i] = BitModel(table[i]);
  table = table.subspan(kCount);
}

}  // namespace

std::span<BitModel> bit_models(CompactModels& models) {
  static_assert(std::is_standard_layout_v<CompactModels> && sizeof(BitModel) == 4);
  return {reinterpret_cast<BitModel*>(&models), sizeof(CompactModels) / sizeof(BitModel)};
}

CompactModels first_compact_models(CompactVersion version) {
  CompactModels models;
  const bool is_1 = version == CompactVersion::k1;
  std::span<const std::uint8_t> table = is_1 ? first_probabilities_1() : first_probabilities_2();
  if (!is_1 && table.size() != bit_models(models).size()) return models;  // to be trained
  for (CompactModel& model : models) {
    if (!is_1) {
      take(table, model);
      continue;
    }
    take(table, model.index);
    take(table, model.scale);
    take(table, model.range[0]);
    for (auto& slopes : model.slopes) take(table, slopes[0]);
  }
  return models;
}

StepRule::StepRule(double bound_m, double patch_radius_rad, CompactVersion version)
    : range_((version == CompactVersion::k1 ? kRangeStep1 : kRangeStep2) * bound_m),
      slope_(kSlopeStep * bound_m / patch_radius_rad) {
  for (int scale = kFinestScale; scale <= kCoarsestScale; ++scale) {
    factors_[scale - kFinestScale] = std::ldexp(scale & 1 ? 1.5 : 1.0, scale >> 1);
  }
}

void BatchContext::set(const simd::PatchPredictions& predictions, const StepRule& rule,
                       std::size_t begin, std::size_t end) {
  simd::expect_planes(predictions, rule.facing(), begin, end, expected);
  for (std::size_t k = begin; k < end; ++k) {
    const int agreeing = static_cast<int>(expected.agreeing[k]);
    row[k] = static_cast<std::uint8_t>(agreeing == 0 ? 0 : agreeing / 2 + 1);
    has_two[k] = agreeing >= 2;
    has_outliers[k] = predictions.neighbours[k] > predictions.agreeing[k];
  }
}

int PlaneContext::unexpected(int level) { return level; }

CompactState::CompactState(CodingLattice& coding_lattice, std::size_t planes, double bound_m,
                           CompactVersion coding_version)
    : lattice(coding_lattice),
      version(coding_version),
      models(first_compact_models(version)),
      known(coding_lattice, planes,
            version == CompactVersion::k1 ? PredictionRule::kMean : PredictionRule::kFitted),
      index(coding_lattice) {
  for (const LatticeSphere& sphere : lattice.spheres) {
    rules.emplace_back(bound_m, sphere.patch_radius_rad(), version);
  }
}

}  // namespace cellmap
