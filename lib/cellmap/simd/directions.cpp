#include "cellmap/simd/directions.hpp"

#include <algorithm>
#include <array>
#include <numbers>

// Compiles the rest of this file once for each instruction set.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "cellmap/simd/directions.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace cellmap::simd::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::ScalableTag<double>;
using U = hn::RebindToUnsigned<D>;
using I = hn::RebindToSigned<D>;
using Narrow = hn::Rebind<std::uint32_t, D>;
using VD = hn::Vec<D>;
using VU = hn::Vec<U>;

/// An integer below 2^21 to divide by.
///
/// `inverse` is 1 / value rounded, `rest` what the rounding left out. x inverse + x rest with one
/// rounding is x / value correctly rounded: before it is rounded it is off by less than 2^-104 of
/// itself, while no quotient comes nearer to the middle between two doubles than 1 / (2 value) of
/// their distance, for a middle times `value` has more bits than x.
struct Divisor {
  double value, inverse, rest;

  constexpr explicit Divisor(int integer)
      : value(integer), inverse(1.0 / value), rest(rest_of(value, inverse)) {}

 private:
  /// (1 - value inverse) / value. The upper half of `inverse` times value is exact, so is the
  /// lower, and so is what is left of 1.
  static constexpr double rest_of(double value, double inverse) {
    const double upper = static_cast<float>(inverse);
    return ((1.0 - value * upper) - value * (inverse - upper)) / value;
  }
};

HWY_INLINE VD divided(VD x, const Divisor& by) {
  const D d;
#if HWY_NATIVE_FMA
  return hn::MulAdd(x, hn::Set(d, by.inverse), hn::Mul(x, hn::Set(d, by.rest)));
#else
  return hn::Div(x, hn::Set(d, by.value));
#endif
}

/// n (n + 1) of the sine and n (n - 1) of the cosine, n = 16, 14, ..., 2.
constexpr std::array<Divisor, 8> kSine = {Divisor(272), Divisor(210), Divisor(156), Divisor(110),
                                          Divisor(72),  Divisor(42),  Divisor(20),  Divisor(6)};
constexpr std::array<Divisor, 8> kCosine = {Divisor(240), Divisor(182), Divisor(132), Divisor(90),
                                            Divisor(56),  Divisor(30),  Divisor(12),  Divisor(2)};

struct CosSin {
  VD cos, sin;
};

/// Of azimuths in units of 2^-64 turn.
HWY_INLINE CosSin cos_sin(VU units) {
  constexpr double kRadiansPerUnit = 2.0 * std::numbers::pi * 0x1p-64;
  const D d;
  const U u;
  // The rest from the nearest quarter turn, four times as large: the quarters fall out at the top.
  const VD rest = hn::ConvertTo(d, hn::BitCast(I(), hn::ShiftLeft<2>(units)));
  const VD x = hn::Mul(rest, hn::Set(d, 0.25 * kRadiansPerUnit));
  const VD x2 = hn::Mul(x, x), one = hn::Set(d, 1.0);
  VD s = one, c = one;
  for (std::size_t k = 0; k < kSine.size(); ++k) {
    s = hn::Sub(one, hn::Mul(divided(x2, kSine[k]), s));
    c = hn::Sub(one, hn::Mul(divided(x2, kCosine[k]), c));
  }
  s = hn::Mul(s, x);

  // The upper two bits count quarter turns: (c, s), (-s, c), (-c, -s), (s, -c).
  const VU quarter = hn::Add(units, hn::Set(u, std::uint64_t{1} << 61));
  const auto odd = hn::RebindMask(d, hn::TestBit(quarter, hn::Set(u, std::uint64_t{1} << 62)));
  const VU sign = hn::Set(u, std::uint64_t{1} << 63);
  const VU sin_sign = hn::And(quarter, sign);
  const VU cos_sign = hn::And(hn::Xor(quarter, hn::ShiftLeft<1>(quarter)), sign);
  return {hn::Xor(hn::IfThenElse(odd, s, c), hn::BitCast(d, cos_sign)),
          hn::Xor(hn::IfThenElse(odd, c, s), hn::BitCast(d, sin_sign))};
}

/// One vector of points.
HWY_INLINE void directions_of(const FibonacciRings& rings, const Divisor& divisor,
                              const std::uint32_t* index, double* x, double* y, double* z) {
  const D d;
  const U u;
  const VU i = hn::PromoteTo(u, hn::LoadU(Narrow(), index));
  const auto [cos, sin] = cos_sin(hn::Mul(i, hn::Set(u, 0x9E3779B97F4A7C15ULL)));
  // Integers below 2^53, whose products and differences are exact.
  const VD n = hn::Set(d, divisor.value);
  const VD twice = hn::ConvertTo(d, hn::BitCast(I(), hn::Add(i, i)));
  const VD a = hn::Add(twice, hn::Set(d, static_cast<double>(rings.offset)));
  const VD b = hn::Sub(hn::Add(n, n), a);
  const VD r = divided(hn::Sqrt(hn::Mul(a, b)), divisor);
  hn::StoreU(hn::Mul(r, cos), d, x);
  hn::StoreU(hn::Mul(r, sin), d, y);
  hn::StoreU(divided(hn::Sub(n, a), divisor), d, z);
}

void DirectionsOf(const FibonacciRings& rings, const std::uint32_t* index, std::size_t count,
                  double* x, double* y, double* z) {
  const D d;
  const std::size_t lanes = hn::Lanes(d);
  const Divisor divisor(static_cast<int>(rings.divisor));
  std::size_t k = 0;
  for (; k + lanes <= count; k += lanes) {
    directions_of(rings, divisor, index + k, x + k, y + k, z + k);
  }
  if (k == count) return;
  HWY_ALIGN std::uint32_t rest[hn::MaxLanes(d)] = {};
  HWY_ALIGN double found[3][hn::MaxLanes(d)];
  std::copy(index + k, index + count, rest);
  directions_of(rings, divisor, rest, found[0], found[1], found[2]);
  std::copy(found[0], found[0] + (count - k), x + k);
  std::copy(found[1], found[1] + (count - k), y + k);
  std::copy(found[2], found[2] + (count - k), z + k);
}

}  // namespace
}  // namespace cellmap::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace cellmap::simd {

HWY_EXPORT(DirectionsOf);

void directions(const FibonacciRings& rings, const std::uint32_t* index, std::size_t count,
                double* x, double* y, double* z) {
  HWY_DYNAMIC_DISPATCH(DirectionsOf)(rings, index, count, x, y, z);
}

}  // namespace cellmap::simd
#endif
