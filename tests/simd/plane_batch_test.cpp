#include "cellmap/simd/plane_batch.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <cstring>
#include <random>
#include <string>

#include "support/instruction_sets.hpp"

namespace cellmap::simd {
namespace {

Moments moments_of(const std::vector<Eigen::Vector3d>& points) {
  Moments m;
  m.count = static_cast<double>(points.size());
  for (const Eigen::Vector3d& p : points) {
    for (int i = 0; i < 3; ++i) m.sum[i] += p[i];
    const double products[6] = {p.x() * p.x(), p.x() * p.y(), p.x() * p.z(),
                                p.y() * p.y(), p.y() * p.z(), p.z() * p.z()};
    for (int i = 0; i < 6; ++i) m.products[i] += products[i];
  }
  return m;
}

std::vector<Eigen::Vector3d> slab(std::mt19937& rng, double middle, double thin) {
  std::normal_distribution<double> normal;
  const Eigen::Vector3d scale(1, middle, thin);
  const Eigen::Quaterniond q(normal(rng), normal(rng), normal(rng), normal(rng));
  const Eigen::Matrix3d R = q.normalized().toRotationMatrix();
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 30; ++i) {
    const Eigen::Vector3d p(normal(rng), normal(rng), normal(rng));
    points.push_back(R * scale.cwiseProduct(p) + Eigen::Vector3d(0.3, -0.1, 0.2));
  }
  return points;
}

/// From flat to round, and what spans no plane: two points, one point many times, a line.
std::vector<std::vector<Eigen::Vector3d>> cases() {
  std::mt19937 rng(4);
  std::vector<std::vector<Eigen::Vector3d>> all;
  for (int trial = 0; trial < 400; ++trial) {
    all.push_back(slab(rng, std::pow(10, -0.005 * trial), std::pow(10, -0.01 * trial)));
  }
  all.push_back({{0, 0, 0}, {1, 0, 0}});
  all.push_back(std::vector<Eigen::Vector3d>(5, Eigen::Vector3d(0.5, 0.25, 0)));
  all.push_back({{0, 0, 0}, {1, 2, 4}, {2, 4, 8}, {3, 6, 12}});
  return all;
}

TEST(PlaneBatch, HoldsTheSmallestEigenvectorsAndTheSameBitsOnEveryInstructionSet) {
  const auto all = cases();
  std::vector<PlaneBatch> first;
  test::for_each_instruction_set([&](const std::string& name) {
    std::vector<PlaneBatch> batches;
    for (std::size_t begin = 0; begin < all.size(); begin += PlaneBatch::kSize) {
      PlaneBatch& batch = batches.emplace_back();
      batch.used = std::min(PlaneBatch::kSize, all.size() - begin);
      for (std::size_t k = 0; k < batch.used; ++k) batch.set(k, moments_of(all[begin + k]));
      fit_planes(batch);
    }
    if (first.empty()) first = batches;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const PlaneBatch &batch = batches[i / batch.kSize], &other = first[i / batch.kSize];
      const std::size_t k = i % batch.kSize;
      const Eigen::Vector3d normal(batch.normal[0][k], batch.normal[1][k], batch.normal[2][k]);
      for (int axis = 0; axis < 3; ++axis) {
        ASSERT_EQ(batch.normal[axis][k], other.normal[axis][k]) << name << ' ' << i;
      }
      if (i >= 400) {
        ASSERT_EQ(normal.norm(), 0) << name << ' ' << i;
        continue;
      }
      ASSERT_EQ(batch.variance_across[k], other.variance_across[k]) << name << ' ' << i;
      ASSERT_EQ(batch.variance_within[k], other.variance_within[k]) << name << ' ' << i;

      Eigen::Map<const Eigen::Matrix3Xd> P(all[i][0].data(), 3,
                                           static_cast<Eigen::Index>(all[i].size()));
      const Eigen::Vector3d mean = P.rowwise().mean();
      const Eigen::Matrix3d C = (P.colwise() - mean) * (P.colwise() - mean).transpose() /
                                static_cast<double>(all[i].size());
      const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> twin(C);
      const double trace = C.trace();
      EXPECT_NEAR(batch.variance_across[k], twin.eigenvalues()[0], 1e-12 * trace) << i;
      EXPECT_NEAR(batch.variance_within[k], twin.eigenvalues()[1], 1e-12 * trace) << i;
      EXPECT_NEAR(normal.norm(), 1, 1e-12);
      // The eigenvector is as certain as its eigenvalue is apart from the next.
      const double apart = (twin.eigenvalues()[1] - twin.eigenvalues()[0]) / trace;
      if (apart > 1e-5) {
        EXPECT_NEAR(std::abs(normal.dot(twin.eigenvectors().col(0))), 1, 1e-9) << i;
      }
    }
  });
}

}  // namespace
}  // namespace cellmap::simd
