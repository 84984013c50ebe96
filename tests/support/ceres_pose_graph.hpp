#pragma once

#include <ceres/ceres.h>

#include <Eigen/Eigenvalues>
#include <array>
#include <map>
#include <set>

#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// The slow twin of `optimize`: the same cost as it is written down, given to Ceres with automatic
/// derivatives, quaternions and iteratively reweighted least squares.
class CeresPoseGraph {
 public:
  /// Fixed nodes: the lowest id, which is right for a graph in one piece.
  CeresPoseGraph(const PoseGraph& graph, double loop_loss_scale)
      : loss_(loop_loss_scale > 0 ? loop_loss_scale : 1.0), problem_(ownership()) {
    for (const auto& [id, T] : graph.nodes) {
      const auto [x, y, z, qx, qy, qz, qw] = to_xyz_qxyzw(T);
      blocks_[id] = {qx, qy, qz, qw, x, y, z};
    }
    for (const Constraint& constraint : graph.constraints) {
      const bool robust = constraint.kind == ConstraintKind::kLoop && loop_loss_scale > 0;
      problem_.AddResidualBlock(
          new ceres::AutoDiffCostFunction<Residual, 6, 7, 7>(new Residual(constraint)),
          robust ? &loss_ : nullptr, blocks_.at(constraint.from).data(),
          blocks_.at(constraint.to).data());
    }
    for (auto& [id, block] : blocks_) problem_.SetManifold(block.data(), &manifold_);
    problem_.SetParameterBlockConstant(blocks_.begin()->second.data());
  }

  ceres::Solver::Summary solve(int max_iterations, double tolerance) {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options.max_num_iterations = max_iterations;
    options.function_tolerance = options.parameter_tolerance = tolerance;
    options.gradient_tolerance = 0.1 * tolerance;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem_, &summary);
    return summary;
  }

  Pose pose(CellId id) const {
    const auto& [qx, qy, qz, qw, x, y, z] = blocks_.at(id);
    Pose T = Pose::Identity();
    T.linear() = Eigen::Quaterniond(qw, qx, qy, qz).normalized().toRotationMatrix();
    T.translation() << x, y, z;
    return T;
  }

 private:
  /// sqrt(information) * Ad(M) * log(M^-1 * T_from^-1 * T_to)
  class Residual {
   public:
    explicit Residual(const Constraint& constraint)
        : q_to_from_(Eigen::Quaterniond(constraint.T_from_to.linear().transpose()).normalized()),
          t_from_to_(constraint.T_from_to.translation()) {
      const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(constraint.information);
      whitening_ = solver.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal() *
                   solver.eigenvectors().transpose() * adjoint(constraint.T_from_to);
    }

    template <typename T>
    bool operator()(const T* from, const T* to, T* residual) const {
      using Vector3 = Eigen::Matrix<T, 3, 1>;
      const Eigen::Map<const Eigen::Quaternion<T>> q_from(from), q_to(to);
      const Eigen::Map<const Vector3> t_from(from + 4), t_to(to + 4);
      const Eigen::Quaternion<T> q_measured = q_to_from_.cast<T>();
      const Vector3 t_relative = q_from.conjugate() * (t_to - t_from);
      Eigen::Map<Eigen::Matrix<T, 6, 1>> out(residual);
      out = whitening_.cast<T>() * log<T>(q_measured * (q_from.conjugate() * q_to),
                                          q_measured * (t_relative - t_from_to_.cast<T>()));
      return true;
    }

   private:
    /// Written so that automatic derivatives are finite at the identity.
    template <typename T>
    static Eigen::Matrix<T, 6, 1> log(Eigen::Quaternion<T> q, const Eigen::Matrix<T, 3, 1>& t) {
      using std::atan2;
      using std::sqrt;
      if (q.w() < T(0)) q.coeffs() = -q.coeffs();
      const T n2 = q.vec().squaredNorm();
      T scale, c;  // phi = scale * vec(q); V^-1 = I - W / 2 + c W^2
      if (n2 < T(1e-12)) {
        scale = T(2) / q.w() * (T(1) - n2 / (T(3) * q.w() * q.w()));
        c = T(1.0 / 12.0) + n2 / T(180.0);
      } else {
        const T n = sqrt(n2);
        const T half = atan2(n, q.w());
        scale = T(2) * half / n;
        c = (T(1) - half * q.w() / n) / (T(4) * half * half);
      }
      const Eigen::Matrix<T, 3, 1> phi = scale * q.vec();
      const Eigen::Matrix<T, 3, 1> W_t = phi.cross(t);
      Eigen::Matrix<T, 6, 1> xi;
      xi << t - T(0.5) * W_t + c * phi.cross(W_t), phi;
      return xi;
    }

    Eigen::Quaterniond q_to_from_;
    Eigen::Vector3d t_from_to_;
    Matrix6d whitening_;
  };

  static ceres::Problem::Options ownership() {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }

  std::map<CellId, std::array<double, 7>> blocks_;  ///< quaternion (x, y, z, w), translation
  ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>> manifold_;
  ceres::CauchyLoss loss_;
  ceres::Problem problem_;
};

}  // namespace cellmap
