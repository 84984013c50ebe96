#include <cmath>
#include <string>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/registration/registration.hpp"

namespace cellmap {
namespace {

void require(bool holds, const std::string& rule) {
  if (!holds) throw Error(ErrorCode::kInvalidArgument, "registration options need " + rule);
}

void require_in(double value, double min, double max, const char* name) {
  if (value >= min && value <= max) return;
  throw Error(ErrorCode::kInvalidArgument, std::string(name) + " must be within " +
                                               std::to_string(min) + " and " + std::to_string(max) +
                                               "; given is " + std::to_string(value));
}

}  // namespace

std::vector<RegistrationStage> default_registration_stages() {
  constexpr std::size_t kCoarsePoints = 20'000;
  return {{4, 2.0, RobustKernel::kNone, 0.05, kCoarsePoints},
          {3, 1.0, RobustKernel::kNone, 0.05, kCoarsePoints},
          {3, 0.5, RobustKernel::kNone, 0.05, kCoarsePoints},
          {6, 0.5, RobustKernel::kGemanMcClure, 0.05, kCoarsePoints},
          {30, 0.5, RobustKernel::kGemanMcClure, 0.05}};
}

void RegistrationOptions::validate() const {
  for (const RegistrationStage& stage : stages) {
    require(stage.max_iterations >= 1 && stage.max_iterations <= 1000,
            "1 <= max_iterations <= 1000 in every stage");
    require(stage.gate_m > 0 && std::isfinite(stage.gate_m), "gate_m > 0 in every stage");
    require(stage.kernel_width_m > 0 && std::isfinite(stage.kernel_width_m),
            "kernel_width_m > 0 in every stage");
  }
  require(convergence_translation_m > 0, "convergence_translation_m > 0");
  require(convergence_rotation_rad > 0, "convergence_rotation_rad > 0");
  require(point_step >= 1, "point_step >= 1");
  require(reuse_share >= 0 && reuse_share <= 1, "0 <= reuse_share <= 1");
  require(min_points_in_gate >= 6, "min_points_in_gate >= 6");
  require(degeneracy_share >= 0 && degeneracy_share <= 1, "0 <= degeneracy_share <= 1");
  require(systematic_translation_m >= 0 && std::isfinite(systematic_translation_m),
          "systematic_translation_m >= 0");
  require(systematic_rotation_deg >= 0 && systematic_rotation_deg <= 180,
          "0 <= systematic_rotation_deg <= 180");
  require((systematic_translation_m == 0) == (systematic_rotation_deg == 0),
          "both systematic deviations or none");
  require(threads >= 0, "threads >= 0");
}

void AcceptanceOptions::validate() const {
  require_in(min_inlier_ratio_hit, 0, 1, "min_inlier_ratio_hit");
  require_in(max_share_in_front, 0, 1, "max_share_in_front");
  require_in(max_median_residual_m, 0, 1000, "max_median_residual_m");
  require_in(min_hit_share, 0, 1, "min_hit_share");
  require_in(min_inlier_ratio_all, 0, 1, "min_inlier_ratio_all");
}

}  // namespace cellmap
