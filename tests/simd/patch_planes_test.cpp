#include "cellmap/simd/patch_planes.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "support/instruction_sets.hpp"

namespace cellmap::simd {
namespace {

// The slow twin: FORMAT.md, "Predicted planes" and "Compact planes", in 64-bit integers, one patch
// after another.

using Whole = std::array<std::int64_t, 3>;
constexpr std::int64_t kLimit = std::int64_t{1} << 30;

std::int64_t dot(const Whole& a, const Whole& b) {
  return (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) >> 20;
}

struct SlowFrame {
  std::array<double, 3> u, t1, t2;
  Whole whole_u, whole_t1, whole_t2;

  SlowFrame(const PatchFrames& frames, std::size_t k)
      : u{frames.u[0][k], frames.u[1][k], frames.u[2][k]} {
    const double h = std::sqrt(u[0] * u[0] + u[1] * u[1]);
    t1 = h == 0 ? std::array{1.0, 0.0, 0.0} : std::array{-u[1] / h, u[0] / h, 0.0};
    t2 = {-u[2] * t1[1], u[2] * t1[0], u[0] * t1[1] - u[1] * t1[0]};
    for (int i = 0; i < 3; ++i) {
      whole_u[i] = whole(u[i] * 0x1p20);
      whole_t1[i] = whole(t1[i] * 0x1p20);
      whole_t2[i] = whole(t2[i] * 0x1p20);
    }
  }
  static std::int64_t whole(double v) { return static_cast<std::int64_t>(std::floor(v + 0.5)); }
  Whole to_patch(const Whole& m) const {
    return {dot(m, whole_u), dot(m, whole_t1), dot(m, whole_t2)};
  }
  std::int64_t to_cell(const Whole& p, int i) const {
    return dot(p, {whole_u[i], whole_t1[i], whole_t2[i]});
  }
};

bool is_in_range(const Whole& p) {
  return p[0] > 0 &&
         std::all_of(p.begin(), p.end(), [](std::int64_t v) { return -kLimit < v && v < kLimit; });
}

std::int64_t floor_mean(std::int64_t sum, std::int64_t count) {
  return static_cast<std::int64_t>(std::floor(static_cast<double>(sum) / double(count)));
}

void expect_slow_prediction(const PatchFrames& frames, const PatchNeighbours& around,
                            const PatchPredictions& fast, std::size_t k) {
  const SlowFrame frame(frames, k);
  std::vector<Whole> seen;
  for (std::size_t n = 0; n < PatchNeighbours::kMost; ++n) {
    const PatchNeighbours::Numbers m = around.at(n, k);
    const Whole p = frame.to_patch({std::int64_t(m[0]), std::int64_t(m[1]), std::int64_t(m[2])});
    if (is_in_range(p)) seen.push_back(p);
  }
  ASSERT_EQ(fast.neighbours[k], double(seen.size()));
  if (seen.empty()) return;
  std::vector<std::int64_t> w;
  for (const Whole& p : seen) w.push_back(p[0]);
  std::sort(w.begin(), w.end());
  const std::int64_t median = w[w.size() / 2];
  std::erase_if(seen, [&](const Whole& p) { return std::abs(p[0] - median) > median / 16; });
  Whole mean{};
  for (int i = 0; i < 3; ++i) {
    std::int64_t sum = 0;
    for (const Whole& p : seen) sum += p[i];
    mean[i] = floor_mean(sum, static_cast<std::int64_t>(seen.size()));
  }
  std::int64_t w_spread = 0, s_spread = 0;
  for (const Whole& p : seen) {
    w_spread += std::abs(p[0] - mean[0]);
    s_spread += std::abs(p[1] - mean[1]) + std::abs(p[2] - mean[2]);
  }
  EXPECT_EQ(fast.agreeing[k], double(seen.size()));
  EXPECT_EQ(fast.w[k], double(mean[0]));
  EXPECT_EQ(fast.s1[k], double(mean[1]));
  EXPECT_EQ(fast.s2[k], double(mean[2]));
  EXPECT_EQ(fast.w_spread[k], double(w_spread));
  EXPECT_EQ(fast.s_spread[k], double(s_spread));
  for (int i = 0; i < 3; ++i) EXPECT_EQ(fast.m[i][k], double(frame.to_cell(mean, i)));
}

/// FORMAT.md, "Predicted planes", the fitted plane, in doubles one after another.
void expect_slow_fit(const PatchFrames& frames, const PatchNeighbours& around, double held,
                     const PatchPredictions& mean, const PatchPredictions& fast, std::size_t k) {
  ASSERT_EQ(fast.neighbours[k], mean.neighbours[k]);
  if (mean.neighbours[k] == 0) return;
  ASSERT_EQ(fast.agreeing[k], mean.agreeing[k]);
  const SlowFrame frame(frames, k);
  std::vector<Whole> seen;
  std::vector<double> x, y, e;
  std::vector<std::int64_t> w;
  const auto plane_of = [&](std::size_t n) {
    const PatchNeighbours::Numbers m = around.at(n, k);
    return frame.to_patch({std::int64_t(m[0]), std::int64_t(m[1]), std::int64_t(m[2])});
  };
  for (std::size_t n = 0; n < PatchNeighbours::kMost; ++n) {
    if (is_in_range(plane_of(n))) w.push_back(plane_of(n)[0]);
  }
  std::sort(w.begin(), w.end());
  const std::int64_t median = w[w.size() / 2];
  for (std::size_t n = 0; n < PatchNeighbours::kMost; ++n) {
    const Whole p = plane_of(n);
    if (!is_in_range(p) || std::abs(p[0] - median) > median / 16) continue;
    std::array<double, 3> u, more;
    for (int i = 0; i < 3; ++i) {
      u[i] = around.at(n, k)[3 + i];
      more[i] = around.at(n, k)[i] - mean.m[i][k];
    }
    seen.push_back(p);
    x.push_back(u[0] * frame.t1[0] + u[1] * frame.t1[1]);
    y.push_back((u[0] * frame.t2[0] + u[1] * frame.t2[1]) + u[2] * frame.t2[2]);
    e.push_back((more[0] * u[0] + more[1] * u[1]) + more[2] * u[2]);
  }
  const double share = 1 / static_cast<double>(seen.size());
  const auto mean_of = [&](const std::vector<double>& a) {
    double sum = 0;
    for (const double v : a) sum += v;
    return sum * share;
  };
  const auto covariance = [&](const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0;
    for (std::size_t n = 0; n < a.size(); ++n) sum += a[n] * b[n];
    return sum * share - mean_of(a) * mean_of(b);
  };
  const double xx = covariance(x, x) + held, yy = covariance(y, y) + held, xy = covariance(x, y),
               xe = covariance(x, e), ye = covariance(y, e), d = xx * yy - xy * xy;
  double g1 = (xe * yy - ye * xy) / d, g2 = (ye * xx - xe * xy) / d;
  double dw = (mean_of(e) - g1 * mean_of(x)) - g2 * mean_of(y);
  if (!(std::abs(dw) <= 0.25 * mean.w[k])) dw = g1 = g2 = 0;
  EXPECT_EQ(fast.w[k], mean.w[k] + dw);
  EXPECT_EQ(fast.s1[k], mean.s1[k] + g1);
  EXPECT_EQ(fast.s2[k], mean.s2[k] + g2);
  double w_spread = 0, s_spread = 0;
  for (std::size_t n = 0; n < seen.size(); ++n) {
    w_spread += std::abs(e[n] - ((dw + g1 * x[n]) + g2 * y[n]));
    s_spread +=
        std::abs(double(seen[n][1]) - fast.s1[k]) + std::abs(double(seen[n][2]) - fast.s2[k]);
  }
  EXPECT_EQ(fast.w_spread[k], 2 * w_spread);
  EXPECT_EQ(fast.s_spread[k], s_spread);
}

/// How often a step must be doubled to be more than the spread, or halved so that it still is.
int slow_doublings(double spread, double step) {
  int doublings = 0;
  for (; step <= spread; step *= 2) ++doublings;
  for (; step / 2 > spread; step /= 2) --doublings;
  return doublings;
}

void expect_slow_expectation(const PatchPredictions& p, const FacingSteps& steps,
                             const ExpectedPlanes& fast, std::size_t k) {
  const double i = 1 / p.w[k], r = 0x1p28 * i, l1 = p.s1[k] * i, l2 = p.s2[k] * i;
  EXPECT_EQ(fast.range_m[k], r);
  EXPECT_EQ(fast.s1[k], l1);
  EXPECT_EQ(fast.s2[k], l2);
  const double secant = std::sqrt((1 + l1 * l1) + l2 * l2), agreeing = std::min(p.agreeing[k], 5.0);
  EXPECT_EQ(fast.secant[k], secant);
  EXPECT_EQ(fast.agreeing[k], agreeing);
  const double range_spread = (p.w_spread[k] * r) * i, slope_spread = p.s_spread[k] * i;
  EXPECT_EQ(fast.slope_spread[k], slope_spread);
  for (int scale = 0; scale < 2; ++scale) {
    const double range_step = (steps.range[scale] * secant) * agreeing;
    const double slope_step = ((steps.slope[scale] * secant) / r) * agreeing;
    if (range_spread > 0) {
      EXPECT_EQ(fast.range_doublings[scale][k], slow_doublings(2 * range_spread, range_step));
    }
    if (slope_spread > 0) {
      EXPECT_EQ(fast.slope_doublings[scale][k], slow_doublings(slope_spread, slope_step));
    }
  }
}

void expect_slow_plane(const PatchFrames& frames, const LeaningPlanes& planes,
                       const RebuiltPlanes& fast, std::size_t k) {
  const SlowFrame frame(frames, k);
  const double r = planes.range_m[k], l1 = planes.s1[k], l2 = planes.s2[k];
  std::array<double, 3> v;
  for (int i = 0; i < 3; ++i) v[i] = (frame.u[i] + l1 * frame.t1[i]) + l2 * frame.t2[i];
  const double scale = -1 / std::sqrt((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]);
  EXPECT_EQ(fast.distance_m[k], static_cast<float>(r));
  for (int i = 0; i < 3; ++i) EXPECT_EQ(fast.normal[i][k], static_cast<float>(v[i] * scale));
  const double w = 0x1p28 / r;
  const bool is_near = w < 0x1p30 && std::abs(l1 * w) < 0x1p30 && std::abs(l2 * w) < 0x1p30;
  const Whole seen =
      is_near ? Whole{SlowFrame::whole(w), SlowFrame::whole(l1 * w), SlowFrame::whole(l2 * w)}
              : Whole{};
  ASSERT_EQ(fast.is_seen[k] != 0, is_near && is_in_range(seen)) << r << ' ' << l1 << ' ' << l2;
  if (fast.is_seen[k] == 0) return;
  for (int i = 0; i < 3; ++i) EXPECT_EQ(fast.m[i][k], double(frame.to_cell(seen, i)));
}

/// Directions all over the sphere, the poles among them.
PatchFrames some_frames(std::mt19937& rng) {
  std::normal_distribution<double> normal(0, 1);
  PatchFrames frames;
  for (std::size_t k = 0; k < kMostPatches; ++k) {
    std::array<double, 3> u = {normal(rng), normal(rng), normal(rng)};
    if (k % 16 == 3) u = {0, 0, k % 32 == 3 ? 1.0 : -1.0};
    const double norm = std::sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
    for (int i = 0; i < 3; ++i) frames.u[i][k] = u[i] / norm;
  }
  return frames;
}

/// Planes that look alike from the patch and others, near the limits and beyond them too.
PatchNeighbours some_neighbours(const PatchFrames& frames, std::mt19937& rng) {
  std::normal_distribution<double> normal(0, 1);
  PatchNeighbours around;
  for (std::size_t k = 0; k < kMostPatches; ++k) {
    const double size = std::exp2(10 + static_cast<double>(rng() % 22));
    const std::size_t count = rng() % (PatchNeighbours::kMost + 1);
    for (std::size_t n = 0; n < count; ++n) {
      const double noise = rng() % 4 ? 0.03 : 2;
      PatchNeighbours::Numbers numbers;
      for (int i = 0; i < 3; ++i) {
        const double m = size * (frames.u[i][k] + noise * normal(rng));
        numbers[i] = std::floor(std::clamp(m, -0x1p30 * 1.7, 0x1p30 * 1.7));
        numbers[3 + i] = frames.u[i][k] + 0.02 * normal(rng);
      }
      around.set(n, k, numbers);
    }
  }
  return around;
}

TEST(PatchPlanes, AreThoseOfIntegersOnEveryInstructionSet) {
  test::for_each_instruction_set([](const std::string& name) {
    SCOPED_TRACE(name);
    std::mt19937 rng(5);
    std::normal_distribution<double> normal(0, 1);
    for (int trial = 0; trial < 40; ++trial) {
      PatchFrames frames = some_frames(rng);
      complete_frames(frames, kMostPatches);
      const PatchNeighbours around = some_neighbours(frames, rng);
      PatchPredictions predictions;
      predict_planes(frames, around, kMostPatches, predictions);
      PatchPredictions fitted;
      fit_planes(frames, around, 1e-4, kMostPatches, fitted);
      ExpectedPlanes expected;
      const FacingSteps steps = {{0.014, 0.021}, {2.25, 3.375}};
      expect_planes(predictions, steps, 0, kMostPatches, expected);
      LeaningPlanes leaning;
      for (std::size_t k = 0; k < kMostPatches; ++k) {
        leaning.range_m[k] = std::exp2(14.0 * normal(rng) / 4 + 3);
        leaning.s1[k] = normal(rng) * std::exp2(double(rng() % 30) - 10);
        leaning.s2[k] = normal(rng) * std::exp2(double(rng() % 30) - 10);
      }
      RebuiltPlanes rebuilt;
      rebuild_planes(frames, leaning, 0, kMostPatches, rebuilt);
      for (std::size_t k = 0; k < kMostPatches; ++k) {
        expect_slow_prediction(frames, around, predictions, k);
        expect_slow_fit(frames, around, 1e-4, predictions, fitted, k);
        if (predictions.neighbours[k] > 0) expect_slow_expectation(predictions, steps, expected, k);
        expect_slow_plane(frames, leaning, rebuilt, k);
      }
    }
  });
}

TEST(PatchPlanes, FittedToCentresOfAPlaneAreThatPlaneThoughSlopesAreWrong) {
  std::mt19937 rng(7);
  std::normal_distribution<double> normal(0, 1);
  PatchFrames frames = some_frames(rng);
  complete_frames(frames, kMostPatches);
  PatchNeighbours around;
  std::array<double, kMostPatches> truth;
  for (std::size_t k = 0; k < kMostPatches; ++k) {
    const SlowFrame frame(frames, k);
    const auto along = [&](double a, double b, double c, int i) {
      return a * frame.u[i] + b * frame.t1[i] + c * frame.t2[i];
    };
    const double size = 0x1p26;
    truth[k] = size;
    for (std::size_t n = 0; n < PatchNeighbours::kMost; ++n) {
      // Neighbours on one side; the plane leans by half, their slopes say that it does not.
      const double x = 0.02 + 0.005 * double(n), y = 0.01 * normal(rng);
      const double at = size * (1 + 0.5 * x) / (1 + x * x + y * y);
      PatchNeighbours::Numbers numbers;
      for (int i = 0; i < 3; ++i) {
        const double u = along(1, x, y, i);
        numbers[i] = std::floor(at * u);
        numbers[3 + i] = u;
      }
      around.set(n, k, numbers);
    }
  }
  PatchPredictions mean, fitted;
  predict_planes(frames, around, kMostPatches, mean);
  fit_planes(frames, around, 1e-9, kMostPatches, fitted);
  for (std::size_t k = 0; k < kMostPatches; ++k) {
    EXPECT_GT(std::abs(mean.w[k] - truth[k]), 0.01 * truth[k]);
    EXPECT_NEAR(fitted.w[k], truth[k], 1e-3 * truth[k]);
    EXPECT_NEAR(fitted.s1[k], 0.5 * truth[k], 0.05 * truth[k]);
  }
}

TEST(PatchPlanes, OfARangeAreThoseOfAll) {
  std::mt19937 rng(6);
  PatchFrames frames = some_frames(rng);
  complete_frames(frames, kMostPatches);
  LeaningPlanes leaning;
  leaning.range_m.fill(7);
  RebuiltPlanes all, parts;
  rebuild_planes(frames, leaning, 0, kMostPatches, all);
  for (std::size_t begin = 0; begin < kMostPatches; begin += 13) {
    rebuild_planes(frames, leaning, begin, std::min(begin + 13, kMostPatches), parts);
  }
  EXPECT_EQ(parts.normal, all.normal);
  EXPECT_EQ(parts.m, all.m);
}

}  // namespace
}  // namespace cellmap::simd
