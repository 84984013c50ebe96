#include "cellmap/pipeline/back_end.hpp"

#include <algorithm>
#include <iterator>

#include "cellmap/geometry/angle.hpp"
#include "cellmap/map/junction.hpp"
#include "cellmap/place/pose_search.hpp"
#include "cellmap/pose_graph/frames.hpp"

namespace cellmap {
namespace {

PoseSigma odometry_sigma(const OdometryModel& model, double distance_m) {
  return {std::max(model.least_sigma_m, model.sigma_m_per_m * distance_m),
          kRadPerDeg * std::max(model.least_sigma_deg, model.sigma_deg_per_m * distance_m)};
}

/// The constraint that odometry gives two neighbours.
Constraint odometry_constraint(const Cell& previous, const Cell& next, const OdometryModel& model) {
  Constraint constraint;
  constraint.kind = ConstraintKind::kOdometry;
  constraint.T_from_to = previous.T_odom_cell.inverse() * next.T_odom_cell;
  const double distance = constraint.T_from_to.translation().norm();
  constraint.information = information_of(odometry_sigma(model, distance), constraint.T_from_to);
  return constraint;
}

/// The most likely pose given two measurements of it: where registration is weak (along a straight
/// road), odometry decides, and the information says how well.
void fuse(const RegistrationResult& registration, const PoseSigma& floor, Constraint& constraint) {
  const Pose& T_registered = registration.T_target_source;
  const Matrix6d measured = realistic_information(registration.information, T_registered, floor);
  const Matrix6d sum = measured + constraint.information;
  const Tangent to_odometry = log(constraint.T_from_to * T_registered.inverse());
  const Tangent step = sum.ldlt().solve(constraint.information * to_odometry);
  constraint.T_from_to = exp(step) * T_registered;
  constraint.information = 0.5 * (sum + sum.transpose());
  constraint.kind = ConstraintKind::kBidirectional;
  constraint.scores = registration.scores;
}

/// Poses of `after` that are not those of `before`.
std::map<CellId, Pose> changed_poses(const std::map<CellId, Pose>& before,
                                     const std::map<CellId, Pose>& after) {
  std::map<CellId, Pose> changed;
  for (const auto& [id, T] : after) {
    const auto old = before.find(id);
    if (old == before.end() || old->second.matrix() != T.matrix()) changed.emplace(id, T);
  }
  return changed;
}

void append(std::vector<Constraint>& all, const std::vector<Constraint>& some) {
  all.insert(all.end(), some.begin(), some.end());
}

}  // namespace

BackEnd::BackEnd(MapperOptions options, MapAccess access)
    : options_(std::move(options)), access_(std::move(access)) {
  options_.validate();
}

void BackEnd::resume_after(CellId id, FinishedCell last) {
  previous_ = Neighbour{id, std::move(last)};
}

CellUpdate BackEnd::integrate(FinishedCell finished, PoseGraph& graph) {
  Neighbour next{graph.new_cell_id(), std::move(finished)};
  CellUpdate update;
  update.id = next.id;
  update.cell = std::shared_ptr<const Cell>(next.cell.target, &next.cell.cell());
  update.scans = next.cell.scans;
  update.raw_points = next.cell.raw_points;
  update.voxel_points = next.cell.voxel_points;
  update.constraints = tie_to_previous(next.id, next.cell);
  const bool is_first = graph.nodes.empty();
  const Pose T_map_cell = update.constraints.empty() ? next.cell.cell().T_odom_cell
                                                     : graph.nodes.at(previous_->id) *
                                                           update.constraints.front().T_from_to;
  graph.nodes.emplace(next.id, T_map_cell);
  if (previous_ ? graph.unaligned.contains(previous_->id) : !is_first) {
    graph.unaligned.insert(next.id);
  }
  append(graph.constraints, update.constraints);
  close(next, graph, update);
  update.poses.emplace(next.id, T_map_cell);  // where nothing moved it since
  update.unaligned = graph.unaligned.contains(next.id);
  update.aligned.erase(next.id);
  previous_ = std::move(next);
  return update;
}

CellUpdate BackEnd::revisit(CellId id, FinishedCell cell, PoseGraph& graph) const {
  CellUpdate update;
  update.id = id;
  close({id, std::move(cell)}, graph, update);
  return update;
}

/// Joins islands, closes loops and optimises; the update gets what that changed. Without a closure
/// a new CELL follows its neighbour exactly.
void BackEnd::close(const Neighbour& cell, PoseGraph& graph, CellUpdate& update) const {
  const auto is_unchanged = [&, count = graph.constraints.size()] {
    return graph.constraints.size() == count;
  };
  const std::vector<Constraint> judged_before = graph.constraints;
  const std::map<CellId, Pose> before = graph.nodes;
  const std::set<CellId> unaligned = graph.unaligned;
  append(graph.constraints, join_islands(cell, graph));
  std::set<CellId> joined;
  std::ranges::set_difference(unaligned, graph.unaligned, std::inserter(joined, joined.end()));
  close_loops_of(joined, cell, graph);
  append(graph.constraints, close_loops(cell.id, cell.cell.points, targets_with(cell), graph));
  if (is_unchanged()) return;
  optimize(graph, options_.pose_graph);
  const auto first_new = std::ssize(judged_before) - std::ssize(update.constraints);
  update.constraints.assign(graph.constraints.begin() + first_new, graph.constraints.end());
  update.judged = judged_anew(judged_before, graph.constraints);
  update.poses = changed_poses(before, graph.nodes);
  update.aligned = std::move(joined);
}

std::vector<Constraint> BackEnd::tie_to_previous(CellId id, const FinishedCell& next) const {
  if (!previous_) return {};
  const FinishedCell& previous = previous_->cell;
  Constraint constraint = odometry_constraint(previous.cell(), next.cell(), options_.odometry);
  constraint.from = previous_->id;
  constraint.to = id;
  if (options_.bidirectional) {
    const RegistrationResult result =
        register_cells(*previous.target, thinned(previous.points, options_.registration_points),
                       *next.target, thinned(next.points, options_.registration_points),
                       constraint.T_from_to, options_.registration);
    if (is_believable(result, constraint.T_from_to))
      fuse(result, options_.registration_floor, constraint);
  }
  return {constraint};
}

bool BackEnd::is_believable(const RegistrationResult& result, const Pose& T_odometry) const {
  const Pose& T = result.T_target_source;
  return is_acceptable(result, options_.acceptance) &&
         (T.translation() - T_odometry.translation()).norm() <= options_.max_correction_m &&
         angle_between_rad(T, T_odometry) <= options_.max_correction_deg * kRadPerDeg;
}

TargetProvider BackEnd::targets_with(const Neighbour& next) const {
  return
      [this, &next](CellId id) { return id == next.id ? next.cell.target : access_.targets(id); };
}

std::vector<Constraint> BackEnd::close_loops(CellId id, const PointCloud& points,
                                             const TargetProvider& targets,
                                             const PoseGraph& graph) const {
  std::vector<Constraint> loops;
  if (!options_.loop_closures) return loops;
  for (const LoopClosure& closure : detect_loops(graph, id, points, targets, options_.loops)) {
    const bool is_known = std::ranges::any_of(graph.constraints, [&](const Constraint& c) {
      return std::minmax(c.from, c.to) == std::minmax(closure.from, closure.to);
    });
    if (!is_known) loops.push_back(to_constraint(closure, ConstraintOrigin::kMapper));
  }
  return loops;
}

/// When they came, nobody knew what is near them. The last ones: where the islands have met.
void BackEnd::close_loops_of(const std::set<CellId>& joined, const Neighbour& next,
                             PoseGraph& graph) const {
  constexpr int kMost = 50;
  const TargetProvider targets = targets_with(next);
  auto id = joined.rbegin();
  for (int i = 0; i < kMost && id != joined.rend(); ++i, ++id) {
    if (*id == next.id) continue;
    const FinishedCell cell = finished_without_scans(targets(*id));
    append(graph.constraints, close_loops(*id, cell.points, targets, graph));
  }
}

std::vector<Constraint> BackEnd::join_islands(const Neighbour& next, PoseGraph& graph) const {
  if (!options_.junctions || !access_.places) return {};
  const auto junction = find_junction(graph, next.id, next.cell.points, access_.places,
                                      targets_with(next), options_.junction);
  if (!junction) return {};
  bring_together(graph, *junction);
  std::vector<Constraint> closures;
  for (const LoopClosure& closure : junction->closures) {
    closures.push_back(to_constraint(closure, ConstraintOrigin::kMapper));
  }
  return closures;
}

}  // namespace cellmap
