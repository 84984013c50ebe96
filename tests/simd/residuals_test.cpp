#include "cellmap/simd/residuals.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <vector>

#include "support/instruction_sets.hpp"

namespace cellmap::simd {
namespace {

/// Points within 60 m and a table of planes, most of which pass within 2 m of their point.
struct Sample {
  std::vector<float> x, y, z, weights;
  std::vector<HessePlane> planes = {kNoPlane};
  std::vector<std::uint32_t> index, place;  // of lattice points, those of the table from kFirst on
  static constexpr std::uint32_t kFirst = 1'000;

  explicit Sample(std::size_t count) {
    std::mt19937 rng(7);
    std::uniform_real_distribution<float> coordinate(-60, 60), distance(-2, 2), unit(0, 1);
    std::normal_distribution<float> normal;
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::Vector3f p(coordinate(rng), coordinate(rng), coordinate(rng));
      const Eigen::Vector3f n = Eigen::Vector3f(normal(rng), normal(rng), normal(rng)).normalized();
      x.push_back(p.x()), y.push_back(p.y()), z.push_back(p.z());
      weights.push_back(unit(rng));
      const HessePlane plane = {n.x(), n.y(), n.z(), n.dot(p) - distance(rng)};
      planes.insert(planes.begin(), plane);  // indices fall as points rise
      const auto found = static_cast<std::uint32_t>(kFirst + count - 1 - i);
      // One in nine lies below or above the table or nowhere.
      const std::uint32_t beyond[] = {kFirst - 1, kFirst + static_cast<std::uint32_t>(count),
                                      0xFFFF'FFFF};
      index.push_back(i % 9 == 0 ? beyond[i / 9 % 3] : found);
    }
    place.resize(count);
    find_planes(table(), index.data(), count, place.data());
  }
  Points points() const { return {x.data(), y.data(), z.data()}; }
  PlaneTable table() const {
    return {planes.data(), kFirst, static_cast<std::uint32_t>(planes.size() - 1)};
  }
  Eigen::Vector3d point(std::size_t i) const { return {x[i], y[i], z[i]}; }
};

double weight_of(const Weights& weights, std::size_t i, double d) {
  if (std::abs(d) > weights.gate_m) return 0;
  const double ratio = d * weights.inverse_width;
  const double cauchy = 1 / (1 + ratio * ratio);
  switch (weights.weighting) {
    case Weighting::kOne:
      return 1;
    case Weighting::kCauchy:
      return cauchy;
    case Weighting::kGemanMcClure:
      return cauchy * cauchy;
    case Weighting::kGiven:
      break;
  }
  return weights.given[i];
}

/// The same sums in double, point by point; `scale` the sums of the absolute values of their terms.
struct SlowSums {
  NormalSums sums, scale;

