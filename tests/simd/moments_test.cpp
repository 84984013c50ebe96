#include "cellmap/simd/moments.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "support/instruction_sets.hpp"

namespace cellmap::simd {
namespace {

struct Patch {
  std::size_t count;
  std::vector<float> x, y, z;

  explicit Patch(std::size_t points) : count(points) {
    std::mt19937 rng(static_cast<unsigned>(count));
    std::normal_distribution<float> spread(0, 0.3f);
    for (std::size_t i = 0; i < count; ++i) {
      x.push_back(20 + spread(rng));
      y.push_back(-7 + spread(rng));
      z.push_back(1 + 0.1f * spread(rng));
    }
    x.resize(padded(count), x[0]);
    y.resize(padded(count), y[0]);
    z.resize(padded(count), z[0]);
  }
  PatchView view() const { return {x.data(), y.data(), z.data(), count, {x[0], y[0], z[0]}}; }
  /// About the first point.
  std::array<double, 3> centred(std::size_t i) const {
    return {double{x[i]} - x[0], double{y[i]} - y[0], double{z[i]} - z[0]};
  }
};

std::vector<double> values(const Moments& m) {
  std::vector<double> all = {m.count};
  all.insert(all.end(), m.sum.begin(), m.sum.end());
  all.insert(all.end(), m.products.begin(), m.products.end());
  return all;
}

/// One after the other, in long double.
std::vector<long double> slow_moments(const Patch& patch, auto&& takes_part) {
  std::vector<long double> all(10, 0);
  for (std::size_t i = 0; i < patch.count; ++i) {
    const auto p = patch.centred(i);
    if (!takes_part(p[0], p[1], p[2])) continue;
    const long double x = p[0], y = p[1], z = p[2];
    const long double terms[10] = {1, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z};
    for (std::size_t k = 0; k < 10; ++k) all[k] += terms[k];
  }
  return all;
}

TEST(Moments, AreTheSumsAndHaveTheSameBitsOnEveryInstructionSet) {
  const std::array<double, 3> normal = {0.6, 0, 0.8};
  constexpr double kOffset = 0.05, kLimit = 0.1;
  for (const std::size_t count : {1, 2, 3, 4, 5, 7, 8, 9, 100, 1'001}) {
    std::vector<double> first;
    test::for_each_instruction_set([&](const std::string& name) {
      const Patch patch(count);
      const Moments all = moments(patch.view());
      const Moments off = moments_off_plane(patch.view(), normal, kOffset, kLimit);
      const auto slow_all = slow_moments(patch, [](double, double, double) { return true; });
      const auto slow_off = slow_moments(patch, [&](double x, double, double z) {
        return std::abs(normal[0] * x + normal[2] * z - kOffset) > kLimit;
      });
      std::vector<double> found = values(all);
      for (std::size_t k = 0; k < 10; ++k) {
        EXPECT_NEAR(found[k], static_cast<double>(slow_all[k]), 1e-12 * static_cast<double>(count));
        EXPECT_NEAR(values(off)[k], static_cast<double>(slow_off[k]),
                    1e-12 * static_cast<double>(count));
        EXPECT_EQ(values(all - off)[k], found[k] - values(off)[k]);
      }
      for (const double value : values(off)) found.push_back(value);
      if (first.empty()) first = found;
      EXPECT_EQ(found, first) << name << ' ' << count;
    });
  }
}

TEST(SquaredRanges, AreTheExtremesOfTheRangesWithTheSameBitsOnEveryInstructionSet) {
  for (const std::size_t count : {1, 2, 5, 8, 103}) {
    const Patch patch(count);
    std::vector<double> slow;
    for (std::size_t i = 0; i < count; ++i) {
      const double x = patch.x[i], y = patch.y[i], z = patch.z[i];
      slow.push_back(x * x + y * y + z * z);
    }
    test::for_each_instruction_set([&](const std::string& name) {
      const auto [both, extremes] = moments_and_ranges(patch.view());
      EXPECT_EQ(extremes.min, *std::min_element(slow.begin(), slow.end())) << name;
      EXPECT_EQ(extremes.max, *std::max_element(slow.begin(), slow.end())) << name;
      EXPECT_EQ(values(both), values(moments(patch.view()))) << name;
      std::vector<double> found(padded(count));
      ranges(patch.view(), found.data());
      for (std::size_t i = 0; i < count; ++i) EXPECT_EQ(found[i], std::sqrt(slow[i])) << name;
    });
  }
}

}  // namespace
}  // namespace cellmap::simd
