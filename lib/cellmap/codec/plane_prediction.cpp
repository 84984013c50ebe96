#include "cellmap/codec/plane_prediction.hpp"

#include <algorithm>
#include <cmath>

namespace cellmap {

KnownPlanes::KnownPlanes(CodingLattice& lattice, std::size_t planes, PredictionRule rule)
    : lattice_(lattice),
      memory_(lattice.memory),
      has_high_slots_(planes > UINT16_MAX),
      rule_(rule) {
  memory_.slots.assign(lattice.places, 0);
  if (has_high_slots_) memory_.high_slots.assign(lattice.places, 0);
  memory_.known.reserve(planes + 1);
  memory_.known.assign(1, {});
}

const simd::PatchPredictions& KnownPlanes::predict(const PatchBatch& batch) {
  constexpr std::size_t kUsed = simd::PatchNeighbours::kMost;
  LatticeBelts& belts = lattice_.belts[batch.sphere];
  for (std::size_t k = 0; k < batch.count; ++k) {
    // The first that are known; the others stay slot 0, a plane that counts nowhere.
    std::array<std::uint32_t, LatticeBelts::kNeighbours + 1> slots{};
    std::size_t known = 0;
    const std::uint16_t* const here = memory_.slots.data() + place(batch, k);
    const std::uint8_t* const high =
        has_high_slots_ ? memory_.high_slots.data() + place(batch, k) : nullptr;
    for (const std::int32_t offset : belts.offsets_at(batch.points[k])) {
      slots[known] = here[offset];
      if (high) slots[known] |= std::uint32_t{high[offset]} << 16;
      known += slots[known] != 0;
    }
    for (std::size_t n = 0; n < kUsed; ++n) {
      const auto& [m, u] = memory_.known[slots[n]];
      around_.m[n][0][k] = m.x;
      around_.m[n][1][k] = m.y;
      around_.m[n][2][k] = m.z;
      for (int axis = 0; axis < 3; ++axis) around_.u[n][axis][k] = u[axis];
    }
  }
  if (rule_ == PredictionRule::kMean) {
    simd::predict_planes(batch.frames, around_, batch.count, predictions_);
  } else {
    const double held_rad2 = 2.0 / lattice_.spheres[batch.sphere].size;
    simd::fit_planes(batch.frames, around_, held_rad2, batch.count, predictions_);
  }
  return predictions_;
}

void KnownPlanes::guess(const PatchBatch& batch, std::size_t k) {
  // The last plane's range, seen head on.
  const InversePlane& before = memory_.known.back().m;
  const double last = std::abs(before.x) + std::abs(before.y);
  const double w = std::clamp(last, kMaxInverseRange / 512, kMaxInverseRange - 1);
  predictions_.w[k] = w;
  for (int axis = 0; axis < 3; ++axis) {
    predictions_.m[axis][k] = std::floor(w * batch.frames.whole_u[axis][k] * 0x1p-20);
  }
  for (simd::PatchNumbers* zero : {&predictions_.s1, &predictions_.s2, &predictions_.agreeing,
                                   &predictions_.w_spread, &predictions_.s_spread}) {
    (*zero)[k] = 0;
  }
}

}  // namespace cellmap