  SlowSums(const Sample& sample, const std::vector<float>& distance, std::size_t count,
           const Weights& weights) {
    for (std::size_t i = 0; i < count; ++i) {
      const double d = distance[i];
      const double w = weight_of(weights, i, d);
      if (!(std::abs(d) <= weights.gate_m)) continue;
      ++sums.points;
      const HessePlane& plane = sample.table().of(sample.index[i]);
      const Eigen::Vector3d n(plane.nx, plane.ny, plane.nz);
      Eigen::Matrix<double, 6, 1> J;
      J << n, sample.point(i).cross(n);
      std::size_t k = 0;
      for (int r = 0; r < 6; ++r) {
        sums.jd[static_cast<std::size_t>(r)] += w * J[r] * d;
        scale.jd[static_cast<std::size_t>(r)] += std::abs(w * J[r] * d);
        for (int c = r; c < 6; ++c, ++k) {
          sums.jj[k] += w * J[r] * J[c];
          scale.jj[k] += std::abs(w * J[r] * J[c]);
        }
      }
    }
  }
};

TEST(Accumulate, IsTheSumOverPointsForEveryKernelLengthAndInstructionSet) {
  const Sample sample(1'024);
  std::vector<float> distance(1'024);
  distances(sample.table(), sample.place.data(), sample.points(), 1'024, distance.data());
  test::for_each_instruction_set([&](const std::string& name) {
    for (const Weighting weighting :
         {Weighting::kOne, Weighting::kCauchy, Weighting::kGemanMcClure, Weighting::kGiven}) {
      const Weights weights{weighting, 1.0f, 5.0f, sample.weights.data()};
      for (const std::size_t count : {0, 1, 3, 15, 16, 17, 511, 512, 1'024}) {
        NormalSums sums;
        accumulate(sample.table(), sample.place.data(), sample.points(), count, weights, sums);
        const SlowSums slow(sample, distance, count, weights);
        EXPECT_EQ(sums.points, slow.sums.points) << name << ' ' << count;
        // A few units in the last place of a float for each of at most 1,024 additions a lane.
        for (std::size_t k = 0; k < 21; ++k) {
          EXPECT_NEAR(sums.jj[k], slow.sums.jj[k], 1e-6 * slow.scale.jj[k]) << name << ' ' << count;
        }
        for (std::size_t k = 0; k < 6; ++k) {
          EXPECT_NEAR(sums.jd[k], slow.sums.jd[k], 1e-6 * slow.scale.jd[k]) << name << ' ' << count;
        }
      }
    }
  });
}

TEST(FindPlanes, FindsWhatTheTableHasOfEachLatticePointOnEveryInstructionSet) {
  const Sample sample(1'003);
  const PlaneTable table = sample.table();
  test::for_each_instruction_set([&](const std::string& name) {
    std::vector<std::uint32_t> place = sample.index;
    find_planes(table, place.data(), place.size(), place.data());
    for (std::size_t i = 0; i < place.size(); ++i) {
      EXPECT_EQ(&table.planes[place[i]], &table.of(sample.index[i])) << name;
      EXPECT_EQ(place[i] == table.count, i % 9 == 0) << name;
    }
  });
}

TEST(Move, HasTheSameBitsOnEveryInstructionSet) {
  const Sample sample(1'003);
  const Eigen::Matrix3f R =
      (Eigen::AngleAxisf(0.7f, Eigen::Vector3f(1, 2, 3).normalized())).toRotationMatrix();
  const Eigen::Vector3f t(3, -5, 0.5f);
  Motion motion;
  for (int r = 0; r < 3; ++r) {
    motion.t[static_cast<std::size_t>(r)] = t[r];
    for (int c = 0; c < 3; ++c) motion.R[static_cast<std::size_t>(3 * r + c)] = R(r, c);
  }
  std::vector<float> first;
  test::for_each_instruction_set([&](const std::string& name) {
    std::vector<float> moved(3 * 1'003);
    move(motion, sample.points(), 1'003,
         {moved.data(), moved.data() + 1'003, moved.data() + 2'006});
    for (std::size_t i = 0; i < 1'003; ++i) {
      const Eigen::Vector3d exact = R.cast<double>() * sample.point(i) + t.cast<double>();
      const Eigen::Vector3d found(moved[i], moved[1'003 + i], moved[2'006 + i]);
      EXPECT_LT((found - exact).norm(), 4 * 60 * 0x1p-23) << name;
    }
    if (first.empty()) first = moved;
    EXPECT_EQ(moved, first) << name;
  });
}

TEST(Distances, HaveTheSameBitsOnEveryInstructionSet) {
  const Sample sample(1'003);
  std::vector<float> first;
  test::for_each_instruction_set([&](const std::string& name) {
    std::vector<float> found(1'003);
    distances(sample.table(), sample.place.data(), sample.points(), 1'003, found.data());
    if (first.empty()) first = found;
    EXPECT_EQ(found, first) << name;
  });
  for (std::size_t i = 0; i < 1'003; i += 9) EXPECT_EQ(first[i], -HUGE_VALF) << "no plane";
}

}  // namespace
}  // namespace cellmap::simd
