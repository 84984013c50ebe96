#include "client/cli/evaluate_map.hpp"

#include <time.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "cellmap/place/polar_image.hpp"
#include "cellmap/simulation/random.hpp"
#include "cellmap/store/read_cell.hpp"

namespace cellmap::cli {
namespace {

/// Where the truth lies as seen from the nearest CELL in sight.
void describe_place(const PoseGraph& graph, const Pose& truth, RelocalisationTrial& trial) {
  trial.distance_m = std::numeric_limits<double>::infinity();
  for (const auto& [id, T_map_cell] : graph.nodes) {
    const Eigen::Vector3d apart = T_map_cell.inverse() * truth.translation();
    if (apart.norm() >= trial.distance_m) continue;
    trial.distance_m = apart.norm();
    trial.lateral_m = std::abs(apart.y());
  }
}

/// Of one thread the time that it worked, whatever else the machine does.
double now_ms(bool of_this_thread) {
  timespec now{};
  ::clock_gettime(of_this_thread ? CLOCK_THREAD_CPUTIME_ID : CLOCK_MONOTONIC, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

const RelocalisationCandidate* best_of(const RelocalisationAnswer& answer) {
  if (answer.found) return &*answer.found;
  return answer.alternatives.empty() ? nullptr : &answer.alternatives.front();
}

}  // namespace

void KnownMap::add(CellId id, std::shared_ptr<const Cell> cell, const Pose& T_map_cell) {
  index.add(id, *cell, *lattice);
  graph.nodes[id] = T_map_cell;
  targets[id] = std::make_shared<const RegistrationTarget>(std::move(cell), lattice);
}

std::shared_ptr<const RegistrationTarget> KnownMap::target(CellId id) const {
  const auto parts = invented.find(id);
  if (parts == invented.end()) return targets.at(id);
  return std::make_shared<const RegistrationTarget>(
      std::make_shared<const Cell>(put_together(parts->second)), lattice);
}

Cell KnownMap::put_together(const std::pair<CellId, CellId>& parts) const {
  const Cell &front = targets.at(parts.first)->cell(), &back = targets.at(parts.second)->cell();
  Cell cell = front;
  cell.indices.clear();
  cell.planes.clear();
  std::size_t i = 0, j = 0;
  for (std::uint32_t k = 0; k < lattice->size(); ++k) {  // the indices of a CELL ascend
    while (i < front.indices.size() && front.indices[i] < k) ++i;
    while (j < back.indices.size() && back.indices[j] < k) ++j;
    const bool is_ahead = lattice->direction(k).x() > 0;
    const Cell& of = is_ahead ? front : back;
    const std::size_t at = is_ahead ? i : j;
    if (at >= of.indices.size() || of.indices[at] != k) continue;
    cell.indices.push_back(k);
    cell.planes.push_back(of.planes[at]);
  }
  return cell;
}

void KnownMap::grow_to(std::size_t cells, std::uint64_t seed) {
  constexpr double kFarOffM = 1e5, kSpacingM = 6.45;
  std::vector<CellId> seen;
  for (const auto& [id, target] : targets) seen.push_back(id);
  if (seen.empty()) return;
  simulation::Random random(seed);
  const auto any = [&] { return seen[random.next() % seen.size()]; };
  std::uint32_t next = seen.back().value + 1;
  for (std::size_t n = seen.size(); n < cells; ++n, ++next) {
    const CellId id{next};
    invented[id] = {any(), any()};
    index.add(id, put_together(invented[id]), *lattice);
    graph.nodes[id] = upright_pose(kFarOffM + kSpacingM * static_cast<double>(n), 0, 0);
  }
}

KnownMap load_known_map(const Store& store, const std::string& name) {
  KnownMap map;
  map.lattice = std::make_shared<const Lattice>(store.map(name).lattice);
  for (const auto& [id, T_map_cell] : store.pose_graph(name).nodes) {
    const auto bytes = read_encoded_cell(store, name, id).bytes;
    map.add(id, std::make_shared<const Cell>(decode_cell(bytes)), T_map_cell);
  }
  return map;
}

Asked ask(const KnownMap& map, const KnownQuery& query, const RelocaliseOptions& options) {
  PoseGraph visible;
  visible.nodes = map.graph.nodes;
  for (const CellId id : query.hidden) visible.nodes.erase(id);
  Asked asked;
  RelocalisationTrial& trial = asked.trial;
  trial.mapped = query.mapped;
  describe_place(visible, query.T_map_query, trial);

  // Inventing CELLs takes time that a map does not.
  double inventing_ms = 0;
  const TargetProvider targets = [&](CellId id) {
    const double begun_ms = now_ms(options.threads == 1);
    auto target = map.target(id);
    inventing_ms += now_ms(options.threads == 1) - begun_ms;
    return target;
  };
  const double begun_ms = now_ms(options.threads == 1);
  const RelocalisationAnswer answer = map.index.relocalise(query.query, visible, targets, options);
  trial.query_ms = now_ms(options.threads == 1) - begun_ms - inventing_ms;

  trial.accepted = answer.found.has_value();
  trial.error_m = trial.error_deg = std::numeric_limits<double>::infinity();
  if (const RelocalisationCandidate* best = best_of(answer)) {
    asked.best = *best;
    trial.confidence = best->confidence;
    trial.error_m = (best->T_map_scan.translation() - query.T_map_query.translation()).norm();
    trial.error_deg =
        angle_between_rad(best->T_map_scan, query.T_map_query) * 180 / std::numbers::pi;
  }
  return asked;
}

std::vector<CellId> cells_where(const KnownMap& map,
                                const std::function<bool(CellId, const Pose&)>& condition) {
  std::vector<CellId> cells;
  for (const auto& [id, T_map_cell] : map.graph.nodes) {
    if (condition(id, T_map_cell)) cells.push_back(id);
  }
  return cells;
}

}  // namespace cellmap::cli
