#include "cellmap/simd/patch_planes.hpp"

// Compiles the rest of this file once for each instruction set.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "cellmap/simd/patch_planes.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace cellmap::simd::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<double, kMostPatches>;
using VD = hn::Vec<D>;
using MD = hn::Mask<D>;

constexpr double kLimit = 0x1p30;             // of inverse ranges
constexpr double kInverseRangeUnit = 0x1p28;  // one per metre

HWY_INLINE VD constant(double value) { return hn::Set(D(), value); }
HWY_INLINE VD load(const PatchNumbers& numbers, std::size_t k) {
  return hn::LoadU(D(), numbers.data() + k);
}
HWY_INLINE void store(VD value, PatchNumbers& numbers, std::size_t k) {
  hn::StoreU(value, D(), numbers.data() + k);
}

struct Vector {
  VD x, y, z;
};
HWY_INLINE Vector load(const PatchVectors& v, std::size_t k) {
  return {load(v[0], k), load(v[1], k), load(v[2], k)};
}
HWY_INLINE void store(const Vector& value, PatchVectors& v, std::size_t k) {
  store(value.x, v[0], k);
  store(value.y, v[1], k);
  store(value.z, v[2], k);
}

/// v / 2^20, rounded down, of a whole number.
HWY_INLINE VD shifted(VD v) { return hn::Floor(hn::Mul(v, constant(0x1p-20))); }

HWY_INLINE VD to_whole(VD v, double unit) {
  return hn::Floor(hn::Add(hn::Mul(v, constant(unit)), constant(0.5)));
}
HWY_INLINE Vector to_whole(const Vector& v) {
  return {to_whole(v.x, 0x1p20), to_whole(v.y, 0x1p20), to_whole(v.z, 0x1p20)};
}

/// From left to right.
HWY_INLINE VD dot(const Vector& a, const Vector& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}

/// What PatchNeighbours::Numbers are.
struct Neighbour {
  Vector m, u;
};
HWY_INLINE Neighbour load(const PatchNeighbours& around, std::size_t n, std::size_t k) {
  Neighbour neighbour;
  const auto load_pair = [&](std::size_t pair, VD& a, VD& b) {
    hn::LoadInterleaved2(D(), around.pairs[n][pair].data() + 2 * k, a, b);
  };
  load_pair(0, neighbour.m.x, neighbour.m.y);
  load_pair(1, neighbour.m.z, neighbour.u.x);
  load_pair(2, neighbour.u.y, neighbour.u.z);
  return neighbour;
}

/// A plane in the frame of its patch.
struct Seen {
  VD w, s1, s2;
};

struct Frame {
  Vector u, t1, t2;  // whole; t1 has no z
  HWY_INLINE Frame(const PatchFrames& frames, std::size_t k)
      : u(load(frames.whole_u, k)), t1(load(frames.whole_t1, k)), t2(load(frames.whole_t2, k)) {}

  HWY_INLINE Seen to_patch(const Vector& m) const {
    return {shifted(dot(m, u)), shifted(hn::Add(hn::Mul(m.x, t1.x), hn::Mul(m.y, t1.y))),
            shifted(dot(m, t2))};
  }
  HWY_INLINE Vector to_cell(const Seen& p) const {
    const auto along = [&](VD a, VD b, VD c) { return shifted(dot({p.w, p.s1, p.s2}, {a, b, c})); };
    return {along(u.x, t1.x, t2.x), along(u.y, t1.y, t2.y),
            shifted(hn::Add(hn::Mul(p.w, u.z), hn::Mul(p.s2, t2.z)))};
  }
};

HWY_INLINE MD is_small(VD v) { return hn::Lt(hn::Abs(v), constant(kLimit)); }

HWY_INLINE MD is_in_range(const Seen& p) {
  return hn::And(hn::And(hn::Gt(p.w, constant(0)), is_small(p.w)),
                 hn::And(is_small(p.s1), is_small(p.s2)));
}

