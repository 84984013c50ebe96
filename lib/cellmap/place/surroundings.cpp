#include "cellmap/place/surroundings.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "cellmap/place/structure_score.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kPartSectors = 12, kPartRings = 4;
constexpr std::uint32_t kFewestVisible = 20;

struct Votes {
  std::uint32_t visible = 0, tight = 0;
};

std::size_t part_of(const Eigen::Vector3f& p) {
  const double turn = std::atan2(p.y(), p.x()) / (2 * std::numbers::pi) + 0.5;
  const auto sector = std::min(static_cast<std::size_t>(turn * kPartSectors), kPartSectors - 1);
  const float range = p.norm();
  const std::size_t ring = range < 10 ? 0 : range < 20 ? 1 : range < 40 ? 2 : 3;
  return sector * kPartRings + ring;
}

/// Where the scan is in the frame of a CELL, by the CELL.
Pose settled(const CellAround& cell, const PointCloud& few, const Pose& T_map_scan,
             const RegistrationOptions& given) {
  constexpr double kMostM = 0.5;
  const Pose start = cell.T_map_cell.inverse() * T_map_scan;
  RegistrationOptions options = given;
  options.stages = {{4, 0.5, RobustKernel::kCauchy, 0.2},
                    {3, 0.5, RobustKernel::kGemanMcClure, 0.1}};
  options.min_points_in_gate = 50;
  options.judge = false;
  options.threads = 1;
  const Pose T = register_scan(*cell.target, few, start, options).T_target_source;
  return (T.translation() - start.translation()).norm() < kMostM ? T : start;
}

}  // namespace

SurroundingsScores score_surroundings(std::span<const CellAround> cells, const ScanView& scan,
                                      const PointCloud& few, const Pose& T_map_scan,
                                      const RegistrationOptions& registration) {
  std::array<Votes, kPartSectors * kPartRings> parts{};
  double agreeing = 0, in_front = 0;
  for (const CellAround& cell : cells) {
    const Pose T_cell_scan = settled(cell, few, T_map_scan, registration);
    const StructurePoints forward = structure_points(*cell.target, few, T_cell_scan);
    agreeing += forward.inliers;
    in_front += forward.in_front;
    look_at_upright_planes(*cell.target, scan, T_cell_scan, 1,
                           [&](const Eigen::Vector3f& at, const PlaneSeen& seen) {
                             Votes& votes = parts[part_of(at)];
                             votes.visible += !seen.hidden;
                             votes.tight += seen.tight;
                           });
    registration.give_way();
  }
  SurroundingsScores scores;
  scores.cells = static_cast<std::uint32_t>(cells.size());
  for (const Votes& votes : parts) {
    if (votes.visible < kFewestVisible) continue;
    ++scores.parts;
    scores.agreement += static_cast<double>(votes.tight) / votes.visible;
  }
  if (scores.parts > 0) scores.agreement /= scores.parts;
  if (agreeing > 0) scores.free_ratio = agreeing / (agreeing + in_front);
  return scores;
}

double agreement(const SurroundingsScores& scores) {
  return scores.agreement + 0.3 * scores.free_ratio;
}

}  // namespace cellmap
