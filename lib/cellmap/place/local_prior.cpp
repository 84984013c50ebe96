#include "cellmap/place/local_prior.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "cellmap/place/polar_image.hpp"

namespace cellmap {

LocalPrior::LocalPrior(const PosePrior& prior, const Pose& T_map_cell)
    : prior_(prior), T_cell_query_(T_map_cell.inverse() * prior.T_map_scan) {}

bool LocalPrior::allows(const Pose& T_cell_query, double margin_m, double margin_rad) const {
  const Eigen::Vector2d apart =
      (T_cell_query.translation() - T_cell_query_.translation()).head<2>();
  const double turn = yaw_of(T_cell_query_.inverse() * T_cell_query);
  return apart.norm() <= prior_.radius_m + margin_m &&
         std::abs(turn) <= prior_.yaw_range_rad + margin_rad;
}

std::vector<Pose> LocalPrior::grid(const Pose& T_cell_ground, const Pose& T_ground_query) const {
  const int turns =
      static_cast<int>(std::ceil(std::min(prior_.yaw_range_rad, std::numbers::pi) / kGridStepRad));
  const int steps =
      static_cast<int>(std::ceil(std::min(prior_.radius_m, kCellReachM) / kGridStepM));
  std::vector<Pose> poses;
  for (int i = -steps; i <= steps; ++i) {
    for (int j = -steps; j <= steps; ++j) {
      const double x = T_cell_query_.translation().x() + i * kGridStepM;
      const double y = T_cell_query_.translation().y() + j * kGridStepM;
      if (std::hypot(x, y) > kCellReachM) continue;
      for (int k = -turns; k <= turns; ++k) {
        const Pose pose = T_cell_ground *
                          upright_pose(x, y, yaw_of(T_cell_query_) + k * kGridStepRad) *
                          T_ground_query;
        if (allows(pose, 0.0, kGridStepRad)) poses.push_back(pose);
      }
    }
  }
  return poses;
}

}  // namespace cellmap
