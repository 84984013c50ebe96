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
/// the frame of `from`, twice the vector part of the quaternion's difference, and g2o's
/// information.
double ceres_example_cost(const PoseGraph& graph) {
  double cost = 0;
  for (const Constraint& c : graph.constraints) {
    const Pose T = graph.nodes.at(c.from).inverse() * graph.nodes.at(c.to);
    Eigen::Quaterniond dq(c.T_from_to.linear() * T.linear().transpose());
    if (dq.w() < 0) dq.coeffs() = -dq.coeffs();
    Tangent r;
    r << T.translation() - c.T_from_to.translation(), 2.0 * dq.vec();
    const Matrix6d Ad = adjoint(c.T_from_to);
    cost += 0.5 * r.dot(Ad.transpose() * c.information * Ad * r);
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

TEST(G2o, WhatIsWrongIsNamedWithItsLine) {
  const std::string vertex = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n";
  for (const std::string bad :
       {"VERTEX_SE3:QUAT 1 0 0 0 0 0 0\n", "VERTEX_SE3:QUAT 1 0 0 x 0 0 0 1\n",
        "VERTEX_SE3:QUAT 1 0 0 0 0 0 0 0\n", "VERTEX_SE3:QUAT 1 nan 0 0 0 0 0 1\n",
        "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n", "VERTEX_SE3:QUAT -1 0 0 0 0 0 0 1\n",
        "EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1 1 0 0\n",
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
  double ceres_cost;  ///< optimum of Ceres' example, 0 where none was published
};

class PublicGraphs : public testing::TestWithParam<PublicGraph> {};

/// Our residual differs from the example's in second order only, so its cost at our optimum can be
/// no lower than its own optimum and little higher.
TEST_P(PublicGraphs, AreOptimisedAsWellAsByTheStockExample) {
  const std::filesystem::path file = data_folder() / "g2o" / GetParam().file;
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is not there";
  PoseGraph graph = pose_graph_from_g2o(read_text(file));
  ASSERT_EQ(graph.nodes.size(), GetParam().nodes);
  PoseGraphOptions options;
  options.loop_loss_scale = 0;
  options.max_iterations = 200;

  const double before = ceres_example_cost(graph);
  const PoseGraphSummary summary = optimize(graph, options);
  const double after = ceres_example_cost(graph);

  EXPECT_TRUE(summary.converged);
  EXPECT_LT(after, 0.1 * before);
  if (GetParam().ceres_cost > 0) {
    EXPECT_GE(after, GetParam().ceres_cost * (1 - 1e-5));
    EXPECT_LE(after, GetParam().ceres_cost * 1.02);
  }
}

INSTANTIATE_TEST_SUITE_P(, PublicGraphs,
                         testing::Values(PublicGraph{"sphere2500.g2o", 2500, 675.756},
                                         PublicGraph{"parking-garage.g2o", 1661, 0.634188},
                                         PublicGraph{"smallGrid3D.g2o", 125, 0}),
                         [](const auto& info) { return "Number" + std::to_string(info.index); });

}  // namespace
}  // namespace cellmap
