#include "cellmap/geometry/lattice.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>

#include "cellmap/core/error.hpp"
#include "support/instruction_sets.hpp"

namespace cellmap {
namespace {

double dot(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return a.x() * b.x() + a.y() * b.y() + a.z() * b.z();
}

/// The definition itself: every direction compared. The slow twin.
class BruteForce {
 public:
  explicit BruteForce(const Lattice& lattice) {
    for (std::uint32_t i = 0; i < lattice.size(); ++i) directions_.push_back(lattice.direction(i));
  }
  std::uint32_t nearest(const Eigen::Vector3d& d) const {
    std::uint32_t best = 0;
    for (std::uint32_t i = 1; i < directions_.size(); ++i) {
      if (dot(directions_[i], d) > dot(directions_[best], d)) best = i;
    }
    return best;
  }

 private:
  std::vector<Eigen::Vector3d> directions_;
};

Eigen::Vector3d random_direction(std::mt19937_64& rng) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(rng), normal(rng), normal(rng)).normalized();
}

TEST(Lattice, DirectionsAreTheFibonacciFormula) {
  const long double phi = (1 + std::sqrt(5.0L)) / 2;
  for (const std::uint32_t n : {1'000U, 50'000U, 1'000'000U}) {
    const Lattice lattice({LatticeKind::kFibonacci, n});
    for (std::uint32_t i = 0; i < n; i += 1 + n / 5'000) {
      const long double z = 1 - (2.0L * i + 1) / n;
      const long double azimuth =
          2 * std::numbers::pi_v<long double> * (i / phi - std::floor(i / phi));
      const long double r = std::sqrt(1 - z * z);
      const Eigen::Vector3d d = lattice.direction(i);
      // i / phi itself is known to a few parts in 10^13 of a turn at i = 10^6.
      EXPECT_NEAR(d.x(), static_cast<double>(r * std::cos(azimuth)), 2e-12);
      EXPECT_NEAR(d.y(), static_cast<double>(r * std::sin(azimuth)), 2e-12);
      EXPECT_NEAR(d.z(), static_cast<double>(z), 1e-15);
      EXPECT_NEAR(d.norm(), 1.0, 4e-16);
    }
  }
}

