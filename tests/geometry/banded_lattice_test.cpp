#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "cellmap/core/error.hpp"
#include "cellmap/geometry/lattice.hpp"
#include "support/instruction_sets.hpp"

namespace cellmap {
namespace {

constexpr double kHeights[] = {0.70, -0.20, -0.60};

Lattice bands(std::uint32_t n) { return Lattice({LatticeKind::kFibonacciBands, n}); }

/// In the order of the definition: the product along the axis, which is y, last.
double dot(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return a.x() * b.x() + a.z() * b.z() + a.y() * b.y();
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
    return d.z() >= 0.7 * d.norm() ? Lattice::kNowhere : best;
  }

 private:
  std::vector<Eigen::Vector3d> directions_;
};

Eigen::Vector3d at_height(double z, double azimuth) {
  const double r = std::sqrt(1 - z * z);
  return {r * std::cos(azimuth), r * std::sin(azimuth), z};
}

Eigen::Vector3d random_direction(std::mt19937_64& rng) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(rng), normal(rng), normal(rng)).normalized();
}

/// The points of a sphere of `n` within heights [low, high), from the formula in the released code.
void add_band(long double n, double low, double high, std::vector<Eigen::Vector3d>& directions) {
  const long double phi = (1 + std::sqrt(5.0L)) / 2;
  for (long double i = 0; i < n; ++i) {
    const long double y = 1 - 2 * i / (n - 1), r = std::sqrt(std::max(0.0L, 1 - y * y));
    const long double turns = i / phi - std::floor(i / phi);
    const long double azimuth = 2 * std::numbers::pi_v<long double> * turns;
    const Eigen::Vector3d d(static_cast<double>(r * std::cos(azimuth)), static_cast<double>(y),
                            static_cast<double>(r * std::sin(azimuth)));
    if (d.z() >= low && d.z() < high) directions.push_back(d);
  }
}

