#include "cellmap/place/loop_detection.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <queue>
#include <span>
#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/core/parallel.hpp"
#include "cellmap/geometry/angle.hpp"
#include "cellmap/place/polar_image.hpp"
#include "cellmap/pose_graph/frames.hpp"
#include "cellmap/pose_graph/information.hpp"
#include "cellmap/pose_graph/paths.hpp"

namespace cellmap {
namespace {

/// A guess is this uncertain however short the path.
constexpr double kLeastShiftM = 2.0, kLeastTurnDeg = 5.0;
/// What a registration reaches from one start on a wide gate.
constexpr double kReachM = 3.0;

/// CELLs within `hops` neighbours of `query` in its session, itself included.
std::map<CellId, std::size_t> session_neighbours(const Adjacency& adjacency, CellId query,
                                                 std::size_t hops) {
  std::map<CellId, std::size_t> distance{{query, 0}};
  std::queue<CellId> open;
  for (open.push(query); !open.empty(); open.pop()) {
    const std::size_t next = distance.at(open.front()) + 1;
    const auto found = adjacency.find(open.front());
    if (next > hops || found == adjacency.end()) continue;
    for (const Neighbour& neighbour : found->second) {
      if (neighbour.in_session && distance.emplace(neighbour.cell, next).second) {
        open.push(neighbour.cell);
      }
    }
  }
  return distance;
}

/// How far a closure may lie from its guess.
struct Allowance {
  double shift_m, turn_rad;

  Allowance(double path_m, const LoopOptions& options)
      : shift_m(kLeastShiftM + options.drift_m_per_m * path_m),
        turn_rad(kRadPerDeg * (kLeastTurnDeg + options.drift_deg_per_m * path_m)) {}

  bool allows(const Pose& guess, const Pose& found) const {
    return (guess.translation() - found.translation()).norm() <= shift_m &&
           angle_between_rad(guess, found) <= turn_rad;
  }
};

/// A CELL that may close loops, with what all its candidates are compared with.
struct LoopQuery {
  CellId id;
  const RegistrationTarget& target;
  const PointCloud& scan;
  RecentredImages images;

  LoopQuery(CellId query_id, const RegistrationTarget& query, const PointCloud& query_scan)
      : id(query_id), target(query), scan(query_scan), images(query_scan) {}
};

/// The guess, turned by 5 deg either way, and the best alignments of the images that are allowed.
std::vector<Pose> starting_poses(const RegistrationTarget& candidate, const LoopQuery& query,
                                 const LoopCandidate& guess, const LoopOptions& options) {
  const Pose& T = guess.T_candidate_query;
  std::vector<Pose> starts = {T};
  if (options.drift_m_per_m * guess.path_m < 1.0) return starts;
  for (const double turn_deg : {-5.0, 5.0}) {
    starts.push_back(T * upright_pose(0, 0, turn_deg * kRadPerDeg));
  }
  Allowance allowance(guess.path_m, options);
  allowance.shift_m += kReachM;
  allowance.turn_rad += 6 * kRadPerDeg;
  const PolarImage image(reconstruct_points(candidate.cell(), candidate.lattice()));
  for (const Alignment& alignment : query.images.align(image, 4 * options.seeds)) {
    if (starts.size() >= options.seeds + 3) break;
    Pose start = alignment.T_cell_scan;
    start.translation().z() = 0;
    // Drift in height is as free as any other; the images say nothing of it.
    Pose level_guess = T;
    level_guess.translation().z() = 0;
    if (allowance.allows(level_guess, start)) starts.push_back(start);
  }
  return starts;
}

/// Whether the candidate's own points, registered to the query's CELL, find the same pose.
bool reverse_agrees(const RegistrationTarget& candidate, const RegistrationTarget& query,
                    const Pose& T_candidate_query, const LoopOptions& options) {
  const PointCloud points = reconstruct_points(candidate.cell(), candidate.lattice());
  const RegistrationResult reverse =
      register_scan(query, points, T_candidate_query.inverse(), options.registration);
  const Pose difference = T_candidate_query * reverse.T_target_source;
  return reverse.converged && difference.translation().norm() <= options.max_reverse_difference_m &&
         angle_between_rad(Pose::Identity(), difference) <=
             options.max_reverse_difference_deg * kRadPerDeg;
}

bool is_believed(const RegistrationTarget& candidate, const LoopQuery& query,
                 const LoopCandidate& guess, const RegistrationResult& result,
                 const LoopOptions& options) {
  if (options.accept == LoopAcceptance::kPaper) {
    return result.converged && result.scores.inlier_ratio_all >= kPaperInlierRatio;
  }
  const Pose& T = result.T_target_source;
  return is_acceptable(result, options.acceptance) &&
         is_acceptable(score_structure(candidate, thinned(query.scan, options.refine_points), T),
                       options.structure) &&
         Allowance(guess.path_m, options).allows(guess.T_candidate_query, T) &&
         reverse_agrees(candidate, query.target, T, options);
}

std::optional<LoopClosure> verify(const RegistrationTarget& candidate, const LoopQuery& query,
                                  const LoopCandidate& guess, const LoopOptions& options) {
  const PoseSearchOptions search = options.search();
  const std::vector<Pose> starts = starting_poses(candidate, query, guess, options);
  const auto found = search_poses(candidate, query.scan, starts, search);
  constexpr std::size_t kRefined = 2;
  for (std::size_t i = 0; i < std::min(kRefined, found.size()); ++i) {
    const RegistrationResult result =
        refine_pose(candidate, query.scan, found[i].T_target_source, search);
    if (is_believed(candidate, query, guess, result, options)) {
      return LoopClosure{guess.cell, query.id, result};
    }
  }
  return std::nullopt;
}

/// Those of the candidates that pass.
std::vector<LoopClosure> verify_all(std::span<const LoopCandidate> candidates,
                                    const LoopQuery& query, const TargetProvider& targets,
                                    const LoopOptions& options, int threads) {
  std::vector<std::shared_ptr<const RegistrationTarget>> loaded;  // a provider has one caller
  for (const LoopCandidate& candidate : candidates) loaded.push_back(targets(candidate.cell));
  std::vector<std::optional<LoopClosure>> verified(candidates.size());
  parallel_for(candidates.size(), 1, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      verified[i] = verify(*loaded[i], query, candidates[i], options);
    }
  });
  std::vector<LoopClosure> closures;
  for (std::optional<LoopClosure>& closure : verified) {
    if (closure) closures.push_back(std::move(*closure));
  }
  return closures;
}

}  // namespace

