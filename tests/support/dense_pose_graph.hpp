#pragma once

#include <Eigen/Cholesky>
#include <cmath>
#include <iterator>
#include <vector>

#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// The slow twin of `optimize`: the cost as it is written down, with the error as that of a left
/// perturbation, numeric derivatives and reweighted Gauss-Newton steps by dense matrices.
/// For a graph in one piece: the node with the lowest id is fixed.
///
/// The error: a rotation by the angle a about the unit axis n counts as phi = 2 sin(a / 2) n, and
/// the position is off by what a perturbation (rho, phi) of the measured one does, rho + phi x p.
inline Tangent left_error(const Pose& T, const Pose& measured) {
  const Eigen::AngleAxisd turn(T.linear() * measured.linear().transpose());
  const Eigen::Vector3d phi = 2 * std::sin(turn.angle() / 2) * turn.axis();
  const Eigen::Vector3d p = measured.translation();
  Tangent xi;
  xi << T.translation() - p - phi.cross(p), phi;
  return xi;
}

class DensePoseGraph {
 public:
  DensePoseGraph(PoseGraph graph, double loop_loss_scale)
      : graph_(std::move(graph)), c2_(loop_loss_scale * loop_loss_scale) {}

  const PoseGraph& graph() const { return graph_; }

  double cost() const {
    double sum = 0;
    for (const Constraint& c : graph_.constraints) {
      const double s = squared_error(c);
      const bool scaled = is_robust(c) && s > c2_;
      sum += scaled ? c2_ + 2 * c2_ * (s - c2_) / (s + c2_) : s;
    }
    return 0.5 * sum;
  }

  /// Until a step moves no node by more than a micrometre or microradian; false where none did.
  bool solve(int max_iterations = 500) {
    for (int i = 0; i < max_iterations; ++i) {
      const Eigen::VectorXd step = gauss_newton_step();
      for (auto& [id, T] : graph_.nodes) {
        if (column(id) >= 0) T = exp(Tangent(step.segment<6>(column(id)))) * T;
      }
      if (step.cwiseAbs().maxCoeff() < 1e-8) return true;
    }
    return false;
  }

 private:
  Tangent error(const Constraint& c, const Pose& T_from, const Pose& T_to) const {
    return left_error(T_from.inverse() * T_to, c.T_from_to);
  }
  Tangent error(const Constraint& c) const {
    return error(c, graph_.nodes.at(c.from), graph_.nodes.at(c.to));
  }
  double squared_error(const Constraint& c) const { return error(c).dot(c.information * error(c)); }
  bool is_robust(const Constraint& c) const { return c2_ > 0 && c.kind == ConstraintKind::kLoop; }

  Eigen::Index column(CellId id) const {
    return 6 * (std::distance(graph_.nodes.begin(), graph_.nodes.find(id)) - 1);
  }

  Eigen::VectorXd gauss_newton_step() const {
    const auto size = 6 * (static_cast<Eigen::Index>(graph_.nodes.size()) - 1);
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(size, size);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(size);
    for (const Constraint& c : graph_.constraints) {
      const double share =
          is_robust(c) ? std::min(1.0, std::pow(2 * c2_ / (c2_ + squared_error(c)), 2)) : 1.0;
      const Matrix6d W = share * c.information;
      const Matrix6d J[] = {derivative(c, true), derivative(c, false)};
      const Eigen::Index columns[] = {column(c.from), column(c.to)};
      for (const int i : {0, 1}) {
        if (columns[i] < 0) continue;
        b.segment<6>(columns[i]) -= J[i].transpose() * W * error(c);
        for (const int k : {0, 1}) {
          if (columns[k] < 0) continue;
          H.block<6, 6>(columns[i], columns[k]) += J[i].transpose() * W * J[k];
        }
      }
    }
    return H.llt().solve(b);
  }

  Matrix6d derivative(const Constraint& c, bool by_from) const {
    constexpr double kStep = 1e-5;
    const Pose &T_from = graph_.nodes.at(c.from), &T_to = graph_.nodes.at(c.to);
    Matrix6d J;
    for (int axis = 0; axis < 6; ++axis) {
      const Pose plus = exp(kStep * Tangent::Unit(axis)), minus = plus.inverse();
      J.col(axis) = (by_from ? error(c, plus * T_from, T_to) - error(c, minus * T_from, T_to)
                             : error(c, T_from, plus * T_to) - error(c, T_from, minus * T_to)) /
                    (2 * kStep);
    }
    return J;
  }

  PoseGraph graph_;
  double c2_;
};

}  // namespace cellmap
