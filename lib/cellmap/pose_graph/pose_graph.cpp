#include "cellmap/pose_graph/pose_graph.hpp"

#include <Eigen/Cholesky>
#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

/// Relative size of the asymmetry and of the negative eigenvalues that rounding may leave.
constexpr double kRoundingTolerance = 1e-6;

[[noreturn]] void refuse(const Constraint& constraint, const std::string& why) {
  throw Error(ErrorCode::kInvalidArgument, "the constraint from CELL " +
                                               std::to_string(constraint.from.value) + " to CELL " +
                                               std::to_string(constraint.to.value) + " " + why);
}

}  // namespace

std::string_view to_string(ConstraintKind kind) {
  switch (kind) {
    case ConstraintKind::kOdometry:
      return "odometry";
    case ConstraintKind::kBidirectional:
      return "bidirectional";
    case ConstraintKind::kLoop:
      return "loop";
  }
  return "unknown";
}

std::string_view to_string(ConstraintOrigin origin) {
  switch (origin) {
    case ConstraintOrigin::kMapper:
      return "mapper";
    case ConstraintOrigin::kDetection:
      return "detection";
    case ConstraintOrigin::kUser:
      return "user";
  }
  return "unknown";
}

void validate(const Constraint& constraint) {
  if (constraint.from == constraint.to) refuse(constraint, "ties a CELL to itself");
  if (!is_rigid(constraint.T_from_to)) refuse(constraint, "has a pose that is not rigid");
  const Matrix6d& information = constraint.information;
  if (!information.allFinite()) {
    refuse(constraint, "has an information matrix with a value that is not a finite number");
  }
  const double scale = information.cwiseAbs().maxCoeff();
  if ((information - information.transpose()).cwiseAbs().maxCoeff() > kRoundingTolerance * scale) {
    refuse(constraint, "has an information matrix that is not symmetric");
  }
  // A Cholesky factor of information + tolerance * I exists where no eigenvalue is below
  // -tolerance.
  const Matrix6d shifted = information + kRoundingTolerance * scale * Matrix6d::Identity();
  if (!(information.trace() > 0) || shifted.llt().info() != Eigen::Success) {
    refuse(constraint,
           "has an information matrix that is not positive semi-definite with a positive trace");
  }
}

}  // namespace cellmap
