#include "cellmap/archive/archive_precision.hpp"

#include <cmath>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr double kPositionStep_m = 0x1p-16, kRotationStep = 0x1p-28;
constexpr int kInformationDigits = 24;

double rounded(double value, double step) { return std::round(value / step) * step; }

double as_float(double value) { return static_cast<float>(value); }

Pose rounded(const Pose& T) {
  Pose result = T;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) {
      result(row, column) = rounded(T(row, column), column < 3 ? kRotationStep : kPositionStep_m);
    }
  }
  return is_rigid(result) ? result : T;
}

Matrix6d rounded(const Matrix6d& information) {
  const auto with_step = [&](double largest) {
    const double step = std::ldexp(1.0, std::ilogb(largest) + 1 - kInformationDigits);
    return Matrix6d(information.unaryExpr([&](double value) { return rounded(value, step); }));
  };
  const double largest = information.cwiseAbs().maxCoeff();
  if (!(largest > 0)) return information;
  // The largest may be rounded up to a power of two, which another time would mean larger steps.
  return with_step(with_step(largest).cwiseAbs().maxCoeff());
}

Constraint rounded(const Constraint& constraint) {
  Constraint result = constraint;
  result.T_from_to = rounded(constraint.T_from_to);
  result.information = rounded(constraint.information);
  RegistrationScores& scores = result.scores;
  for (double* score : {&scores.inlier_ratio_all, &scores.inlier_ratio_hit, &scores.share_in_front,
                        &scores.share_beyond, &scores.median_residual_m, &result.weight}) {
    *score = as_float(*score);
  }
  try {
    validate(result);
  } catch (const Error&) {
    return constraint;
  }
  return result;
}

}  // namespace

PoseGraph to_archive_precision(PoseGraph graph) {
  for (auto& [id, pose] : graph.nodes) pose = rounded(pose);
  for (Constraint& constraint : graph.constraints) constraint = rounded(constraint);
  return graph;
}

}  // namespace cellmap
