#include "cellmap/place/place_trials.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "cellmap/core/parallel.hpp"
#include "cellmap/place/polar_image.hpp"
#include "cellmap/registration/residuals.hpp"

namespace cellmap {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;
constexpr double kGridStepM = 2.0, kGridStepRad = 5.0 * kRadPerDeg;
/// Places farther apart than this are not the same.
constexpr double kSamePlaceM = 5.0;
/// A place that is not clear by itself is believed where it agrees better than others by this.
constexpr double kDominates = 0.3;
/// And only where query and CELL look alike from above, too.
constexpr double kLooksAlike = 0.35;

/// Some of the points, evenly taken: three quarters of them upright structure where there is
/// enough.
PointCloud mostly_upright(const PointCloud& upright, const PointCloud& ground, std::size_t count) {
  PointCloud some = thinned(upright, count / 2);
  some.append(thinned(ground, count > some.size() ? count - some.size() : 1));
  return some;
}

/// Upright surfaces of a query that knows its normals.
UprightSurfaces surfaces_of(const RelocalisationQuery& query, const Eigen::Vector3d& up) {
  UprightSurfaces surfaces;
  for (std::size_t i = 0; i < query.normals.size(); ++i) {
    if (std::abs(up.dot(query.normals[i].cast<double>())) >= 0.7) continue;
    surfaces.points.push_back(query.points[i]);
    surfaces.normals.push_back(query.normals[i]);
  }
  return surfaces;
}

ResidualHistogram residuals_of(const RegistrationTarget& target, const PointCloud& points,
                               const Pose& T_cell_query) {
  const auto& borders = ResidualHistogram::kBordersM;
  ResidualHistogram histogram;
  for (const float r :
       MatchedTerm({&target, &points, false}, 1).distances(T_cell_query).distance_m) {
    const auto bin = std::upper_bound(borders.begin(), borders.end(), static_cast<double>(r));
    ++histogram.points[static_cast<std::size_t>(bin - borders.begin())];
  }
  return histogram;
}

/// A start, or what became of it.
struct Attempt {
  std::size_t place = 0;
  RegistrationResult result;
};

RegistrationOptions staged(const RelocaliseOptions& options,
                           std::vector<RegistrationStage> stages) {
  RegistrationOptions registration = options.registration;
  registration.stages = std::move(stages);
  registration.min_points_in_gate = std::min<std::size_t>(registration.min_points_in_gate, 50);
  registration.threads = 1;
  return registration;
}

/// The grid poses at which a few hundred points agree best with the CELL, best first.
std::vector<Pose> best_of_grid(const RegistrationTarget& target, const PointCloud& few,
                               const std::vector<Pose>& grid, std::size_t count) {
  std::vector<std::pair<double, std::size_t>> ranked;
  for (std::size_t i = 0; i < grid.size(); ++i) {
    const RegistrationScores scores = score_scan(target, few, grid[i]);
    if (scores.hits * 10 < scores.points) continue;
    ranked.push_back({scores.median_residual_m + scores.share_in_front, i});
  }
  std::sort(ranked.begin(), ranked.end());
  std::vector<Pose> best;
  for (std::size_t i = 0; i < std::min(count, ranked.size()); ++i) {
    best.push_back(grid[ranked[i].second]);
  }
  return best;
}

bool is_refined(const RelocalisationCandidate& candidate) {
  return candidate.structure.points > 0 || candidate.structure.planes > 0;
}

double distance_m(const RelocalisationCandidate& a, const RelocalisationCandidate& b) {
  return (a.T_map_scan.translation() - b.T_map_scan.translation()).norm();
}

bool better(const RelocalisationCandidate& a, const RelocalisationCandidate& b) {
  if (a.accepted != b.accepted) return a.accepted;
  if (is_refined(a) != is_refined(b)) return is_refined(a);
  if (is_refined(a)) return a.confidence > b.confidence;
  return agreement(a.registration.scores) > agreement(b.registration.scores);
}

/// One search: what it is about and how far it has come.
class Trials {
 public:
  Trials(const std::vector<PlaceToTry>& places, const QueryPoints& query,
         const std::optional<PosePrior>& prior, const RelocaliseOptions& options)
      : places_(places), query_(query), prior_(prior), options_(options) {}

  std::vector<RelocalisationCandidate> run() {
    screen();
    search();
    decide();
    return std::move(candidates_);
  }

 private:
  bool allowed(const Attempt& attempt) const {
    return !prior_ || LocalPrior(*prior_, places_[attempt.place].T_map_cell)
                          .allows(attempt.result.T_target_source, 1.0, kGridStepRad);
  }

  Pose in_map(const Attempt& attempt) const {
    return places_[attempt.place].T_map_cell * attempt.result.T_target_source;
  }

