#include "cellmap/geometry/fibonacci_sphere.hpp"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <numbers>
#include <numeric>

namespace cellmap {
namespace {

/// 2^64 / phi, rounded down.
constexpr std::uint64_t kTurnPerIndex = 0x9E3779B97F4A7C15ULL;
constexpr double kRadiansPerUnit = 2.0 * std::numbers::pi * 0x1p-64;

/// Caps reach to this many mean point spacings from the poles.
constexpr double kCapSpacings = 8.0;
/// Squared chords of corners are compared in double dot products when closer than this.
constexpr double kNearTie = 1e-13;
/// simd::FibonacciZones::guard in squared point spacings.
constexpr double kVectorGuard = 6e-4;

/// Azimuth of a lattice point in units of 2^-64 turn, modulo one turn.
std::uint64_t azimuth_units(std::uint64_t index) { return index * kTurnPerIndex; }

struct CosSin {
  double cos, sin;
};

/// Cosine and sine of an azimuth from basic IEEE operations only.
CosSin cos_sin(std::uint64_t units) {
  const std::uint64_t quarter = (units + (std::uint64_t{1} << 61)) >> 62;
  const double x =
      static_cast<double>(static_cast<std::int64_t>(units - (quarter << 62))) * kRadiansPerUnit;
  const double x2 = x * x;
  double s = 1.0, c = 1.0;
  for (int n = 16; n >= 2; n -= 2) {
    s = 1.0 - x2 / (n * (n + 1)) * s;
    c = 1.0 - x2 / (n * (n - 1)) * c;
  }
  s *= x;
  switch (quarter) {
    case 0:
      return {c, s};
    case 1:
      return {-s, c};
    case 2:
      return {-c, -s};
    default:
      return {s, -c};
  }
}

double product_in_order(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return a.x() * b.x() + a.y() * b.y() + a.z() * b.z();
}

/// Chord from a direction on the circle of latitude of radius^2 `r2` to the nearer pole.
double pole_chord(double r2, double abs_z) { return std::sqrt(2 * r2 / (1 + abs_z)); }

/// 2 - 2 cos(x) by its Taylor series, to the last bits for |x| < 0.3.
double squared_chord_of_angle(double x) {
  const double x2 = x * x;
  return x2 *
         (1 + x2 * (-1.0 / 12 + x2 * (1.0 / 360 + x2 * (-1.0 / 20'160 + x2 * (1.0 / 1'814'400)))));
}

}  // namespace

FibonacciSphere::FibonacciSphere(std::uint32_t size, Ends ends)
    : size_(size), rings_(rings(size, ends)) {
  assert(size > 999 && size <= 1'000'000);
  const double n = rings_.divisor;
  const double spacing2 = 4 * std::numbers::pi / n;
  cap_r2_ = kCapSpacings * kCapSpacings * spacing2;

  // A pair of Fibonacci steps serves from where its shorter step runs at 45 degrees to the circle
  // of latitude (r dazimuth = dz / r) to where the longer one does.
  for (std::int64_t a = 1, b = 2, next; a < size_; next = a + b, a = b, b = next) {
    const double turn_a =
        static_cast<double>(static_cast<std::int64_t>(azimuth_units(a))) * 0x1p-64;
    const double turn_b =
        static_cast<double>(static_cast<std::int64_t>(azimuth_units(b))) * 0x1p-64;
    const double determinant = a * turn_b - b * turn_a;  // +1 or -1
    const double min_r2 = a / (std::numbers::pi * n * std::abs(turn_a));
    if (min_r2 >= 1.0) break;
    zones_.push_back({min_r2, a, b, turn_b / determinant, -b / determinant, -turn_a / determinant,
                      a / determinant});
  }
  std::reverse(zones_.begin(), zones_.end());

  const double outer = pole_chord(cap_r2_, std::sqrt(1 - cap_r2_)) + std::sqrt(spacing2);
  const auto cap_size =
      std::min<std::uint32_t>(size_, static_cast<std::uint32_t>(n * outer * outer / 4) + 2);
  std::vector<std::uint32_t> cap(cap_size);
  std::iota(cap.begin(), cap.end(), 0U);
  north_ = DirectionTable(rings_, cap);
  for (std::uint32_t& i : cap) i = size_ - 1 - i;
  south_ = DirectionTable(rings_, cap);
  vector_zones_ = vector_zones();
}

simd::FibonacciRings FibonacciSphere::rings(std::uint32_t size, Ends ends) {
  return ends == Ends::kBesidePoles ? simd::FibonacciRings{size, 1}
                                    : simd::FibonacciRings{size - 1, 0};
}

Eigen::Vector3d FibonacciSphere::direction(const simd::FibonacciRings& rings, std::uint32_t index) {
  const double n = rings.divisor;
  const auto above = 2 * std::uint64_t{index} + rings.offset;
  const auto below = 2 * std::uint64_t{rings.divisor} - above;
  const double r = std::sqrt(static_cast<double>(above * below)) / n;
  const double z = (n - static_cast<double>(above)) / n;
  const auto [cos, sin] = cos_sin(azimuth_units(index));
  return {r * cos, r * sin, z};
}

std::uint32_t FibonacciSphere::nearest(const Eigen::Vector3d& direction) const {
  const double rho2 = direction.x() * direction.x() + direction.y() * direction.y();
  const double norm2 = rho2 + direction.z() * direction.z();
  assert(norm2 > 0 && std::isfinite(norm2));
  const double r2 = rho2 / norm2;
  const double unit_z = direction.z() / std::sqrt(norm2);
  return r2 < cap_r2_ ? nearest_in_cap(direction, unit_z, r2)
                      : nearest_in_zone(direction, unit_z, r2);
}

void FibonacciSphere::nearest(const float* x, const float* y, const float* z,
                              std::span<std::uint32_t> indices) const {
  constexpr std::size_t kBlock = 1'024;
  std::array<std::uint32_t, kBlock> undecided;
  for (std::size_t begin = 0; begin < indices.size(); begin += kBlock) {
    const std::size_t count = std::min(kBlock, indices.size() - begin);
    const std::size_t open = simd::nearest(vector_zones_, x + begin, y + begin, z + begin, count,
                                           indices.data() + begin, undecided.data());
    for (std::size_t k = 0; k < open; ++k) {
      const std::size_t i = begin + undecided[k];
      const Eigen::Vector3d direction(x[i], y[i], z[i]);
      const double norm2 = direction.squaredNorm();
      indices[i] = norm2 > 0 && std::isfinite(norm2) ? nearest(direction) : simd::kUndecided;
    }
  }
}

simd::FibonacciZones FibonacciSphere::vector_zones() const {
  const double n = rings_.divisor;
  const auto turns = [](std::uint64_t index) {
    return static_cast<double>(static_cast<std::int64_t>(azimuth_units(index))) * 0x1p-64;
  };
  simd::FibonacciZones zones;
  zones.points = static_cast<float>(n);
  zones.first = 0.5f * static_cast<float>(rings_.offset);
  zones.last_turns = static_cast<float>(turns(size() - 1));
  zones.cap_r2 = static_cast<float>(cap_r2_);
  zones.guard = static_cast<float>(kVectorGuard * 4 * std::numbers::pi / n);
  zones.count = zones_.size();
  assert(zones.count <= zones.kMost);
  for (std::size_t k = 0; k < zones.count; ++k) {
    const auto a = static_cast<double>(zones_[k].step_a), b = static_cast<double>(zones_[k].step_b);
    const double turns_a = turns(static_cast<std::uint64_t>(zones_[k].step_a));
    const double turns_b = turns(static_cast<std::uint64_t>(zones_[k].step_b));
    const double sign = a * turns_b - b * turns_a > 0 ? 1 : -1;
    zones.min_r2[k] = static_cast<float>(zones_[k].min_r2);
    zones.index_a[k] = static_cast<float>(a);
    zones.turns_a[k] = static_cast<float>(turns_a);
    zones.index_b[k] = static_cast<float>(sign * b);
    zones.turns_b[k] = static_cast<float>(sign * turns_b);
  }
  return zones;
}

double FibonacciSphere::spacing() const { return std::sqrt(4 * std::numbers::pi / rings_.divisor); }

const FibonacciSphere::Zone& FibonacciSphere::zone_at(double r2) const {
  std::size_t k = 0;
  while (r2 < zones_[k].min_r2 && k + 1 < zones_.size()) ++k;
  return zones_[k];
}

std::uint32_t FibonacciSphere::nearest_in_cap(const Eigen::Vector3d& direction, double unit_z,
                                              double r2) const {
  const bool is_north = unit_z >= 0;
  const double n = rings_.divisor;
  // Chords obey the triangle inequality: a lattice point within `reach` of the direction has a
  // chord to the pole within `reach` of the direction's. Point j from the pole: n chord^2 = 4 j
  // + 2 o.
  const double reach = spacing();
  const double chord = pole_chord(r2, std::abs(unit_z));
  const double inner = std::max(0.0, chord - reach), outer = chord + reach;
  const auto begin = static_cast<std::size_t>(n * inner * inner / 4);
  const auto end =
      std::min(north_.x.size(), static_cast<std::size_t>(std::ceil(n * outer * outer / 4)) + 1);
  // From the south pole outwards the index falls, so the later of two equals wins.
  const std::size_t best = simd::largest_dot((is_north ? north_ : south_).view(), begin, end,
                                             direction.data(), !is_north);
  return is_north ? static_cast<std::uint32_t>(best)
                  : size() - 1 - static_cast<std::uint32_t>(best);
}

std::uint32_t FibonacciSphere::nearest_in_zone(const Eigen::Vector3d& direction, double unit_z,
                                               double r2) const {
  const Zone& zone = zone_at(r2);
  const double n = rings_.divisor, offset = rings_.offset;
  const double inverse_n = 1.0 / n;
  const double r = std::sqrt(r2);
  const double t = (n * (1 - unit_z) - offset) / 2;  // index, as a real number
  const double turns = std::atan2(direction.y(), direction.x()) * (0.5 * std::numbers::inv_pi);
  const auto units = static_cast<std::uint64_t>(static_cast<std::int64_t>(turns * 0x1p62)) << 2;
  const auto a =
      static_cast<std::int64_t>(std::floor(zone.index_to_a * t + zone.azimuth_to_a * turns));
  const auto b =
      static_cast<std::int64_t>(std::floor(zone.index_to_b * t + zone.azimuth_to_b * turns));
  const std::int64_t base = zone.step_a * a + zone.step_b * b;
  const std::array<std::int64_t, 4> corners = {base, base + zone.step_a, base + zone.step_b,
                                               base + zone.step_a + zone.step_b};
  std::array<double, 4> chord2;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto i = static_cast<double>(corners[k]);
    const double dz = (i - t) * 2 * inverse_n;
    const double corner_r = std::sqrt((2 * i + offset) * (2 * n - 2 * i - offset)) * inverse_n;
    const double turn = static_cast<double>(
        static_cast<std::int64_t>(azimuth_units(static_cast<std::uint64_t>(corners[k])) - units));
    chord2[k] = dz * dz + (r - corner_r) * (r - corner_r) +
                r * corner_r * squared_chord_of_angle(turn * kRadiansPerUnit);
  }
  // Without branches: which corner is nearest cannot be predicted.
  const bool first = chord2[1] < chord2[0], second = chord2[3] < chord2[2];
  const double least_01 = first ? chord2[1] : chord2[0], least_23 = second ? chord2[3] : chord2[2];
  const std::int64_t best_01 = corners[first], best_23 = corners[2 + second];
  const double least = std::min(least_01, least_23);
  std::int64_t best = least_23 < least_01 ? best_23 : best_01;
  int near = 0;
  for (const double c : chord2) near += c <= least + kNearTie;
  if (near == 1) return static_cast<std::uint32_t>(best);
  double best_dot = -HUGE_VAL;
  for (std::size_t k = 0; k < 4; ++k) {
    if (chord2[k] > least + kNearTie) continue;
    const double d =
        product_in_order(this->direction(static_cast<std::uint32_t>(corners[k])), direction);
    if (d > best_dot || (d == best_dot && corners[k] < best)) {
      best_dot = d;
      best = corners[k];
    }
  }
  return static_cast<std::uint32_t>(best);
}

}  // namespace cellmap