HWY_INLINE void complete_at(std::size_t k, PatchFrames& frames) {
  const Vector u = load(frames.u, k);
  const VD zero = constant(0);
  const VD across = hn::Sqrt(hn::Add(hn::Mul(u.x, u.x), hn::Mul(u.y, u.y)));
  const MD is_pole = hn::Not(hn::Gt(across, zero));
  const Vector t1 = {hn::IfThenElse(is_pole, constant(1), hn::Div(hn::Neg(u.y), across)),
                     hn::IfThenElse(is_pole, zero, hn::Div(u.x, across)), zero};
  const Vector t2 = {hn::Mul(hn::Neg(u.z), t1.y), hn::Mul(u.z, t1.x),
                     hn::Sub(hn::Mul(u.x, t1.y), hn::Mul(u.y, t1.x))};
  store(t1, frames.t1, k);
  store(t2, frames.t2, k);
  store(to_whole(u), frames.whole_u, k);
  store(to_whole(t1), frames.whole_t1, k);
  store(to_whole(t2), frames.whole_t2, k);
}

/// The one at place floor(count / 2) of numbers in ascending order, those beyond `count` being
/// larger than all others.
HWY_INLINE VD median_of(VD (&w)[PatchNeighbours::kMost], VD count) {
  VD v[PatchNeighbours::kMost];
  for (std::size_t n = 0; n < PatchNeighbours::kMost; ++n) v[n] = w[n];
  const auto order = [&](int a, int b) {
    const VD low = hn::Min(v[a], v[b]), high = hn::Max(v[a], v[b]);
    v[a] = low;
    v[b] = high;
  };
  // A sorting network.
  order(0, 5), order(1, 3), order(2, 4);
  order(1, 2), order(3, 4);
  order(0, 3), order(2, 5);
  order(0, 1), order(2, 3), order(4, 5);
  order(1, 2), order(3, 4);
  VD median = v[0];
  median = hn::IfThenElse(hn::Ge(count, constant(2)), v[1], median);
  median = hn::IfThenElse(hn::Ge(count, constant(4)), v[2], median);
  return hn::IfThenElse(hn::Ge(count, constant(6)), v[3], median);
}

/// The planes around a patch that agree.
struct Agreeing {
  static constexpr std::size_t kMost = PatchNeighbours::kMost;
  Seen seen[kMost];
  MD agrees[kMost];
  VD neighbours, count, divisor;
  Seen mean;

  HWY_INLINE Agreeing(std::size_t k, const Frame& frame, const PatchNeighbours& around) {
    const VD one = constant(1), zero = constant(0);
    VD w[kMost];
    neighbours = count = zero;
    for (std::size_t n = 0; n < kMost; ++n) {
      seen[n] = frame.to_patch(load(around, n, k).m);
      const MD counts = is_in_range(seen[n]);
      w[n] = hn::IfThenElse(counts, seen[n].w, constant(kLimit));
      neighbours = hn::Add(neighbours, hn::IfThenElseZero(counts, one));
    }
    // Those agree that are within a share of the median; at `kLimit` is none.
    const VD median = median_of(w, neighbours);
    const VD tolerance = hn::Floor(hn::Mul(median, constant(1.0 / 16)));
    Seen sum = {zero, zero, zero};
    for (std::size_t n = 0; n < kMost; ++n) {
      agrees[n] = hn::And(hn::Lt(w[n], constant(kLimit)),
                          hn::Le(hn::Abs(hn::Sub(w[n], median)), tolerance));
      count = hn::Add(count, hn::IfThenElseZero(agrees[n], one));
      sum.w = hn::Add(sum.w, hn::IfThenElseZero(agrees[n], seen[n].w));
      sum.s1 = hn::Add(sum.s1, hn::IfThenElseZero(agrees[n], seen[n].s1));
      sum.s2 = hn::Add(sum.s2, hn::IfThenElseZero(agrees[n], seen[n].s2));
    }
    // The quotient is rounded, but not past an integer: it is at least a sixth from the next one.
    divisor = hn::Max(count, one);
    mean = {hn::Floor(hn::Div(sum.w, divisor)), hn::Floor(hn::Div(sum.s1, divisor)),
            hn::Floor(hn::Div(sum.s2, divisor))};
  }

  /// Of what `of` says of each.
  template <typename Of>
  HWY_INLINE VD sum(const Of& of) const {
    VD result = constant(0);
    for (std::size_t n = 0; n < kMost; ++n) {
      result = hn::Add(result, hn::IfThenElseZero(agrees[n], of(n)));
    }
    return result;
  }
};

HWY_INLINE VD apart(VD a, VD b) { return hn::Abs(hn::Sub(a, b)); }

