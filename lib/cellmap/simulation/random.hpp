#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace cellmap::simulation {

/// A bijection of 64-bit integers that scatters neighbours: the finaliser of SplitMix64.
constexpr std::uint64_t mix(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

/// The seed of part `index` of whatever `seed` makes; parts are independent of each other.
constexpr std::uint64_t sub_seed(std::uint64_t seed, std::uint64_t index) {
  return mix(seed ^ mix(index));
}

/// A small seeded generator whose sequence is fixed here: the standard library leaves its
/// distributions to the implementation, and a town must not change with the compiler.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(mix(seed)) {}

  std::uint64_t next() { return mix(state_ += 0x9e3779b97f4a7c15u); }

  /// Uniform in [0, 1).
  double uniform() { return static_cast<double>(next() >> 11) * 0x1p-53; }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  bool chance(double probability) { return uniform() < probability; }

  /// Uniform in {low, ..., high}.
  int integer(int low, int high) { return low + static_cast<int>(uniform() * (high - low + 1)); }

  /// Standard normal (Box and Muller).
  double normal() {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
    return radius * std::cos(2.0 * std::numbers::pi * uniform());
  }

 private:
  std::uint64_t state_;
};

}  // namespace cellmap::simulation
