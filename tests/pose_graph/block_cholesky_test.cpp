#include "cellmap/pose_graph/block_cholesky.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <random>

namespace cellmap {
namespace {

using Pair = BlockCholesky::Pair;

/// A sparse matrix and its dense twin.
struct Matrices {
  BlockCholesky sparse;
  Eigen::MatrixXd dense;
};

/// J^T J for one random 6x12 row of blocks a pair, and an identity on the diagonal.
Matrices random_matrices(std::size_t unknowns, const std::vector<Pair>& pairs, std::mt19937& rng) {
  const auto random = [&] {
    return Matrix6d(Matrix6d::NullaryExpr([&] { return std::normal_distribution<>()(rng); }));
  };
  const auto size = static_cast<Eigen::Index>(6 * unknowns);
  Matrices m{BlockCholesky(unknowns, pairs), Eigen::MatrixXd::Zero(size, size)};
  const auto block = [&](std::size_t row, std::size_t column) {
    return m.dense.block<6, 6>(static_cast<Eigen::Index>(6 * row),
                               static_cast<Eigen::Index>(6 * column));
  };
  for (std::size_t i = 0; i < unknowns; ++i) {
    m.sparse.add_diagonal(i, Matrix6d::Identity());
    block(i, i).setIdentity();
  }
  for (std::size_t p = 0; p < pairs.size(); ++p) {
    const auto [a, b] = pairs[p];
    const Matrix6d A = random(), B = random();
    m.sparse.add_diagonal(a, A.transpose() * A);
    m.sparse.add_diagonal(b, B.transpose() * B);
    m.sparse.add_pair(p, A.transpose() * B);
    block(a, a) += A.transpose() * A;
    block(b, b) += B.transpose() * B;
    block(a, b) += A.transpose() * B;
    block(b, a) += B.transpose() * A;
  }
  return m;
}

std::vector<Pair> chain(std::size_t unknowns) {
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i + 1 < unknowns; ++i) pairs.emplace_back(i, i + 1);
  return pairs;
}

Eigen::VectorXd random_vector(Eigen::Index size, std::mt19937& rng) {
  return Eigen::VectorXd::NullaryExpr(size, [&] { return std::normal_distribution<>()(rng); });
}

TEST(BlockCholesky, SolvesAsADenseFactorisationDoes) {
  std::mt19937 rng(1);
  for (const std::size_t unknowns : {1u, 2u, 9u, 40u}) {
    std::vector<Pair> pairs = chain(unknowns);
    std::uniform_int_distribution<std::size_t> pick(0, unknowns - 1);
    for (std::size_t extra = 0; extra < unknowns; ++extra) {
      const std::size_t a = pick(rng), b = pick(rng);
      if (a != b) pairs.emplace_back(a, b);  // now and then a pair that is there already
    }
    Matrices m = random_matrices(unknowns, pairs, rng);
    for (const double damping : {0.0, 0.5}) {
      Eigen::MatrixXd damped = m.dense;
      damped.diagonal() *= 1 + damping;
      const Eigen::VectorXd b = random_vector(damped.rows(), rng);
      ASSERT_TRUE(m.sparse.factorise(damping));
      EXPECT_LT((m.sparse.solve(b) - damped.ldlt().solve(b)).norm(), 1e-9 * b.norm());
    }
  }
}

TEST(BlockCholesky, SaysWhereAMatrixIsNotPositiveDefiniteAndKeepsIt) {
  std::mt19937 rng(2);
  Matrices m = random_matrices(7, chain(7), rng);
  m.sparse.add_diagonal(3, -1e6 * Matrix6d::Identity());
  EXPECT_FALSE(m.sparse.factorise(0));
  m.sparse.add_diagonal(3, 1e6 * Matrix6d::Identity());
  ASSERT_TRUE(m.sparse.factorise(0));
  const Eigen::VectorXd b = random_vector(42, rng);
  EXPECT_LT((m.sparse.solve(b) - m.dense.ldlt().solve(b)).norm(), 1e-6 * b.norm());
  m.sparse.add_diagonal(3, std::nan("") * Matrix6d::Identity());
  EXPECT_FALSE(m.sparse.factorise(0));
}

TEST(BlockCholesky, ADriveWithoutLoopsHasNoFill) {
  EXPECT_EQ(BlockCholesky(1000, chain(1000)).factor_blocks(), 1000u + 999u);
}

TEST(BlockCholesky, SetToZeroItForgets) {
  std::mt19937 rng(3);
  Matrices m = random_matrices(3, chain(3), rng);
  m.sparse.set_zero();
  for (std::size_t i = 0; i < 3; ++i) m.sparse.add_diagonal(i, 2 * Matrix6d::Identity());
  ASSERT_TRUE(m.sparse.factorise(0));
  const Eigen::VectorXd b = random_vector(18, rng);
  EXPECT_LT((m.sparse.solve(b) - 0.5 * b).norm(), 1e-14);
}

}  // namespace
}  // namespace cellmap
