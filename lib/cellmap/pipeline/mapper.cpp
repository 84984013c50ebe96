#include "cellmap/pipeline/mapper.hpp"

#include <algorithm>
#include <numbers>
#include <string>

#include "cellmap/cell/cell_builder.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/place/pose_search.hpp"

namespace cellmap {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

void require(bool holds, const char* rule) {
  if (!holds) throw Error(ErrorCode::kInvalidArgument, std::string("mapper options need ") + rule);
}

/// A finished CELL with what the next one is registered to.
struct FinishedCell {
  CellId id;
  std::shared_ptr<const RegistrationTarget> target;
  PointCloud base_scan;

  const Cell& cell() const { return target->cell(); }
};

PoseSigma odometry_sigma(const OdometryModel& model, double distance_m) {
  return {std::max(model.least_sigma_m, model.sigma_m_per_m * distance_m),
          kRadPerDeg * std::max(model.least_sigma_deg, model.sigma_deg_per_m * distance_m)};
}

/// The constraint that odometry gives two neighbours.
Constraint odometry_constraint(const FinishedCell& previous, const FinishedCell& next,
                               const OdometryModel& model) {
  Constraint constraint;
  constraint.from = previous.id;
  constraint.to = next.id;
  constraint.kind = ConstraintKind::kOdometry;
  constraint.T_from_to = previous.cell().T_odom_cell.inverse() * next.cell().T_odom_cell;
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
  pose_graph.validate();
}

struct Mapper::Impl {
  MapperOptions options;
  std::string session;
  std::shared_ptr<const Lattice> lattice;
  PoseGraph graph;
  TargetProvider targets;
  Pose T_map_odom;

  std::optional<LocalMap> local_map{};
  std::optional<CellBuilder> builder{};  // of the local map
  std::uint64_t raw_points = 0;          // of the scans of the local map
  std::uint32_t next_sequence = 0;
  std::optional<FinishedCell> previous{};

  void begin_local_map(Scan scan, const PosedScan& raw) {
    local_map.emplace(std::move(scan), raw.T_odom_sensor, static_cast<std::uint32_t>(raw.index));
    builder.emplace(*lattice, options.build);
    builder->update(*local_map);
    raw_points = raw.points.size();
  }

  void extend_local_map(const Scan& scan, const PosedScan& raw) {
    local_map->add(scan, raw.T_odom_sensor);
    builder->update(*local_map);
    raw_points += raw.points.size();
  }

  /// One finished local map becomes a CELL, is tied to its neighbour and to earlier visits, and the
  /// map is made consistent.
  CellUpdate finish_cell() {
    FinishedCell next = make_cell();
    std::vector<Constraint> constraints = tie_to_previous(next);
    add_to_graph(next, constraints);
    const std::vector<Constraint> loops = close_loops(next);
    std::map<CellId, Pose> poses;  // without a loop the new one follows its neighbour exactly
    if (!loops.empty()) poses = optimise_graph();
    poses[next.id] = graph.nodes.at(next.id);
    constraints.insert(constraints.end(), loops.begin(), loops.end());
    CellUpdate update = report(next, std::move(constraints), std::move(poses));
    previous = std::move(next);
    return update;
  }

  FinishedCell make_cell() {
    Cell cell = builder->finish(*local_map);
    cell.session = session;
    cell.sequence = next_sequence++;
    FinishedCell next;
    next.id = {graph.nodes.empty() ? 1u : graph.nodes.rbegin()->first.value + 1u};
    next.target = std::make_shared<const RegistrationTarget>(
        std::make_shared<const Cell>(std::move(cell)), lattice);
    next.base_scan = local_map->base_scan().points;
    return next;
  }

  std::vector<Constraint> tie_to_previous(const FinishedCell& next) const {
    if (!previous) return {};
    Constraint constraint = odometry_constraint(*previous, next, options.odometry);
    if (options.bidirectional) {
      const RegistrationResult result = register_cells(
          *previous->target, thinned(previous->base_scan, options.registration_points),
          *next.target, thinned(next.base_scan, options.registration_points), constraint.T_from_to,
          options.registration);
      if (is_believable(result, constraint.T_from_to))
        fuse(result, options.registration_floor, constraint);
    }
    return {constraint};
  }

