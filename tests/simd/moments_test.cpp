#include "cellmap/simd/moments.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "support/instruction_sets.hpp"

namespace cellmap::simd {
namespace {

struct Patch {
  std::vector<PatchPoint> points;
  std::vector<double> x, y, z;
  SquaredRanges ranges;

  explicit Patch(std::size_t count) {
    std::mt19937 rng(static_cast<unsigned>(count));
    std::normal_distribution<float> spread(0, 0.3f);
    for (std::size_t i = 0; i < count; ++i) {
      points.push_back({20 + spread(rng), -7 + spread(rng), 1 + 0.1f * spread(rng), 0});
    }
    x.assign(padded(count), -1);
    y = z = x;
    ranges = centre(points.data(), count, x.data(), y.data(), z.data());
  }
  CentredPoints view() const { return {x.data(), y.data(), z.data(), points.size()}; }
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
  for (std::size_t i = 0; i < patch.points.size(); ++i) {
    const long double x = patch.x[i], y = patch.y[i], z = patch.z[i];
    if (!takes_part(patch.x[i], patch.y[i], patch.z[i])) continue;
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

TEST(Centre, SubtractsTheFirstPointExactlyAndFindsTheExtremeRanges) {
  const Patch patch(103);
  double least = HUGE_VAL, most = 0;
  for (std::size_t i = 0; i < 103; ++i) {
    const PatchPoint& p = patch.points[i];
    EXPECT_EQ(patch.x[i], static_cast<double>(p.x) - patch.points[0].x);
    EXPECT_EQ(patch.z[i], static_cast<double>(p.z) - patch.points[0].z);
    const double range = std::hypot(p.x, p.y, p.z);
    least = std::min(least, range);
    most = std::max(most, range);
  }
  EXPECT_EQ(patch.x[103], 0);
  EXPECT_NEAR(std::sqrt(patch.ranges.min), least, 1e-6);
  EXPECT_NEAR(std::sqrt(patch.ranges.max), most, 1e-6);
}

}  // namespace
}  // namespace cellmap::simd
