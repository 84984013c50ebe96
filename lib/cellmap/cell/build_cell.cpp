#include "cellmap/cell/build_cell.hpp"

#include <string>

#include "cellmap/cell/cell_builder.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

void require(bool holds, const char* rule, double value) {
  if (!holds) {
    throw Error(ErrorCode::kInvalidArgument,
                std::string("CELL building needs ") + rule + "; given is " + std::to_string(value));
  }
}

}  // namespace

std::string to_string(PlaneFit fit) {
  switch (fit) {
    case PlaneFit::kTrimmed:
      return "trimmed";
    case PlaneFit::kRansac:
      return "ransac";
    case PlaneFit::kStreaming:
      break;
  }
  return "streaming";
}

std::optional<PlaneFit> plane_fit_from(std::string_view name) {
  for (const auto fit : {PlaneFit::kTrimmed, PlaneFit::kRansac, PlaneFit::kStreaming}) {
    if (name == to_string(fit)) return fit;
  }
  return std::nullopt;
}

void CellBuildOptions::validate() const {
  require(max_range_gap_m > 0 && max_range_gap_m <= 1000, "0 < max_range_gap_m <= 1000",
          max_range_gap_m);
  require(min_points >= 3 && min_points <= 1'000'000, "3 <= min_points <= 1000000", min_points);
  require(max_plane_rms_m >= 0 && max_plane_rms_m <= 100, "0 <= max_plane_rms_m <= 100",
          max_plane_rms_m);
  require(max_thickness_ratio > 0 && max_thickness_ratio <= 1, "0 < max_thickness_ratio <= 1",
          max_thickness_ratio);
  require(max_normal_error_deg > 0 && max_normal_error_deg <= 90, "0 < max_normal_error_deg <= 90",
          max_normal_error_deg);
  require(min_grazing_angle_deg >= 0 && min_grazing_angle_deg < 90,
          "0 <= min_grazing_angle_deg < 90", min_grazing_angle_deg);
  require(range_margin_m >= 0 && range_margin_m <= 1000, "0 <= range_margin_m <= 1000",
          range_margin_m);
  require(trim_rms_factor >= 1 && trim_rms_factor <= 100, "1 <= trim_rms_factor <= 100",
          trim_rms_factor);
  require(ransac_draws >= 1 && ransac_draws <= 10'000, "1 <= ransac_draws <= 10000", ransac_draws);
  require(ransac_inlier_m > 0 && ransac_inlier_m <= 10, "0 < ransac_inlier_m <= 10",
          ransac_inlier_m);
  require(threads >= 0, "threads >= 0", threads);
}

Cell build_cell(const LocalMap& local_map, const Lattice& lattice,
                const CellBuildOptions& options) {
  return CellBuilder(lattice, options).finish(local_map);
}

}  // namespace cellmap
