#include "cellmap/simd/turned_views.hpp"

// Compiles the rest of this file once for each instruction set.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "cellmap/simd/turned_views.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace cellmap::simd::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kViews = TurnedViews::kViews, kTurns = TurnedViews::kTurns;
using F = hn::CappedTag<float, kViews>;
using VF = hn::Vec<F>;

/// Of each harmonic, the stored view times the conjugate of each of the others.
void multiply(const TurnedViews& views, const float* cosine, const float* sine, std::size_t first,
              std::size_t harmonics, VF* even, VF* odd) {
  const F f;
  for (std::size_t k = 0; k < harmonics; ++k) {
    VF e = hn::Zero(f), o = hn::Zero(f);
    for (std::size_t i = k * views.rows; i < (k + 1) * views.rows; ++i) {
      const VF c = hn::Set(f, cosine[i]), s = hn::Set(f, sine[i]);
      const VF vc = hn::LoadU(f, &views.cosine[i * kViews + first]);
      const VF vs = hn::LoadU(f, &views.sine[i * kViews + first]);
      e = hn::Add(e, hn::Add(hn::Mul(c, vc), hn::Mul(s, vs)));
      o = hn::Add(o, hn::Sub(hn::Mul(c, vs), hn::Mul(s, vc)));
    }
    even[k] = e;
    odd[k] = o;
  }
}

void CorrelateTurned(const TurnedViews& views, const float* cosine, const float* sine,
                     std::size_t harmonics, float* best) {
  const F f;
  VF even[TurnedViews::kMostHarmonics], odd[TurnedViews::kMostHarmonics];
  for (std::size_t t = 0; t < kTurns; ++t) best[t] = -2.0f;
  for (std::size_t first = 0; first < views.views; first += hn::Lanes(f)) {
    multiply(views, cosine, sine, first, harmonics, even, odd);
    // Turns to either side have the same cosines and opposite sines.
    for (std::size_t t = 0; t <= kTurns / 2; ++t) {
      VF a = hn::Zero(f), b = hn::Zero(f);
      for (std::size_t k = 0; k < harmonics; ++k) {
        a = hn::Add(a, hn::Mul(even[k], hn::Set(f, views.cosine_of_turn[k * kTurns + t])));
        b = hn::Add(b, hn::Mul(odd[k], hn::Set(f, views.sine_of_turn[k * kTurns + t])));
      }
      const std::size_t opposite = (kTurns - t) % kTurns;
      best[t] = HWY_MAX(best[t], hn::GetLane(hn::MaxOfLanes(f, hn::Sub(a, b))));
      best[opposite] = HWY_MAX(best[opposite], hn::GetLane(hn::MaxOfLanes(f, hn::Add(a, b))));
    }
  }
}

float BestTurned(const TurnedViews& views, const float* cosine, const float* sine,
                 std::size_t harmonics) {
  const F f;
  VF even[TurnedViews::kMostHarmonics], odd[TurnedViews::kMostHarmonics];
  VF best = hn::Set(f, -2.0f);
  for (std::size_t first = 0; first < views.views; first += hn::Lanes(f)) {
    multiply(views, cosine, sine, first, harmonics, even, odd);
    for (std::size_t t = 0; t <= kTurns / 2; ++t) {
      VF a = hn::Zero(f), b = hn::Zero(f);
      for (std::size_t k = 0; k < harmonics; ++k) {
        a = hn::Add(a, hn::Mul(even[k], hn::Set(f, views.cosine_of_turn[k * kTurns + t])));
        b = hn::Add(b, hn::Mul(odd[k], hn::Set(f, views.sine_of_turn[k * kTurns + t])));
      }
      best = hn::Max(best, hn::Max(hn::Sub(a, b), hn::Add(a, b)));
    }
  }
  return hn::GetLane(hn::MaxOfLanes(f, best));
}

}  // namespace
}  // namespace cellmap::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace cellmap::simd {

HWY_EXPORT(CorrelateTurned);
HWY_EXPORT(BestTurned);

void correlate_turned(const TurnedViews& views, const float* cosine, const float* sine,
                      std::size_t harmonics, std::array<float, TurnedViews::kTurns>& best) {
  HWY_DYNAMIC_DISPATCH(CorrelateTurned)(views, cosine, sine, harmonics, best.data());
}

float best_turned(const TurnedViews& views, const float* cosine, const float* sine,
                  std::size_t harmonics) {
  return HWY_DYNAMIC_DISPATCH(BestTurned)(views, cosine, sine, harmonics);
}

}  // namespace cellmap::simd
#endif