std::vector<LoopCandidate> find_loop_candidates(const PoseGraph& graph, CellId query,
                                                const LoopOptions& options) {
  const auto own = graph.nodes.find(query);
  if (own == graph.nodes.end()) {
    throw Error(ErrorCode::kNotFound,
                "CELL " + std::to_string(query.value) + " is not in the pose graph");
  }
  const Adjacency adjacency = adjacency_of(graph);
  const auto excluded = session_neighbours(adjacency, query, options.exclude_latest);
  std::vector<LoopCandidate> found;
  for (const auto& [id, T_map_cell] : graph.nodes) {
    const double distance = (T_map_cell.translation() - own->second.translation()).norm();
    if (distance > options.max_distance_m || excluded.contains(id)) continue;
    found.push_back({id, T_map_cell.inverse() * own->second, distance});
  }
  if (!graph.unaligned.empty()) {
    const Frames islands(graph);
    std::erase_if(found, [&](const LoopCandidate& candidate) {
      return islands.of(candidate.cell) != islands.of(query);
    });
  }
  std::stable_sort(found.begin(), found.end(), [](const LoopCandidate& a, const LoopCandidate& b) {
    return a.distance_m < b.distance_m;
  });
  if (found.size() > options.candidates) found.resize(options.candidates);
  if (found.empty()) return found;
  const auto lengths = path_lengths(adjacency, query);
  for (LoopCandidate& candidate : found) {
    const auto length = lengths.find(candidate.cell);
    candidate.path_m =
        length == lengths.end() ? std::numeric_limits<double>::infinity() : length->second;
  }
  return found;
}

std::optional<LoopClosure> verify_loop(const RegistrationTarget& candidate,
                                       const RegistrationTarget& query,
                                       const PointCloud& query_scan, const LoopCandidate& guess,
                                       CellId query_id, const LoopOptions& options) {
  return verify(candidate, LoopQuery(query_id, query, query_scan), guess, options);
}

std::vector<LoopClosure> detect_loops(const PoseGraph& graph, CellId query,
                                      const PointCloud& query_scan, const TargetProvider& targets,
                                      const LoopOptions& options) {
  const std::vector<LoopCandidate> candidates = find_loop_candidates(graph, query, options);
  if (candidates.empty()) return {};
  const auto own = targets(query);
  const LoopQuery loop_query(query, *own, query_scan);
  LoopOptions serial = options;
  serial.registration.threads = 1;
  std::vector<LoopClosure> closures;
  for (std::size_t begin = 0; begin < candidates.size() && closures.size() < options.closures;) {
    const std::size_t count =
        std::min(options.closures - closures.size(), candidates.size() - begin);
    const auto next = std::span(candidates).subspan(begin, count);
    std::ranges::move(verify_all(next, loop_query, targets, serial, options.registration.threads),
                      std::back_inserter(closures));
    begin += count;
  }
  return closures;
}

Constraint to_constraint(const LoopClosure& closure, ConstraintOrigin origin) {
  Constraint constraint;
  constraint.from = closure.from;
  constraint.to = closure.to;
  constraint.T_from_to = closure.result.T_target_source;
  constraint.information = realistic_information(closure.result.information, constraint.T_from_to);
  constraint.kind = ConstraintKind::kLoop;
  constraint.origin = origin;
  constraint.scores = closure.result.scores;
  return constraint;
}

}  // namespace cellmap