HWY_INLINE void store_prediction(const Agreeing& of, const Seen& plane, std::size_t k,
                                 PatchPredictions& predictions) {
  store(plane.w, predictions.w, k);
  store(plane.s1, predictions.s1, k);
  store(plane.s2, predictions.s2, k);
  store(of.neighbours, predictions.neighbours, k);
  store(of.count, predictions.agreeing, k);
  const VD s_spread = of.sum([&](std::size_t n) {
    return hn::Add(apart(of.seen[n].s1, plane.s1), apart(of.seen[n].s2, plane.s2));
  });
  store(s_spread, predictions.s_spread, k);
}

HWY_INLINE void predict_at(std::size_t k, const PatchFrames& frames, const PatchNeighbours& around,
                           PatchPredictions& predictions) {
  const Frame frame(frames, k);
  const Agreeing of(k, frame, around);
  store_prediction(of, of.mean, k, predictions);
  store(frame.to_cell(of.mean), predictions.m, k);
  store(of.sum([&](std::size_t n) { return apart(of.seen[n].w, of.mean.w); }), predictions.w_spread,
        k);
}

/// Centres of the planes around a patch that agree, zeros for others: where, in radians from its
/// own, and by how much their inverse range is more than that of their mean there.
struct Centres {
  static constexpr std::size_t kMost = PatchNeighbours::kMost;
  using Numbers = VD[kMost];
  Numbers x, y, more;

  HWY_INLINE Centres(std::size_t k, const Agreeing& of, const Vector& mean,
                     const PatchFrames& frames, const PatchNeighbours& around) {
    const Vector t1 = load(frames.t1, k), t2 = load(frames.t2, k);
    for (std::size_t n = 0; n < kMost; ++n) {
      const auto [m, u] = load(around, n, k);
      const Vector apart = {hn::Sub(m.x, mean.x), hn::Sub(m.y, mean.y), hn::Sub(m.z, mean.z)};
      x[n] = hn::IfThenElseZero(of.agrees[n], hn::Add(hn::Mul(u.x, t1.x), hn::Mul(u.y, t1.y)));
      y[n] = hn::IfThenElseZero(of.agrees[n], dot(u, t2));
      more[n] = hn::IfThenElseZero(of.agrees[n], dot(apart, u));
    }
  }
};

/// Of what `of` says of each.
template <typename Of>
HWY_INLINE VD sum_of_all(const Of& of) {
  VD result = of(0);
  for (std::size_t n = 1; n < Centres::kMost; ++n) result = hn::Add(result, of(n));
  return result;
}

/// By how much the plane through the centres differs from the mean: least squares, where the
/// slopes are held to the mean's.
HWY_INLINE Seen fitted(const Agreeing& of, const Centres& at, VD held) {
  const VD share = hn::Div(constant(1), of.divisor);
  const auto mean = [&](const Centres::Numbers& a) {
    return hn::Mul(sum_of_all([&](std::size_t n) { return a[n]; }), share);
  };
  const VD x = mean(at.x), y = mean(at.y), more = mean(at.more);
  const auto covariance = [&](const Centres::Numbers& a, VD mean_a, const Centres::Numbers& b,
                              VD mean_b) {
    const VD products = sum_of_all([&](std::size_t n) { return hn::Mul(a[n], b[n]); });
    return hn::Sub(hn::Mul(products, share), hn::Mul(mean_a, mean_b));
  };
  const VD xx = hn::Add(covariance(at.x, x, at.x, x), held);
  const VD yy = hn::Add(covariance(at.y, y, at.y, y), held);
  const VD xy = covariance(at.x, x, at.y, y);
  const VD xm = covariance(at.x, x, at.more, more), ym = covariance(at.y, y, at.more, more);
  const VD determinant = hn::Sub(hn::Mul(xx, yy), hn::Mul(xy, xy));
  const VD s1 = hn::Div(hn::Sub(hn::Mul(xm, yy), hn::Mul(ym, xy)), determinant);
  const VD s2 = hn::Div(hn::Sub(hn::Mul(ym, xx), hn::Mul(xm, xy)), determinant);
  return {hn::Sub(hn::Sub(more, hn::Mul(s1, x)), hn::Mul(s2, y)), s1, s2};
}

