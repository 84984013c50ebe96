#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {
namespace {

std::filesystem::path data_folder() {
  const char* given = std::getenv("CELLMAP_DATA");
  return given != nullptr ? std::filesystem::path(given)
                          : std::filesystem::path(CELLMAP_SOURCE_DIR "/../shared/data");
}

std::string read_text(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

/// Half chi-square as Ceres' stock pose-graph example defines it: the translation's difference in
/// the frame of `from`, twice the vector part of the quaternion's difference, and the file's
/// information (by now in the graph).
double ceres_example_cost(const PoseGraph& graph) {
  double cost = 0;
  for (const Constraint& c : graph.constraints) {
    const Pose T = graph.nodes.at(c.from).inverse() * graph.nodes.at(c.to);
    Eigen::Quaterniond dq(c.T_from_to.linear() * T.linear().transpose());
    if (dq.w() < 0) dq.coeffs() = -dq.coeffs();
    Tangent r;
    r << T.translation() - c.T_from_to.translation(), 2.0 * dq.vec();
    // Back to the file's matrix: rho = dp - phi x p with phi = -2 vec(dq).
    Matrix6d left_from_r = -Matrix6d::Identity();
    left_from_r.topLeftCorner<3, 3>() *= -1;
    left_from_r.topRightCorner<3, 3>() = -skew(c.T_from_to.translation());
    cost += 0.5 * r.dot(left_from_r.transpose() * c.information * left_from_r * r);
  }
  return cost;
}

TEST(G2o, TextRoundTrips) {
  std::mt19937 rng(1);
  std::normal_distribution<double> normal;
  const auto random_tangent = [&] {
    Tangent xi;
    for (double& value : xi) value = normal(rng);
    return xi;
  };
  PoseGraph graph;
  for (std::uint32_t i = 0; i < 5; ++i) graph.nodes[{i}] = exp(random_tangent());
  for (const auto& [from, to] : {std::pair{0u, 1u}, {1u, 2u}, {0u, 4u}}) {
    Constraint c;
    c.from = {from};
    c.to = {to};
    c.T_from_to = exp(random_tangent());
    c.information = Matrix6d::Identity();
    for (int i = 0; i < 6; ++i) {
      const Tangent v = random_tangent();
      c.information += v * v.transpose();
    }
    graph.constraints.push_back(c);
  }

  const PoseGraph read = pose_graph_from_g2o(to_g2o(graph));

  ASSERT_EQ(read.nodes.size(), 5u);
  for (const auto& [id, T] : graph.nodes) {
    EXPECT_LT((read.nodes.at(id).matrix() - T.matrix()).norm(), 1e-12);
  }
  ASSERT_EQ(read.constraints.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    const Constraint &a = graph.constraints[i], &b = read.constraints[i];
    EXPECT_EQ(a.from, b.from);
    EXPECT_EQ(a.to, b.to);
    EXPECT_LT((a.T_from_to.matrix() - b.T_from_to.matrix()).norm(), 1e-12);
    EXPECT_LT((a.information - b.information).norm(), 1e-9 * a.information.norm());
  }
  EXPECT_EQ(read.constraints[0].kind, ConstraintKind::kOdometry);
  EXPECT_EQ(read.constraints[2].kind, ConstraintKind::kLoop);
}

TEST(G2o, TheInformationIsThatOfAPerturbationFromTheRight) {
  // Certain along y of the frame of `to`, which is x of the frame of `from`.
  const std::string text =
      "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 0 0 0 0 0 0 1\n"
      "EDGE_SE3:QUAT 0 1 0 0 0 0 0 -0.70710678118654752 0.70710678118654752 "
      "1 0 0 0 0 0 100 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n";
  const Constraint edge = pose_graph_from_g2o(text).constraints.at(0);
  EXPECT_NEAR(edge.information(0, 0), 100, 1e-9);
  EXPECT_NEAR(edge.information(1, 1), 1, 1e-9);
}

TEST(G2o, AsCeresExampleReadsItTheInformationIsInTheAxesOfFromAndWhitenedByL) {
  // Certain along y of the frame of `from`; rotation and position are tied.
  const std::string text =
      "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 0 0 0 0 0 0 1\n"
      "EDGE_SE3:QUAT 0 1 3 0 0 0 0 -0.70710678118654752 0.70710678118654752 "
      "1 0 0 0 0 0 100 0 0 0 20 1 0 0 0 1 0 0 1 0 10\n";
  const Constraint edge =
      pose_graph_from_g2o(text, G2oInformation::kCeresExample).constraints.at(0);
  // The square of the example's residual for a small left perturbation.
  std::mt19937 rng(2);
  std::normal_distribution<double> normal(0, 1e-6);
  for (int i = 0; i < 10; ++i) {
    Tangent xi;
    for (double& value : xi) value = normal(rng);
    const Pose T = exp(xi) * edge.T_from_to;
    Tangent r;
    r.head<3>() = T.translation() - edge.T_from_to.translation();
    r.tail<3>() = 2 * Eigen::Quaterniond(edge.T_from_to.linear() * T.linear().transpose()).vec();
    // L of [100 20; 20 10] is [10 0; 2 sqrt(6)], applied to (y, angle about z).
    const double y = 10 * r.y(), turn = 2 * r.y() + std::sqrt(6.0) * r[5];
    const double squared =
        r.x() * r.x() + y * y + r.z() * r.z() + r[3] * r[3] + r[4] * r[4] + turn * turn;
    EXPECT_NEAR(xi.dot(edge.information * xi), squared, 1e-4 * squared);
  }
}

TEST(G2o, PlanarGraphsAreLiftedAndStayInThePlane) {
  const double quarter = M_PI / 2;
  std::string text;
  for (const char* edge : {"0 1", "1 2", "2 3", "3 0"}) {
    text += std::string("EDGE_SE2 ") + edge + " 2 0 " + std::to_string(quarter) +
            " 500 -36 -390 390 525 300000 \n";
  }
  PoseGraph graph = pose_graph_from_g2o(text);
  ASSERT_EQ(graph.nodes.size(), 4u);  // along a tree, since the file has no vertices
  EXPECT_LT((graph.nodes.at({2}).translation() - Eigen::Vector3d(2, 2, 0)).norm(), 1e-5);
  const Matrix6d& information = graph.constraints[0].information;
  Tangent along = Tangent::Zero();
  along.y() = 1e-3;  // the frame of `to` looks along y of `from`
  EXPECT_NEAR(along.dot(information * along), 500e-6, 1e-9);
  graph.nodes.at({3}).translation() += Eigen::Vector3d(0.3, -0.2, 0);
  EXPECT_TRUE(optimize(graph).converged);
  for (const auto& [id, T] : graph.nodes) {
    EXPECT_LT(std::abs(T.translation().z()), 1e-9);
    EXPECT_GT(T.linear()(2, 2), 1 - 1e-9);
  }
}

TEST(G2o, WhatIsWrongIsNamedWithItsLine) {
  const std::string vertex = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n";
  for (const std::string bad :
       {"VERTEX_SE3:QUAT 1 0 0 0 0 0 0\n", "VERTEX_SE3:QUAT 1 0 0 x 0 0 0 1\n",
        "VERTEX_SE3:QUAT 1 0 0 0 0 0 0 0\n", "VERTEX_SE3:QUAT 1 nan 0 0 0 0 0 1\n",
        "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n", "VERTEX_SE3:QUAT -1 0 0 0 0 0 0 1\n",
        "EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1 1 0 0\n", "VERTEX_SE3:QUAT 1 1e9 0 0 0 0 0 1\n",
        "VERTEX_SE3:QUAT 1 0 0 0 0 0 0 1 7\n", "VERTEX_SE2 1 0 0\n", "VERTEX_XY 1 0 0\n",
        "EDGE_SE2_XY 0 1 0 0 1 0 1\n", "EDGE_SE2 0 1 0 0 0 1 0 0 -1 0 1\n",
        "EDGE_SE2 0 1 0 0 0 1 0 0 inf 0 1\n",
        "EDGE_SE3:QUAT 0 0 0 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n"}) {
    try {
      pose_graph_from_g2o(vertex + bad);
      ADD_FAILURE() << bad;
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::kCorruptData);
      EXPECT_NE(std::string(error.what()).find("line 2"), std::string::npos) << error.what();
    }
  }
}

TEST(G2o, AnEdgeToAMissingVertexIsRefused) {
  EXPECT_THROW(pose_graph_from_g2o("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n"
                                   "EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1 "
                                   "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n"),
               Error);
}

struct PublicGraph {
  const char* file;
  std::size_t nodes;
  double ceres_cost;  ///< what Ceres' example ends at
};

class PublicGraphs : public testing::TestWithParam<PublicGraph> {};

TEST_P(PublicGraphs, EndAtNoHigherCostThanCeresExampleFromBothStarts) {
  const std::filesystem::path file = data_folder() / "g2o" / GetParam().file;
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is not there";
  const PoseGraph given = pose_graph_from_g2o(read_text(file), G2oInformation::kCeresExample);
  ASSERT_EQ(given.nodes.size(), GetParam().nodes);
  for (const GraphStart start : {GraphStart::kGiven, GraphStart::kBest}) {
    PoseGraph graph = given;
    PoseGraphOptions options;
    options.loop_loss_scale = 0;
    options.start = start;

    const PoseGraphSummary summary = optimize(graph, options);

    EXPECT_TRUE(summary.converged);
    EXPECT_NEAR(summary.initial_cost, ceres_example_cost(given), 1e-9 * summary.initial_cost);
    EXPECT_NEAR(summary.final_cost, ceres_example_cost(graph), 1e-6 * summary.final_cost);
    EXPECT_LE(ceres_example_cost(graph), GetParam().ceres_cost * (1 + 1e-5));
  }
}

INSTANTIATE_TEST_SUITE_P(, PublicGraphs,
                         testing::Values(PublicGraph{"sphere2500.g2o", 2500, 675.756},
                                         PublicGraph{"parking-garage.g2o", 1661, 0.634188},
                                         PublicGraph{"smallGrid3D.g2o", 125, 512.6991}),
                         [](const auto& info) { return "Number" + std::to_string(info.index); });

TEST(NoisySphere, ConvergesInFewStepsFromTheChordalStart) {
  const std::filesystem::path file = data_folder() / "g2o" / "sphere_bignoise_vertex3.g2o";
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is not there";
  PoseGraph graph = pose_graph_from_g2o(read_text(file), G2oInformation::kCeresExample);
  PoseGraphOptions options;
  options.loop_loss_scale = 0;
  options.start = GraphStart::kBest;
  const PoseGraphSummary summary = optimize(graph, options);
  EXPECT_TRUE(summary.converged);
  EXPECT_LE(summary.iterations, 10);
  EXPECT_LE(ceres_example_cost(graph), 1.47835e6 * (1 + 1e-5));
}

}  // namespace
}  // namespace cellmap
