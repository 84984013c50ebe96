#include "cellmap/pipeline/mapper_options.hpp"

#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

void require(bool holds, const char* rule) {
  if (!holds) throw Error(ErrorCode::kInvalidArgument, std::string("mapper options need ") + rule);
}

}  // namespace

void OdometryModel::validate() const {
  require(sigma_m_per_m >= 0 && sigma_m_per_m <= 10, "0 <= odometry.sigma_m_per_m <= 10");
  require(sigma_deg_per_m >= 0 && sigma_deg_per_m <= 90, "0 <= odometry.sigma_deg_per_m <= 90");
  require(least_sigma_m > 0 && least_sigma_m <= 100, "0 < odometry.least_sigma_m <= 100");
  require(least_sigma_deg > 0 && least_sigma_deg <= 90, "0 < odometry.least_sigma_deg <= 90");
}

void MapperOptions::validate() const {
  require(cell_distance_m > 0 && cell_distance_m <= 1000, "0 < cell_distance_m <= 1000");
  require(max_correction_m > 0, "max_correction_m > 0");
  require(max_correction_deg > 0, "max_correction_deg > 0");
  require(registration_points >= 100, "registration_points >= 100");
  filter.validate();
  build.validate();
  registration.validate();
  acceptance.validate();
  odometry.validate();
  require(registration_floor.translation_m > 0, "registration_floor.translation_m > 0");
  require(registration_floor.rotation_rad > 0, "registration_floor.rotation_rad > 0");
  loops.validate();
  junction.validate();
  pose_graph.validate();
}

}  // namespace cellmap