HWY_INLINE void fit_at(std::size_t k, const PatchFrames& frames, const PatchNeighbours& around,
                       VD held, PatchPredictions& predictions) {
  const Frame frame(frames, k);
  const Agreeing of(k, frame, around);
  const Vector mean = frame.to_cell(of.mean);
  const Centres at(k, of, mean, frames, around);
  Seen by = fitted(of, at, held);
  // One that is much nearer or farther is no plane of these neighbours.
  const MD is_near = hn::Le(hn::Abs(by.w), hn::Mul(of.mean.w, constant(0.25)));
  by = {hn::IfThenElseZero(is_near, by.w), hn::IfThenElseZero(is_near, by.s1),
        hn::IfThenElseZero(is_near, by.s2)};
  store_prediction(
      of, {hn::Add(of.mean.w, by.w), hn::Add(of.mean.s1, by.s1), hn::Add(of.mean.s2, by.s2)}, k,
      predictions);
  store(mean, predictions.m, k);
  const VD w_spread = of.sum([&](std::size_t n) {
    return apart(at.more[n],
                 hn::Add(hn::Add(by.w, hn::Mul(by.s1, at.x[n])), hn::Mul(by.s2, at.y[n])));
  });
  store(hn::Mul(w_spread, constant(2)), predictions.w_spread, k);
}

/// How often `step` must be doubled to be more than `spread`. Doubling adds one to the exponent,
/// and numbers are ordered as their bits are.
HWY_INLINE void store_doublings(VD spread, VD step, PatchCounts& doublings, std::size_t k) {
  const hn::RebindToSigned<D> whole;
  const auto by = hn::Sub(hn::BitCast(whole, spread), hn::BitCast(whole, step));
  hn::StoreU(hn::Add(hn::ShiftRight<52>(by), hn::Set(whole, 1)), whole, doublings.data() + k);
}

HWY_INLINE void expect_at(std::size_t k, const PatchPredictions& predictions,
                          const FacingSteps& steps, ExpectedPlanes& expected) {
  const VD per_w = hn::Div(constant(1), load(predictions.w, k));
  const VD range_m = hn::Mul(constant(kInverseRangeUnit), per_w);
  const VD s1 = hn::Mul(load(predictions.s1, k), per_w);
  const VD s2 = hn::Mul(load(predictions.s2, k), per_w);
  store(range_m, expected.range_m, k);
  store(s1, expected.s1, k);
  store(s2, expected.s2, k);
  const VD secant = hn::Sqrt(hn::Add(hn::Add(constant(1), hn::Mul(s1, s1)), hn::Mul(s2, s2)));
  store(secant, expected.secant, k);
  const VD range_spread = hn::Mul(hn::Mul(load(predictions.w_spread, k), range_m), per_w);
  const VD slope_spread = hn::Mul(load(predictions.s_spread, k), per_w);
  store(slope_spread, expected.slope_spread, k);
  const VD agreeing = hn::Min(load(predictions.agreeing, k), constant(5));
  store(agreeing, expected.agreeing, k);
  for (std::size_t scale = 0; scale < 2; ++scale) {
    const VD range_step = hn::Mul(constant(steps.range[scale]), secant);
    const VD slope_step = hn::Div(hn::Mul(constant(steps.slope[scale]), secant), range_m);
    store_doublings(hn::Add(range_spread, range_spread), hn::Mul(range_step, agreeing),
                    expected.range_doublings[scale], k);
    store_doublings(slope_spread, hn::Mul(slope_step, agreeing), expected.slope_doublings[scale],
                    k);
  }
}

HWY_INLINE void store_as_float(VD value, std::array<float, kMostPatches>& numbers, std::size_t k) {
  const hn::Rebind<float, D> narrow;
  hn::StoreU(hn::DemoteTo(narrow, value), narrow, numbers.data() + k);
}

