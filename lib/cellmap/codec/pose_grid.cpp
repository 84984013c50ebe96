#include "cellmap/codec/pose_grid.hpp"

#include <cmath>

#include "cellmap/core/error.hpp"

namespace cellmap {

GridPose to_grid(const Pose& T) {
  constexpr double kMax_m = static_cast<double>(kMaxGridTranslation) * kGridTranslationStep_m;
  if (!is_rigid(T) || T.translation().cwiseAbs().maxCoeff() > kMax_m) {
    throw Error(ErrorCode::kCorruptData,
                "a pose is not a rigid transform of finite numbers within 16,777 km of the origin");
  }
  Eigen::Quaterniond q(T.linear());
  q.normalize();
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const Eigen::Vector3d rotation = q.vec() / (1 + q.w());
  GridPose grid;
  for (int axis = 0; axis < 3; ++axis) {
    grid.translation[axis] = std::llround(T.translation()[axis] / kGridTranslationStep_m);
    grid.rotation[axis] = std::llround(rotation[axis] / kGridRotationStep);
  }
  return grid;
}

Pose from_grid(const GridPose& grid) {
  // FORMAT.md prescribes every operation and its order; the first two lines are exact.
  const double x = static_cast<double>(grid.rotation[0]) * kGridRotationStep;
  const double y = static_cast<double>(grid.rotation[1]) * kGridRotationStep;
  const double z = static_cast<double>(grid.rotation[2]) * kGridRotationStep;
  const double xx = x * x, yy = y * y, zz = z * z, s = xx + yy + zz;
  const double d = (1 + s) * (1 + s), c = 4 * (1 - s);
  Pose T = Pose::Identity();
  T.linear() << 1 - 8 * (yy + zz) / d, (8 * x * y - c * z) / d, (8 * x * z + c * y) / d,
      (8 * x * y + c * z) / d, 1 - 8 * (xx + zz) / d, (8 * y * z - c * x) / d,
      (8 * x * z - c * y) / d, (8 * y * z + c * x) / d, 1 - 8 * (xx + yy) / d;
  for (int axis = 0; axis < 3; ++axis) {
    T.translation()[axis] = static_cast<double>(grid.translation[axis]) * kGridTranslationStep_m;
  }
  return T;
}

}  // namespace cellmap
