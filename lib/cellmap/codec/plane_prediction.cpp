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
  if (memory_.known.size() <= planes) memory_.known.resize(planes + 1);
  memory_.known[0] = {};
}

template <bool kHasHighSlots>
void KnownPlanes::look_around(const PatchBatch& batch) {
  LatticeBelts& belts = lattice_.belts[batch.sphere];
  for (std::size_t k = 0; k < batch.count; ++k) {
    // The first that are known; the others stay slot 0, a plane that counts nowhere.
    std::array<std::uint32_t, LatticeBelts::kNeighbours + 1> slots{};
    std::size_t known = 0;
    const std::uint16_t* const here = memory_.slots.data() + place(batch, k);
    const std::uint8_t* const high =
        kHasHighSlots ? memory_.high_slots.data() + place(batch, k) : nullptr;
    for (const std::int32_t offset : belts.offsets_at(batch.points[k])) {
      std::uint32_t slot = here[offset];
      if constexpr (kHasHighSlots) slot |= std::uint32_t{high[offset]} << 16;
      slots[known] = slot;
      known += slot != 0;
    }
    for (std::size_t n = 0; n < simd::PatchNeighbours::kMost; ++n) {
      around_.set(n, k, memory_.known[slots[n]]);
    }
  }
}

const simd::PatchPredictions& KnownPlanes::predict(const PatchBatch& batch) {
  has_high_slots_ ? look_around<true>(batch) : look_around<false>(batch);
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
  const simd::PatchNeighbours::Numbers& before = memory_.known[used_slots_ - 1];
  const double last = std::abs(before[0]) + std::abs(before[1]);
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