TEST(Lattice, ManyDirectionsAtOnceHaveTheSameBitsOnEveryInstructionSet) {
  for (const LatticeSpec spec : {LatticeSpec{LatticeKind::kFibonacci, 1'000},
                                 {LatticeKind::kFibonacci, 50'000},
                                 {LatticeKind::kFibonacci, 999'983},
                                 {LatticeKind::kFibonacci, 1'000'000},
                                 {LatticeKind::kFibonacciBands, 1'000},
                                 {LatticeKind::kFibonacciBands, 50'000},
                                 {LatticeKind::kFibonacciBands, 500'000}}) {
    const Lattice lattice(spec);
    std::vector<std::uint32_t> indices(lattice.size());
    std::iota(indices.begin(), indices.end(), 0U);
    std::vector<double> x(lattice.size()), y(x), z(x);
    test::for_each_instruction_set([&](const std::string& name) {
      lattice.directions(indices, x.data(), y.data(), z.data());
      for (const std::uint32_t i : indices) {
        const Eigen::Vector3d d = lattice.direction(i);
        const auto bits = [](double value) { return std::bit_cast<std::uint64_t>(value); };
        ASSERT_TRUE(bits(x[i]) == bits(d.x()) && bits(y[i]) == bits(d.y()) &&
                    bits(z[i]) == bits(d.z()))
            << name << ", " << to_string(spec) << ' ' << i;
      }
      for (std::size_t count = 0; count < 20; ++count) {
        std::vector<double> a(count + 1, 7), b(a), c(a);
        lattice.directions(std::span(indices).subspan(5, count), a.data(), b.data(), c.data());
        EXPECT_TRUE(std::equal(a.begin(), a.end() - 1, x.begin() + 5)) << name << ' ' << count;
        EXPECT_TRUE(std::equal(c.begin(), c.end() - 1, z.begin() + 5)) << name << ' ' << count;
        EXPECT_EQ(a[count] + b[count] + c[count], 21) << "past the end, " << name;
      }
    });
  }
}

TEST(Lattice, EveryLatticePointIsNearestToItself) {
  for (const std::uint32_t n : {1'000U, 1'597U, 6'765U, 20'000U, 50'000U, 1'000'000U}) {
    const Lattice lattice({LatticeKind::kFibonacci, n});
    for (std::uint32_t i = 0; i < n; ++i) ASSERT_EQ(lattice.nearest(lattice.direction(i)), i) << n;
  }
}

TEST(Lattice, NearestIsWhatComparingAllDirectionsFinds) {
  std::mt19937_64 rng(1);
  for (const std::uint32_t n : {1'000U, 1'001U, 2'584U, 8'000U, 50'000U}) {
    const Lattice lattice({LatticeKind::kFibonacci, n});
    const BruteForce twin(lattice);
    for (int i = 0; i < 40'000'000 / static_cast<int>(n); ++i) {
      const Eigen::Vector3d d = random_direction(rng) * 17.3;
      ASSERT_EQ(lattice.nearest(d), twin.nearest(d)) << n << " at " << d.transpose();
    }
  }
}

/// The directions where an approximate lookup would go wrong first.
std::vector<Eigen::Vector3d> hard_directions(const Lattice& lattice, std::mt19937_64& rng) {
  std::vector<Eigen::Vector3d> hard = {{0, 0, 1}, {0, 0, -1}, {-1, 0, 0}, {-1, -0.0, 0.3}};
  std::uniform_real_distribution<double> uniform(-1, 1);
  const double n = lattice.size();
  for (int i = 0; i < 300; ++i) {
    // The seam of the azimuth, both signs of zero and the smallest steps beside it.
    const double z = uniform(rng);
    const double r = std::sqrt(1 - z * z);
    for (const double y : {0.0, -0.0, 1e-300, -1e-300, 1e-16, -1e-16}) hard.push_back({-r, y, z});
    // The poles' neighbourhood and the border of the caps.
    for (const double spacings : {0.1, 1.0, 5.0, 7.99, 8.01, 9.0}) {
      const double rho = std::min(1.0, spacings * std::sqrt(4 * std::numbers::pi / n));
      const double azimuth = std::numbers::pi * uniform(rng);
      hard.push_back({rho * std::cos(azimuth), rho * std::sin(azimuth),
                      std::copysign(std::sqrt(1 - rho * rho), uniform(rng))});
    }
    // Half-way between lattice points that differ by a Fibonacci number: edges of patches.
    const auto index = static_cast<std::uint32_t>((0.5 + 0.5 * uniform(rng)) * (n - 1));
    for (std::uint32_t a = 1, b = 2; index + a < lattice.size(); std::swap(a, b), b += a) {
      const Eigen::Vector3d p = lattice.direction(index), q = lattice.direction(index + a);
      if ((p - q).norm() > 8 / std::sqrt(n)) continue;
      for (const double t : {0.5, 0.5 + 1e-15, 0.5 - 1e-15, 0.5 + 1e-9}) {
        hard.push_back((1 - t) * p + t * q);
      }
    }
  }
  return hard;
}

TEST(Lattice, NearestIsExactAtPolesSeamCapBordersAndPatchEdges) {
  std::mt19937_64 rng(2);
  for (const std::uint32_t n : {1'000U, 1'999U, 10'000U}) {
    const Lattice lattice({LatticeKind::kFibonacci, n});
    const BruteForce twin(lattice);
    for (const Eigen::Vector3d& d : hard_directions(lattice, rng)) {
      ASSERT_EQ(lattice.nearest(d), twin.nearest(d)) << n << " at " << d.transpose();
    }
  }
}

/// Lattice points around point `index`, found by comparing all.
std::vector<Eigen::Vector3d> neighbours(const Lattice& lattice, std::uint32_t index) {
  const Eigen::Vector3d p = lattice.direction(index);
  const double reach = 7.5 / std::sqrt(static_cast<double>(lattice.size()));
  const auto window = static_cast<std::uint32_t>(reach * lattice.size() / 2 + 2);
  std::vector<Eigen::Vector3d> near;
  for (std::uint32_t i = index > window ? index - window : 0;
       i < lattice.size() && i <= index + window; ++i) {
    const Eigen::Vector3d q = lattice.direction(i);
    if (i != index && (q - p).norm() < reach) near.push_back(q);
  }
  return near;
}

/// Corners of the Voronoi cell of `p`: circumcentres of it and two neighbours that no other
/// neighbour is nearer to.
std::vector<Eigen::Vector3d> voronoi_corners(const Eigen::Vector3d& p,
                                             const std::vector<Eigen::Vector3d>& near) {
  std::vector<Eigen::Vector3d> corners;
  for (std::size_t i = 0; i < near.size(); ++i) {
    for (std::size_t j = i + 1; j < near.size(); ++j) {
      Eigen::Vector3d c = (near[i] - p).cross(near[j] - p).normalized();
      if (c.dot(p) < 0) c = -c;
      const bool is_corner = std::none_of(
          near.begin(), near.end(), [&](const auto& q) { return q.dot(c) > p.dot(c) + 1e-12; });
      if (is_corner) corners.push_back(c);
    }
  }
  return corners;
}

TEST(Lattice, EveryCornerOfSampledVoronoiCellsIsDecidedRightly) {
  // Just inside a corner of its cell a lattice point is nearest, however little: this is as far
  // from its lattice point as a direction can be, where a wrong choice of corners would show.
  std::mt19937_64 rng(3);
  for (const std::uint32_t n : {1'000U, 1'234U, 20'000U, 50'000U, 999'983U}) {
    const Lattice lattice({LatticeKind::kFibonacci, n});
    for (int sample = 0; sample < 300; ++sample) {
      const std::uint32_t index = sample < 100 ? static_cast<std::uint32_t>(sample * 3)
                                               : static_cast<std::uint32_t>(rng() % n);
      const Eigen::Vector3d p = lattice.direction(index);
      const std::vector<Eigen::Vector3d> corners = voronoi_corners(p, neighbours(lattice, index));
      ASSERT_GE(corners.size(), 4U) << n << " point " << index;
      for (const Eigen::Vector3d& corner : corners) {
        ASSERT_EQ(lattice.nearest(corner + 1e-3 * (p - corner)), index) << n;
      }
    }
  }
}

/// On every instruction set, vectors of floats against the double path, which the tests above hold
/// against brute force.
void expect_same_many_at_once(const Lattice& lattice, const PointCloud& cloud) {
  std::vector<std::uint32_t> one_by_one;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    one_by_one.push_back(lattice.nearest(cloud[i].cast<double>()));
  }
  test::for_each_instruction_set([&](const std::string& name) {
    std::vector<std::uint32_t> indices(cloud.size());
    lattice.nearest(cloud, indices);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      ASSERT_EQ(indices[i], one_by_one[i])
          << name << ", " << to_string(lattice.spec()) << " at " << cloud[i].transpose();
    }
  });
}

class ManyPointsAtOnce : public testing::TestWithParam<std::uint32_t> {
 protected:
  const Lattice lattice_{{LatticeKind::kFibonacci, GetParam()}};
  std::mt19937_64 rng_{4};
};
INSTANTIATE_TEST_SUITE_P(Lattice, ManyPointsAtOnce,
                         testing::Values(1'000, 1'597, 8'000, 50'000, 999'983, 1'000'000));

TEST_P(ManyPointsAtOnce, AreWhatEachIsInAnyDirection) {
  PointCloud cloud;
  for (int i = 0; i < 200'000; ++i) cloud.push_back((30 * random_direction(rng_)).cast<float>());
  expect_same_many_at_once(lattice_, cloud);
}

TEST_P(ManyPointsAtOnce, AreWhatEachIsAtPolesSeamCapBordersAndEdges) {
  PointCloud cloud;
  for (const Eigen::Vector3d& d : hard_directions(lattice_, rng_)) {
    // The nearest floats to an edge lie on both sides of it.
    for (const float scale : {1.0f, 3.0f, 77.7f}) cloud.push_back(scale * d.cast<float>());
  }
  expect_same_many_at_once(lattice_, cloud);
}

TEST_P(ManyPointsAtOnce, AreWhatEachIsAtVoronoiCornersAndZoneBorders) {
  PointCloud cloud;
  const double n = lattice_.size();
  for (int sample = 0; sample < 60; ++sample) {
    const auto index = static_cast<std::uint32_t>(rng_() % lattice_.size());
    for (const Eigen::Vector3d& corner :
         voronoi_corners(lattice_.direction(index), neighbours(lattice_, index))) {
      cloud.push_back(corner.cast<float>());
    }
    // Where the pair of Fibonacci steps changes: r^2 = a / (pi n |turns of a|), about a^2 / n 0.7.
    const double azimuth = 0.1 * sample;
    for (double a = 1, b = 2, next; a < n; next = a + b, a = b, b = next) {
      const double golden = a * (std::sqrt(5.0) - 1) / 2;
      const double r2 = a / (std::numbers::pi * n * std::abs(golden - std::round(golden)));
      if (r2 >= 1) break;
      for (const double off : {-1e-6, 0.0, 1e-6}) {
        const double r = std::sqrt(r2 * (1 + off));
        cloud.push_back(Eigen::Vector3d(r * std::cos(azimuth), r * std::sin(azimuth),
                                        (sample % 2 ? 1 : -1) * std::sqrt(1 - r * r))
                            .cast<float>());
      }
    }
  }
  expect_same_many_at_once(lattice_, cloud);
}

TEST(Lattice, PointsWithoutADirectionAreNowhereAndAnyLengthIsRight) {
  const Lattice lattice(LatticeSpec{});
  const float nan = std::nanf(""), inf = HUGE_VALF;
  test::for_each_instruction_set([&](const std::string& name) {
    for (std::size_t count = 1; count < 40; ++count) {
      PointCloud cloud;
      for (std::size_t i = 0; i < count; ++i) {
        const Eigen::Vector3f points[] = {{0, 0, 0}, {nan, 1, 1},    {1, inf, 1},
                                          {1, 2, 3}, {1e-30f, 0, 0}, {-3e37f, 1e37f, 2e37f}};
        cloud.push_back(points[i % 6]);
      }
      std::vector<std::uint32_t> indices(count + 1, 7);
      lattice.nearest(cloud, std::span(indices).first(count));
      EXPECT_EQ(indices[count], 7U) << "one past the end, " << name;
      for (std::size_t i = 0; i < count; ++i) {
        EXPECT_EQ(indices[i],
                  i % 6 < 3 ? Lattice::kNowhere : lattice.nearest(cloud[i].cast<double>()))
            << name << ' ' << i << " of " << count;
      }
    }
  });
}

TEST(LatticeCache, GivesTheSameLatticeForTheSameSpec) {
  LatticeCache cache;
  const auto first = cache.get({LatticeKind::kFibonacci, 2'000});
  EXPECT_EQ(first, cache.get({LatticeKind::kFibonacci, 2'000}));
  EXPECT_NE(first, cache.get({LatticeKind::kFibonacci, 2'001}));
}

TEST(Lattice, SizesAndKindsItDoesNotKnowAreRefused) {
  EXPECT_THROW(Lattice({LatticeKind::kFibonacci, 999}), Error);
  EXPECT_THROW(Lattice({LatticeKind::kFibonacci, 1'000'001}), Error);
  EXPECT_THROW(Lattice({static_cast<LatticeKind>(9), 50'000}), Error);
}

}  // namespace
}  // namespace cellmap
