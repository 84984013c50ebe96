#include "bench/ceres_example.hpp"

#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <map>
#include <vector>

namespace cellmap::bench {
namespace {

struct Node {
  Eigen::Vector3d p;
  Eigen::Quaterniond q;
};

struct RelativePoseError {
  Eigen::Vector3d p_measured;
  Eigen::Quaterniond q_measured;
  Matrix6d sqrt_information;

  template <typename T>
  bool operator()(const T* p_a, const T* q_a, const T* p_b, const T* q_b, T* out) const {
    using Vector3 = Eigen::Matrix<T, 3, 1>;
    using Quaternion = Eigen::Quaternion<T>;
    const Eigen::Map<const Vector3> from(p_a), to(p_b);
    const Eigen::Map<const Quaternion> turn_from(q_a), turn_to(q_b);
    const Quaternion back = turn_from.conjugate();
    const Vector3 p = back * (to - from);
    const Quaternion difference = q_measured.template cast<T>() * (back * turn_to).conjugate();
    Eigen::Map<Eigen::Matrix<T, 6, 1>> residual(out);
    residual.template head<3>() = p - p_measured.template cast<T>();
    residual.template tail<3>() = T(2.0) * difference.vec();
    residual.applyOnTheLeft(sqrt_information.template cast<T>());
    return true;
  }
};

/// From the left perturbation exp(xi) * T, where the position error is rho + phi x p and that of
/// the rotation, which the example turns around, -phi.
Matrix6d example_information(const Constraint& c) {
  Matrix6d to_xi = Matrix6d::Identity();  // xi = to_xi * (position error, rotation error)
  to_xi.topRightCorner<3, 3>() = -skew(c.T_from_to.translation());
  to_xi.bottomRightCorner<3, 3>() *= -1;
  return to_xi.transpose() * c.information * to_xi;
}

ceres::CostFunction* make_cost(const Constraint& c) {
  const Eigen::LLT<Matrix6d> llt(example_information(c));
  return new ceres::AutoDiffCostFunction<RelativePoseError, 6, 3, 4, 3, 4>(
      new RelativePoseError{c.T_from_to.translation(), Eigen::Quaterniond(c.T_from_to.linear()),
                            llt.matrixL().transpose()});
}

}  // namespace

void optimize_as_ceres_example(PoseGraph& graph, int threads) {
  std::map<CellId, Node> nodes;
  for (const auto& [id, T] : graph.nodes) {
    nodes[id] = {T.translation(), Eigen::Quaterniond(T.linear())};
  }
  ceres::Problem problem;
  auto* manifold = new ceres::EigenQuaternionManifold;
  for (const Constraint& c : graph.constraints) {
    Node &a = nodes.at(c.from), &b = nodes.at(c.to);
    problem.AddResidualBlock(make_cost(c), nullptr, a.p.data(), a.q.coeffs().data(), b.p.data(),
                             b.q.coeffs().data());
    problem.SetManifold(a.q.coeffs().data(), manifold);
    problem.SetManifold(b.q.coeffs().data(), manifold);
  }
  problem.SetParameterBlockConstant(nodes.begin()->second.p.data());
  problem.SetParameterBlockConstant(nodes.begin()->second.q.coeffs().data());

  ceres::Solver::Options options;
  options.max_num_iterations = 200;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.num_threads = threads;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  for (const auto& [id, node] : nodes) {
    Pose& T = graph.nodes.at(id);
    T.translation() = node.p;
    T.linear() = node.q.normalized().toRotationMatrix();
  }
}

}  // namespace cellmap::bench