  bool same_answer(const Attempt& a, const Attempt& b) const {
    const Pose T_a = in_map(a), T_b = in_map(b);
    return a.place == b.place && (T_a.translation() - T_b.translation()).norm() < 0.3 &&
           angle_between_rad(T_a, T_b) < 0.03;
  }

  void sort_attempts() {
    std::stable_sort(attempts_.begin(), attempts_.end(), [](const Attempt& a, const Attempt& b) {
      return agreement(a.result.scores) > agreement(b.result.scores);
    });
  }

  /// Registers a few hundred points from every start.
  void screen() {
    std::vector<std::vector<Attempt>> of_place(places_.size());
    const RegistrationOptions registration = staged(
        options_, {{10, 3.0, RobustKernel::kCauchy, 0.6}, {5, 1.0, RobustKernel::kCauchy, 0.3}});
    parallel_for(places_.size(), 1, options_.threads, [&](std::size_t p, std::size_t) {
      std::vector<Pose> starts = places_[p].starts;
      if (prior_) {
        const auto from_grid =
            best_of_grid(*places_[p].target, query_.screen,
                         LocalPrior(*prior_, places_[p].T_map_cell)
                             .grid(places_[p].T_cell_ground, query_.T_ground_query),
                         options_.starts);
        starts.insert(starts.end(), from_grid.begin(), from_grid.end());
      }
      for (const Pose& start : starts) {
        of_place[p].push_back(
            {p, register_scan(*places_[p].target, query_.screen, start, registration)});
      }
    });
    for (auto& attempts : of_place) {
      attempts_.insert(attempts_.end(), attempts.begin(), attempts.end());
    }
    std::erase_if(attempts_, [&](const Attempt& a) { return !allowed(a); });
    sort_attempts();
  }

  /// The best attempts, no two alike, some of them elsewhere to compare with.
  void keep_best() {
    const std::size_t elsewhere_wanted = 2;
    std::vector<Attempt> kept;
    std::size_t elsewhere = 0;
    for (const Attempt& attempt : attempts_) {
      const bool known = std::any_of(kept.begin(), kept.end(),
                                     [&](const Attempt& k) { return same_answer(k, attempt); });
      if (known) continue;
      const bool is_elsewhere =
          !kept.empty() &&
          (in_map(attempt).translation() - in_map(kept.front()).translation()).norm() > kSamePlaceM;
      if (kept.size() >= options_.searched && !(is_elsewhere && elsewhere < elsewhere_wanted)) {
        continue;
      }
      elsewhere += is_elsewhere;
      kept.push_back(attempt);
    }
    attempts_ = std::move(kept);
  }

  RegistrationOptions search_registration() const {
    return staged(options_, {{6, 2.0, RobustKernel::kCauchy, 0.5},
                             {4, 1.0, RobustKernel::kCauchy, 0.2},
                             {8, 0.5, RobustKernel::kGemanMcClure, 0.1}});
  }

  /// Registers a few thousand points from where the best attempts have come.
  void search() {
    keep_best();
    const RegistrationOptions registration = search_registration();
    parallel_for(attempts_.size(), 1, options_.threads, [&](std::size_t i, std::size_t) {
      Attempt& attempt = attempts_[i];
      attempt.result = register_scan(*places_[attempt.place].target, query_.search,
                                     attempt.result.T_target_source, registration);
    });
    std::erase_if(attempts_, [&](const Attempt& a) { return !allowed(a); });
    sort_attempts();
    for (const Attempt& attempt : attempts_) {
      RelocalisationCandidate candidate;
      candidate.cell = places_[attempt.place].cell;
      candidate.similarity = places_[attempt.place].merit;
      candidate.registration = attempt.result;
      candidate.T_cell_scan = attempt.result.T_target_source;
      candidate.T_map_scan = in_map(attempt);
      candidates_.push_back(candidate);
    }
  }

  /// Registers many points and says how far the pose is to be believed.
  void refine(std::size_t i) {
    RelocalisationCandidate& candidate = candidates_[i];
    const PlaceToTry& place = places_[attempts_[i].place];
    const RegistrationOptions registration = staged(
        options_,
        {{3, 0.5, RobustKernel::kGemanMcClure, 0.1}, {20, 0.5, RobustKernel::kGemanMcClure, 0.05}});
    candidate.registration =
        register_scan(*place.target, query_.refine, candidate.T_cell_scan, registration);
    candidate.T_cell_scan = candidate.registration.T_target_source;
    candidate.T_map_scan = place.T_map_cell * candidate.T_cell_scan;
    candidate.registration.scores = score_scan(*place.target, query_.scored, candidate.T_cell_scan);
    Attempt refined{attempts_[i].place, candidate.registration};
    if (!allowed(refined)) return;
    candidate.structure = score_structure(*place.target, query_.scored, candidate.T_cell_scan);
    score_facing(*place.target, query_.surfaces, candidate.T_cell_scan, candidate.structure);
    candidate.residuals = residuals_of(*place.target, query_.scored, candidate.T_cell_scan);
    candidate.confidence = confidence_of(candidate.structure);
  }