  bool is_believable(const RegistrationResult& result, const Pose& T_odometry) const {
    const Pose& T = result.T_target_source;
    return is_acceptable(result, options.acceptance) &&
           (T.translation() - T_odometry.translation()).norm() <= options.max_correction_m &&
           angle_between_rad(T, T_odometry) <= options.max_correction_deg * kRadPerDeg;
  }

  void add_to_graph(const FinishedCell& next, const std::vector<Constraint>& constraints) {
    graph.nodes[next.id] = constraints.empty()
                               ? T_map_odom * next.cell().T_odom_cell
                               : graph.nodes.at(previous->id) * constraints.front().T_from_to;
    graph.constraints.insert(graph.constraints.end(), constraints.begin(), constraints.end());
  }

  std::vector<Constraint> close_loops(const FinishedCell& next) {
    if (!options.loop_closures) return {};
    const TargetProvider with_own = [&](CellId id) {
      return id == next.id ? next.target : targets(id);
    };
    std::vector<Constraint> loops;
    for (const LoopClosure& closure :
         detect_loops(graph, next.id, next.base_scan, with_own, options.loops)) {
      loops.push_back(to_constraint(closure, ConstraintOrigin::kMapper));
    }
    graph.constraints.insert(graph.constraints.end(), loops.begin(), loops.end());
    return loops;
  }

  /// Makes the map consistent; returns the poses that changed.
  std::map<CellId, Pose> optimise_graph() {
    const std::map<CellId, Pose> before = graph.nodes;
    optimize(graph, options.pose_graph);
    std::map<CellId, Pose> moved;
    for (const auto& [id, T] : graph.nodes) {
      if (before.at(id).matrix() != T.matrix()) moved.emplace(id, T);
    }
    return moved;
  }

  CellUpdate report(const FinishedCell& next, std::vector<Constraint> constraints,
                    std::map<CellId, Pose> poses) const {
    CellUpdate update;
    update.id = next.id;
    update.cell = std::shared_ptr<const Cell>(next.target, &next.target->cell());
    update.scans = local_map->scans();
    update.constraints = std::move(constraints);
    update.raw_points = raw_points;
    update.poses = std::move(poses);
    return update;
  }
};

Mapper::Mapper(MapperOptions options, std::string session, std::shared_ptr<const Lattice> lattice,
               PoseGraph graph, TargetProvider targets, const Pose& T_map_odom)
    : impl_(new Impl{std::move(options), std::move(session), std::move(lattice), std::move(graph),
                     std::move(targets), T_map_odom}) {
  impl_->options.validate();
}

Mapper::~Mapper() = default;
Mapper::Mapper(Mapper&&) noexcept = default;

void Mapper::resume_after(CellId id, std::shared_ptr<const Cell> last, const PosedScan& base_scan) {
  if (base_scan.index != last->first_scan) {
    throw Error(ErrorCode::kInvalidArgument, "to resume, scan " + std::to_string(last->first_scan) +
                                                 " of the drive was expected, found scan " +
                                                 std::to_string(base_scan.index));
  }
  if (!impl_->graph.nodes.contains(id)) {
    throw Error(ErrorCode::kInvalidArgument,
                "to resume, CELL " + std::to_string(id.value) + " must be in the pose graph");
  }
  impl_->next_sequence = last->sequence + 1;
  FinishedCell previous;
  previous.id = id;
  previous.target = std::make_shared<const RegistrationTarget>(std::move(last), impl_->lattice);
  previous.base_scan = filter_scan(base_scan.points, base_scan.stamp, impl_->options.filter).points;
  impl_->previous = std::move(previous);
}

std::optional<CellUpdate> Mapper::add(const PosedScan& raw) {
  Scan scan = filter_scan(raw.points, raw.stamp, impl_->options.filter);
  std::optional<CellUpdate> update;
  std::optional<LocalMap>& local_map = impl_->local_map;
  if (local_map && !local_map->is_complete_for(raw.T_odom_sensor, impl_->options.cell_distance_m)) {
    impl_->extend_local_map(scan, raw);
    return update;
  }
  if (local_map) update = impl_->finish_cell();
  impl_->begin_local_map(std::move(scan), raw);
  return update;
}

std::optional<CellUpdate> Mapper::finish() {
  if (!impl_->local_map) return std::nullopt;
  CellUpdate update = impl_->finish_cell();
  impl_->local_map.reset();
  impl_->builder.reset();
  return update;
}

const PoseGraph& Mapper::graph() const { return impl_->graph; }

}  // namespace cellmap
