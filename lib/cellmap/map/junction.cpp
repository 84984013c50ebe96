#include "cellmap/map/junction.hpp"

#include <algorithm>

#include "cellmap/cell/cell.hpp"
#include "cellmap/geometry/angle.hpp"
#include "cellmap/pose_graph/frames.hpp"
#include "cellmap/pose_graph/paths.hpp"

namespace cellmap {
namespace {

/// The CELLs nearest to `query` along the constraints, nearest first.
std::vector<std::pair<double, CellId>> nearest_along(const PoseGraph& graph, CellId query,
                                                     std::size_t count) {
  std::vector<std::pair<double, CellId>> nearest;
  for (const auto& [cell, path_m] : path_lengths(adjacency_of(graph), query)) {
    if (cell != query) nearest.emplace_back(path_m, cell);
  }
  const auto end = nearest.begin() + std::ssize(nearest);
  const auto middle = nearest.begin() + std::min(std::ssize(nearest), std::ptrdiff_t(count));
  std::partial_sort(nearest.begin(), middle, end);
  nearest.erase(middle, end);
  return nearest;
}

std::optional<LoopCandidate> nearest_in(const Frames& islands, CellId island,
                                        const PoseGraph& graph, const Pose& T_island_query,
                                        double max_distance_m) {
  std::optional<LoopCandidate> nearest;
  for (const auto& [id, pose] : graph.nodes) {
    const double distance = (pose.translation() - T_island_query.translation()).norm();
    if (distance > (nearest ? nearest->distance_m : max_distance_m)) continue;
    if (islands.of(id) != island) continue;
    nearest = LoopCandidate{id, pose.inverse() * T_island_query, distance};
  }
  return nearest;
}

}  // namespace

std::optional<Junction> find_junction(const PoseGraph& graph, CellId query,
                                      const PointCloud& query_scan, const PlaceProvider& places,
                                      const TargetProvider& targets,
                                      const JunctionOptions& options) {
  options.validate();
  const Frames islands(graph);
  if (islands.count() < 2) return std::nullopt;
  Junction junction;
  junction.island = islands.of(query);
  const auto neighbours = nearest_along(graph, query, options.neighbours);
  if (neighbours.size() < options.confirmations) return std::nullopt;

  const PoseGraph elsewhere = islands.without(junction.island, graph);
  const RelocalisationAnswer answer = places(elsewhere)->relocalise(
      query_scan, elsewhere, targets, std::nullopt, options.relocalise);
  if (!answer.found) return std::nullopt;
  junction.other = islands.of(answer.found->cell);
  junction.T_other_island = answer.found->T_map_scan * graph.nodes.at(query).inverse();
  junction.closures.push_back({answer.found->cell, query, answer.found->registration});

  for (const auto& [path_m, neighbour] : neighbours) {
    if (junction.closures.size() > options.confirmations) break;
    auto guess =
        nearest_in(islands, junction.other, graph,
                   junction.T_other_island * graph.nodes.at(neighbour), options.max_distance_m);
    if (!guess) continue;
    guess->path_m = path_m;
    const auto target = targets(neighbour);
    const PointCloud points = reconstruct_points(target->cell(), target->lattice());
    auto closure =
        verify_loop(*targets(guess->cell), *target, points, *guess, neighbour, options.confirm);
    if (!closure) continue;
    const Pose& T_measured = closure->result.T_target_source;
    const Pose difference = guess->T_candidate_query.inverse() * T_measured;
    if (difference.translation().norm() >
            options.max_difference_m + options.confirm.drift_m_per_m * path_m ||
        angle_between_rad(guess->T_candidate_query, T_measured) >
            kRadPerDeg * (options.max_difference_deg + options.confirm.drift_deg_per_m * path_m)) {
      continue;
    }
    junction.closures.push_back(std::move(*closure));
  }
  if (junction.closures.size() <= options.confirmations) return std::nullopt;
  return junction;
}

void bring_together(PoseGraph& graph, const Junction& junction) {
  const bool island_is_aligned = !graph.unaligned.contains(junction.island);
  const bool other_is_aligned = !graph.unaligned.contains(junction.other);
  const bool other_stays =
      island_is_aligned == other_is_aligned ? junction.other < junction.island : other_is_aligned;
  const Pose T = other_stays ? junction.T_other_island : junction.T_other_island.inverse();
  for (const CellId id : Frames(graph).cells(other_stays ? junction.island : junction.other)) {
    graph.nodes.at(id) = T * graph.nodes.at(id);
    if (island_is_aligned || other_is_aligned) graph.unaligned.erase(id);
  }
}

}  // namespace cellmap
