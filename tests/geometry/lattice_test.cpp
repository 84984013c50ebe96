#include "cellmap/geometry/lattice.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "cellmap/core/error.hpp"

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

TEST(Lattice, SizesAndKindsItDoesNotKnowAreRefused) {
  EXPECT_THROW(Lattice({LatticeKind::kFibonacci, 999}), Error);
  EXPECT_THROW(Lattice({LatticeKind::kFibonacci, 1'000'001}), Error);
  EXPECT_THROW(Lattice({static_cast<LatticeKind>(9), 50'000}), Error);
}

}  // namespace
}  // namespace cellmap