  /// The best few, and the best few elsewhere, which show whether the first stand out.
  std::vector<std::size_t> worth_refining() const {
    constexpr std::size_t kBest = 3, kElsewhere = 2;
    std::vector<std::size_t> chosen;
    std::size_t elsewhere = 0;
    for (std::size_t i = 0; i < candidates_.size(); ++i) {
      const bool is_elsewhere = distance_m(candidates_[i], candidates_.front()) > kSamePlaceM;
      if (i >= kBest && !(is_elsewhere && elsewhere < kElsewhere)) continue;
      elsewhere += is_elsewhere;
      chosen.push_back(i);
    }
    return chosen;
  }

  bool is_believed(const RelocalisationCandidate& candidate) const {
    return candidate.confidence >= options_.min_confidence &&
           is_acceptable(candidate.registration, options_.acceptance) &&
           (prior_ || !candidate.registration.degeneracy.degenerate);
  }

  void decide() {
    if (candidates_.empty()) return;
    refine(0);
    compare_best();
    if (!is_believed(candidates_[0]) || !is_clear(candidates_[0])) {
      const std::vector<std::size_t> chosen = worth_refining();
      parallel_for(chosen.size(), 1, options_.threads, [&](std::size_t k, std::size_t) {
        if (chosen[k] != 0) refine(chosen[k]);
      });
      std::stable_sort(candidates_.begin(), candidates_.end(), better);
      compare_best();
    }
    RelocalisationCandidate& best = candidates_[0];
    best.accepted =
        is_believed(best) &&
        (is_clear(best) || (best.dominance >= kDominates && best.similarity >= kLooksAlike));
  }

  /// Whether it needs no comparison with other places: much is confirmed, or another CELL agrees.
  static bool is_clear(const RelocalisationCandidate& candidate) {
    constexpr double kMuch = 0.62;
    return candidate.structure.tight_ratio >= kMuch ||
           (candidate.witnesses > 0 && candidate.similarity >= kLooksAlike);
  }

  /// What the other places say of the best one.
  void compare_best() {
    RelocalisationCandidate& best = candidates_.front();
    best.dominance = 1.0;
    best.witnesses = 0;
    for (const RelocalisationCandidate& other : candidates_) {
      const double metres = distance_m(best, other);
      if (is_refined(other) && metres > kSamePlaceM) {
        best.dominance =
            std::min(best.dominance, agreement(best.structure) - agreement(other.structure));
      }
      best.witnesses += other.cell != best.cell && metres <= 0.5 &&
                        angle_between_rad(best.T_map_scan, other.T_map_scan) <= 2 * kRadPerDeg;
    }
  }

  const std::vector<PlaceToTry>& places_;
  const QueryPoints& query_;
  const std::optional<PosePrior>& prior_;
  const RelocaliseOptions& options_;
  std::vector<Attempt> attempts_;
  std::vector<RelocalisationCandidate> candidates_;
};

}  // namespace

QueryPoints::QueryPoints(const RelocalisationQuery& query, const GroundFrame& ground,
                         const RelocaliseOptions& options)
    : T_ground_query(ground.T_ground_sensor) {
  constexpr double kUprightM = 0.5;
  PointCloud upright, level;
  const Eigen::Vector3d up = ground.T_ground_sensor.linear().row(2);
  const double height = ground.T_ground_sensor.translation().z();
  // No more than what the finest of the selections can use.
  const PointCloud some = thinned(query.points, 4 * options.refine_points);
  for (std::size_t i = 0; i < some.size(); ++i) {
    const Eigen::Vector3f p = some[i];
    (up.dot(p.cast<double>()) + height > kUprightM ? upright : level).push_back(p);
  }
  screen = mostly_upright(upright, level, options.screen_points);
  search = mostly_upright(upright, level, options.search_points);
  refine = mostly_upright(upright, level, options.refine_points / 2);
  scored = thinned(query.points, options.refine_points);
  surfaces = surfaces_of(query, up);
}

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

std::vector<RelocalisationCandidate> try_places(const std::vector<PlaceToTry>& places,
                                                const QueryPoints& query,
                                                const std::optional<PosePrior>& prior,
                                                const RelocaliseOptions& options) {
  return Trials(places, query, prior, options).run();
}

}  // namespace cellmap