TEST(BandedLattice, IsThreeBandsOfTheFormulaOneAfterAnother) {
  for (const std::uint32_t n : {1'000U, 1'399U, 20'000U, 50'000U, 500'000U}) {
    const Lattice lattice = bands(n);
    std::vector<Eigen::Vector3d> expected;
    add_band(n, -0.2, 0.7, expected);
    add_band(2.0L * n, -0.6, -0.2, expected);
    add_band(n / 200, -2, -0.6, expected);
    ASSERT_EQ(lattice.size(), expected.size()) << n;
    for (std::uint32_t i = 0; i < lattice.size(); ++i) {
      ASSERT_LT((lattice.direction(i) - expected[i]).cwiseAbs().maxCoeff(), 3e-12) << n << ' ' << i;
    }
  }
}

TEST(BandedLattice, HasTheSizeOfThePapersReleasedLattice) {
  EXPECT_EQ(bands(50'000).size(), 42'563U);
}

TEST(BandedLattice, EveryLatticePointIsNearestToItself) {
  for (const std::uint32_t n : {1'000U, 1'597U, 20'000U, 50'000U, 500'000U}) {
    const Lattice lattice = bands(n);
    for (std::uint32_t i = 0; i < lattice.size(); ++i) {
      ASSERT_EQ(lattice.nearest(lattice.direction(i)), i) << n;
    }
  }
}

TEST(BandedLattice, NearestIsWhatComparingAllDirectionsFinds) {
  std::mt19937_64 rng(1);
  for (const std::uint32_t n : {1'000U, 1'001U, 2'584U, 8'000U, 50'000U}) {
    const Lattice lattice = bands(n);
    const BruteForce twin(lattice);
    for (int i = 0; i < 20'000'000 / static_cast<int>(n); ++i) {
      const Eigen::Vector3d d = random_direction(rng) * 17.3;
      ASSERT_EQ(lattice.nearest(d), twin.nearest(d)) << n << " at " << d.transpose();
    }
  }
}

/// Around the circles where bands meet, the poles of the spheres and of the heights, the seams of
/// both azimuths, and half-way between neighbours.
std::vector<Eigen::Vector3d> hard_directions(const Lattice& lattice, std::mt19937_64& rng) {
  std::vector<Eigen::Vector3d> hard = {{0, 0, -1}, {0, 0, 1}, {0, 1, 0}, {0, -1, 0}, {-1, 0, 0}};
  std::uniform_real_distribution<double> uniform(-1, 1);
  const double spacing = std::sqrt(4 * std::numbers::pi / lattice.spec().size);
  for (int sample = 0; sample < 60; ++sample) {
    for (const double height : kHeights) {
      for (const double steps : {0.0, 1e-12, 1e-6, 0.1, 0.5, 0.7, 0.71, 1.0, 1.01, 2.0, 3.0}) {
        for (const double sign : {-1.0, 1.0}) {
          const double z = height + sign * steps * spacing;
          if (std::abs(z) < 1) hard.push_back(at_height(z, std::numbers::pi * uniform(rng)));
        }
      }
    }
    const double z = uniform(rng);
    for (const double y : {0.0, -0.0, 1e-300, -1e-300, 1e-16, -1e-16}) {
      hard.push_back({-std::sqrt(1 - z * z), y, z});
      hard.push_back({-std::sqrt(1 - z * z), z, y});
    }
    const double near = 3 * spacing * uniform(rng), by = 3 * spacing * uniform(rng);
    hard.push_back({near, by, -1});
    hard.push_back({near, sample % 2 ? 1.0 : -1.0, by});
    // Edges of patches: half-way between a lattice point and the nearest one of another index.
    const auto index = static_cast<std::uint32_t>(rng() % lattice.size());
    const Eigen::Vector3d p = lattice.direction(index);
    for (int k = 0; k < 8; ++k) {
      const std::uint32_t other = lattice.nearest(p + 1.2 * spacing * random_direction(rng));
      if (other == Lattice::kNowhere) continue;
      const Eigen::Vector3d q = lattice.direction(other);
      for (const double t : {0.5, 0.5 + 1e-15, 0.5 - 1e-15, 0.5 + 1e-9}) {
        hard.push_back((1 - t) * p + t * q);
      }
    }
  }
  return hard;
}

TEST(BandedLattice, NearestIsExactAtBordersPolesSeamsAndPatchEdges) {
  std::mt19937_64 rng(2);
  for (const std::uint32_t n : {1'000U, 1'999U, 10'000U}) {
    const Lattice lattice = bands(n);
    const BruteForce twin(lattice);
    for (const Eigen::Vector3d& d : hard_directions(lattice, rng)) {
      if (std::abs(d.z() / d.norm() - 0.7) < 1e-14) continue;  // either side of the upper border
      ASSERT_EQ(lattice.nearest(d), twin.nearest(d)) << n << " at " << d.transpose();
    }
  }
}

TEST(BandedLattice, ManyPointsAtOnceAreWhatEachIsOnEveryInstructionSet) {
  std::mt19937_64 rng(3);
  for (const std::uint32_t n : {1'000U, 8'000U, 50'000U, 500'000U}) {
    const Lattice lattice = bands(n);
    PointCloud cloud;
    for (int i = 0; i < 50'000; ++i) cloud.push_back((30 * random_direction(rng)).cast<float>());
    for (const Eigen::Vector3d& d : hard_directions(lattice, rng)) cloud.push_back(d.cast<float>());
    std::vector<std::uint32_t> one_by_one;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      one_by_one.push_back(lattice.nearest(cloud[i].cast<double>()));
    }
    test::for_each_instruction_set([&](const std::string& name) {
      std::vector<std::uint32_t> indices(cloud.size());
      lattice.nearest(cloud, indices);
      for (std::size_t i = 0; i < cloud.size(); ++i) {
        ASSERT_EQ(indices[i], one_by_one[i]) << name << ' ' << n << " at " << cloud[i].transpose();
      }
    });
  }
}

TEST(BandedLattice, PointsWithoutADirectionAndAboveAllBandsAreNowhere) {
  const Lattice lattice = bands(50'000);
  const float nan = std::nanf(""), inf = HUGE_VALF;
  PointCloud cloud;
  for (const Eigen::Vector3f& p :
       {Eigen::Vector3f(0, 0, 0), Eigen::Vector3f(nan, 1, 1), Eigen::Vector3f(1, inf, 1),
        Eigen::Vector3f(0, 0, 1), Eigen::Vector3f(0.7f, 0.1f, 0.72f), Eigen::Vector3f(1, 2, 0.5f),
        Eigen::Vector3f(-3e37f, 1e37f, 2e37f), Eigen::Vector3f(1e-30f, 0, -1e-31f),
        Eigen::Vector3f(0, 0, -2e-30f)}) {
    cloud.push_back(p);
  }
  std::vector<std::uint32_t> indices(cloud.size());
  lattice.nearest(cloud, indices);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (i < 5) {
      EXPECT_EQ(indices[i], Lattice::kNowhere) << i;
    } else {
      EXPECT_EQ(indices[i], lattice.nearest(cloud[i].cast<double>())) << i;
      EXPECT_LT(indices[i], lattice.size()) << i;
    }
  }
}

TEST(BandedLattice, PatchesAreAsWideAsTheDensityOfTheirBandSays) {
  const Lattice lattice = bands(50'000);
  EXPECT_DOUBLE_EQ(lattice.patch_radius_rad(0), 2 / std::sqrt(50'000.0));
  EXPECT_DOUBLE_EQ(lattice.patch_radius_rad(30'000), 2 / std::sqrt(100'000.0));
  EXPECT_DOUBLE_EQ(lattice.patch_radius_rad(lattice.size() - 1), 2 / std::sqrt(250.0));
  EXPECT_DOUBLE_EQ(lattice.patch_radius_rad(), 2 / std::sqrt(100'000.0));
}

TEST(BandedLattice, SizesWhoseDensestBandIsNotSupportedAreRefused) {
  EXPECT_THROW(bands(999), Error);
  EXPECT_THROW(bands(500'001), Error);
  EXPECT_EQ(to_string(bands(1'000).spec()), "fibonacci-bands-1000");
}

TEST(LatticeKind, IsFoundByItsName) {
  EXPECT_EQ(lattice_kind_from("fibonacci"), LatticeKind::kFibonacci);
  EXPECT_EQ(lattice_kind_from("fibonacci-bands"), LatticeKind::kFibonacciBands);
  EXPECT_THROW(lattice_kind_from("cube"), Error);
}

}  // namespace
}  // namespace cellmap