HWY_INLINE void rebuild_at(std::size_t k, const PatchFrames& frames, const LeaningPlanes& planes,
                           RebuiltPlanes& rebuilt) {
  const VD range_m = load(planes.range_m, k), s1 = load(planes.s1, k), s2 = load(planes.s2, k);
  const Vector u = load(frames.u, k), t1 = load(frames.t1, k), t2 = load(frames.t2, k);
  const auto along = [&](VD a, VD b, VD c) {
    return hn::Add(hn::Add(a, hn::Mul(s1, b)), hn::Mul(s2, c));
  };
  const Vector n = {along(u.x, t1.x, t2.x), along(u.y, t1.y, t2.y), along(u.z, t1.z, t2.z)};
  const VD scale = hn::Div(constant(-1), hn::Sqrt(dot(n, n)));
  store_as_float(range_m, rebuilt.distance_m, k);
  store_as_float(hn::Mul(n.x, scale), rebuilt.normal[0], k);
  store_as_float(hn::Mul(n.y, scale), rebuilt.normal[1], k);
  store_as_float(hn::Mul(n.z, scale), rebuilt.normal[2], k);

  const VD w = hn::Div(constant(kInverseRangeUnit), range_m);
  const VD w_s1 = hn::Mul(s1, w), w_s2 = hn::Mul(s2, w);
  const MD is_near_enough = hn::And(is_small(w), hn::And(is_small(w_s1), is_small(w_s2)));
  const Seen seen = {to_whole(w, 1), to_whole(w_s1, 1), to_whole(w_s2, 1)};
  const MD is_seen = hn::And(is_near_enough, is_in_range(seen));
  store(Frame(frames, k).to_cell(seen), rebuilt.m, k);
  store(hn::IfThenElseZero(is_seen, constant(1)), rebuilt.is_seen, k);
}

void CompleteFrames(PatchFrames& frames, std::size_t count) {
  for (std::size_t k = 0; k < count; k += hn::Lanes(D())) complete_at(k, frames);
}

void PredictPlanes(const PatchFrames& frames, const PatchNeighbours& around, std::size_t count,
                   PatchPredictions& predictions) {
  for (std::size_t k = 0; k < count; k += hn::Lanes(D())) {
    predict_at(k, frames, around, predictions);
  }
}

void FitPlanes(const PatchFrames& frames, const PatchNeighbours& around, double held_rad2,
               std::size_t count, PatchPredictions& predictions) {
  const VD held = constant(held_rad2);
  for (std::size_t k = 0; k < count; k += hn::Lanes(D())) {
    fit_at(k, frames, around, held, predictions);
  }
}

void ExpectPlanes(const PatchPredictions& predictions, const FacingSteps& steps, std::size_t begin,
                  std::size_t end, ExpectedPlanes& expected) {
  const std::size_t lanes = hn::Lanes(D());
  for (std::size_t k = begin / lanes * lanes; k < end; k += lanes) {
    expect_at(k, predictions, steps, expected);
  }
}

void RebuildPlanes(const PatchFrames& frames, const LeaningPlanes& planes, std::size_t begin,
                   std::size_t end, RebuiltPlanes& rebuilt) {
  const std::size_t lanes = hn::Lanes(D());
  for (std::size_t k = begin / lanes * lanes; k < end; k += lanes) {
    rebuild_at(k, frames, planes, rebuilt);
  }
}

}  // namespace
}  // namespace cellmap::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace cellmap::simd {

HWY_EXPORT(CompleteFrames);
HWY_EXPORT(PredictPlanes);
HWY_EXPORT(FitPlanes);
HWY_EXPORT(ExpectPlanes);
HWY_EXPORT(RebuildPlanes);

void complete_frames(PatchFrames& frames, std::size_t count) {
  HWY_DYNAMIC_DISPATCH(CompleteFrames)(frames, count);
}

void predict_planes(const PatchFrames& frames, const PatchNeighbours& around, std::size_t count,
                    PatchPredictions& predictions) {
  HWY_DYNAMIC_DISPATCH(PredictPlanes)(frames, around, count, predictions);
}

void fit_planes(const PatchFrames& frames, const PatchNeighbours& around, double held_rad2,
                std::size_t count, PatchPredictions& predictions) {
  HWY_DYNAMIC_DISPATCH(FitPlanes)(frames, around, held_rad2, count, predictions);
}

void expect_planes(const PatchPredictions& predictions, const FacingSteps& steps, std::size_t begin,
                   std::size_t end, ExpectedPlanes& expected) {
  HWY_DYNAMIC_DISPATCH(ExpectPlanes)(predictions, steps, begin, end, expected);
}

void rebuild_planes(const PatchFrames& frames, const LeaningPlanes& planes, std::size_t begin,
                    std::size_t end, RebuiltPlanes& rebuilt) {
  HWY_DYNAMIC_DISPATCH(RebuildPlanes)(frames, planes, begin, end, rebuilt);
}

}  // namespace cellmap::simd
#endif
