#include "cellmap/place/place_trials.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "cellmap/core/parallel.hpp"
#include "cellmap/place/along_street.hpp"
#include "cellmap/registration/residuals.hpp"

namespace cellmap {
namespace {

/// Places farther apart than this are not the same.
constexpr double kSamePlaceM = 5.0;
/// Nearer than this two answers are one.
constexpr double kSamePoseM = 0.75;
/// The most alike place is tried first, by itself, then more of them, then all: most queries are
/// answered by the first.
constexpr std::array<std::size_t, 3> kRounds = {1, 4, 12};
/// Similarity from above that an answer which is not certain needs: a second opinion that has seen
/// neither planes nor sight lines.
constexpr double kLooksAlike = 0.38;
/// An answer that is believed this much ends the search.
constexpr double kCertain = 0.995;
/// What was registered to few points and confirms less than this is not looked at any further.
constexpr double kHopeless = 0.33;
/// So many of the most promising are registered with many points in each round.
constexpr std::size_t kRefined = 2;
/// Less confidence than this is not worth the time to ask around.
constexpr double kWorthAsking = 0.02;
/// Where the CELLs around agree this much, no other pose along the street has done so.
constexpr double kNoDoubtAround = 0.95;
/// Another pose along the street may confirm so much less of its CELL and be looked at closely.
constexpr double kRivalMargin = 0.15;
/// From this place on, fewer starts are tried, and fewer go on.
constexpr std::size_t kLessLikely = 4, kStartsThere = 3, kSearchedThere = 1;

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
  double quick = 0;
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

/// A candidate and the place that it belongs to.
struct Tried {
  RelocalisationCandidate candidate;
  std::size_t place = 0;
  double quick = 0;  ///< quick_tight_ratio: what those that were not refined are ordered by
  bool refined = false;
  bool believed = false;  ///< with at least the confidence that is asked for
};

double distance_m(const RelocalisationCandidate& a, const RelocalisationCandidate& b) {
  return (a.T_map_scan.translation() - b.T_map_scan.translation()).norm();
}

bool better(const Tried& a, const Tried& b) {
  if (a.refined != b.refined) return a.refined;
  if (a.believed != b.believed) return a.believed;
  return a.refined ? a.candidate.confidence > b.candidate.confidence : a.quick > b.quick;
}

/// One search: what it is about and how far it has come.
class Trials {
 public:
  Trials(const std::vector<PlaceToTry>& places, const QueryPoints& query,
         const AroundProvider& around, const std::optional<PosePrior>& prior,
         const RelocaliseOptions& options)
      : places_(places), query_(query), around_(around), prior_(prior), options_(options) {}

  std::vector<RelocalisationCandidate> run() {
    std::size_t done = 0;
    for (const std::size_t until : {kRounds[0], kRounds[1], kRounds[2], places_.size()}) {
      if (query_.is_narrow && until < places_.size()) continue;
      const std::size_t end = std::min(until, places_.size());
      if (end > done) search(keep_best(screen(done, end)));
      done = std::max(done, end);
      refine_best();
      if (is_certain()) break;
    }
    return decide();
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

  RegistrationOptions unjudged(std::vector<RegistrationStage> stages) const {
    RegistrationOptions registration = staged(options_, std::move(stages));
    registration.judge = false;
    return registration;
  }

  /// Registers a few hundred points from every start at some of the places; best first.
  std::vector<Attempt> screen(std::size_t begin, std::size_t end) const {
    std::vector<std::vector<Attempt>> of_place(end - begin);
    const RegistrationOptions registration =
        unjudged({{10, 3.0, RobustKernel::kCauchy, 0.6}, {5, 1.0, RobustKernel::kCauchy, 0.3}});
    parallel_for(of_place.size(), 1, options_.effort(), [&](std::size_t i, std::size_t) {
      const std::size_t p = begin + i;
      const RegistrationTarget& target = *places_[p].target;
      std::vector<Pose> starts = places_[p].starts;
      if (p >= kLessLikely && starts.size() > kStartsThere) starts.resize(kStartsThere);
      if (prior_) {
        const auto from_grid =
            best_of_grid(target, query_.screen,
                         LocalPrior(*prior_, places_[p].T_map_cell)
                             .grid(places_[p].T_cell_ground, query_.T_ground_query),
                         options_.starts);
        starts.insert(starts.end(), from_grid.begin(), from_grid.end());
      }
      for (const Pose& start : starts) {
        Attempt attempt{p, register_scan(target, query_.screen, start, registration)};
        if (!allowed(attempt)) continue;
        attempt.result.scores = score_scan(target, query_.screen, attempt.result.T_target_source);
        of_place[i].push_back(std::move(attempt));
      }
    });
    std::vector<Attempt> attempts;
    for (const auto& some : of_place) attempts.insert(attempts.end(), some.begin(), some.end());
    std::stable_sort(attempts.begin(), attempts.end(), [](const Attempt& a, const Attempt& b) {
      return agreement(a.result.scores) > agreement(b.result.scores);
    });
    return attempts;
  }

  /// The best attempts of each place, no two alike. Places are not held against each other yet: so
  /// few points that have not settled agree better along any long wall than at the right place.
  std::vector<Attempt> keep_best(const std::vector<Attempt>& attempts) const {
    std::vector<Attempt> kept;
    std::vector<std::size_t> of_place(places_.size(), 0);
    for (const Attempt& attempt : attempts) {
      const std::size_t most = attempt.place < kLessLikely
                                   ? options_.searched
                                   : std::min(options_.searched, kSearchedThere);
      if (of_place[attempt.place] >= most) continue;
      const bool known = std::any_of(kept.begin(), kept.end(),
                                     [&](const Attempt& k) { return same_answer(k, attempt); });
      if (known) continue;
      ++of_place[attempt.place];
      kept.push_back(attempt);
    }
    return kept;
  }

  /// Registers a few thousand points from where the best attempts have come.
  void search(std::vector<Attempt> attempts) {
    const RegistrationOptions registration = unjudged({{6, 2.0, RobustKernel::kCauchy, 0.5},
                                                       {4, 1.0, RobustKernel::kCauchy, 0.2},
                                                       {8, 0.5, RobustKernel::kGemanMcClure, 0.1}});
    parallel_for(attempts.size(), 1, options_.effort(), [&](std::size_t i, std::size_t) {
      Attempt& attempt = attempts[i];
      const RegistrationTarget& target = *places_[attempt.place].target;
      attempt.result =
          register_scan(target, query_.search, attempt.result.T_target_source, registration);
      attempt.quick = quick_tight_ratio(target, query_.scored, attempt.result.T_target_source);
    });
    std::erase_if(attempts, [&](const Attempt& a) { return !allowed(a); });
    for (const Attempt& attempt : attempts) tried_.push_back(tried_from(attempt));
    std::stable_sort(tried_.begin(), tried_.end(), better);
  }

  Tried tried_from(const Attempt& attempt) const {
    Tried tried;
    tried.place = attempt.place;
    tried.quick = attempt.quick;
    tried.candidate.cell = places_[attempt.place].cell;
    tried.candidate.similarity = places_[attempt.place].merit;
    tried.candidate.registration = attempt.result;
    tried.candidate.T_cell_scan = attempt.result.T_target_source;
    tried.candidate.T_map_scan = in_map(attempt);
    return tried;
  }

  /// Registers many points and says how far the pose is to be believed.
  void refine(Tried& tried) const {
    RelocalisationCandidate& candidate = tried.candidate;
    const PlaceToTry& place = places_[tried.place];
    const GiveWay& give_way = options_.registration.give_way;
    const RegistrationOptions registration = staged(
        options_,
        {{3, 0.5, RobustKernel::kGemanMcClure, 0.1}, {40, 0.5, RobustKernel::kGemanMcClure, 0.05}});
    tried.refined = true;
    candidate.registration =
        register_scan(*place.target, query_.refine, candidate.T_cell_scan, registration);
    candidate.T_cell_scan = candidate.registration.T_target_source;
    candidate.T_map_scan = place.T_map_cell * candidate.T_cell_scan;
    give_way();
    candidate.registration.scores =
        score_scan(*place.target, query_.scored.points(), candidate.T_cell_scan);
    if (!allowed({tried.place, candidate.registration})) return;
    give_way();
    candidate.structure = score_structure(*place.target, query_.scored, candidate.T_cell_scan);
    give_way();
    score_facing(*place.target, query_.surfaces, candidate.T_cell_scan, candidate.structure);
    give_way();
    candidate.residuals =
        residuals_of(*place.target, query_.scored.points(), candidate.T_cell_scan);
    candidate.confidence =
        confidence_of(candidate.structure, candidate.registration.degeneracy.weakest_share);
  }

  /// Of what was not refined yet, the few that promise most, best first, until one is certain.
  void refine_best() {
    std::vector<Tried*> open;
    for (Tried& tried : tried_) {
      if (!tried.refined && tried.quick >= kHopeless && open.size() < kRefined) {
        open.push_back(&tried);
      }
    }
    std::vector<Tried> rivals;
    for (Tried* tried : open) {
      judge(*tried);
      if (tried->believed) {
        const std::vector<Tried> there = look_along_street(*tried);
        rivals.insert(rivals.end(), there.begin(), there.end());
      }
      if (is_believed(tried->candidate, kCertain)) break;
    }
    tried_.insert(tried_.end(), rivals.begin(), rivals.end());
    std::stable_sort(tried_.begin(), tried_.end(), better);
  }

  void judge(Tried& tried) const {
    refine(tried);
    ask_around(tried);
    tried.believed = is_believed(tried.candidate, options_.min_confidence);
  }

  /// Other poses along the street, judged as the believed one was.
  std::vector<Tried> look_along_street(const Tried& believed) const {
    const RelocalisationCandidate& known = believed.candidate;
    if (agreement(known.surroundings) >= kNoDoubtAround) return {};
    const RegistrationTarget& target = *places_[believed.place].target;
    const RegistrationOptions registration = unjudged(
        {{6, 0.5, RobustKernel::kCauchy, 0.2}, {6, 0.5, RobustKernel::kGemanMcClure, 0.1}});
    std::vector<Tried> rivals;
    for (const Pose& start :
         starts_along_street(around_(known.cell, known.T_map_scan), query_.screen,
                             known.T_cell_scan, known.registration.information)) {
      Attempt attempt{believed.place, register_scan(target, query_.search, start, registration)};
      if (!is_other(attempt, believed, rivals) || !allowed(attempt)) continue;
      attempt.quick = quick_tight_ratio(target, query_.scored, attempt.result.T_target_source);
      if (attempt.quick >= believed.quick - kRivalMargin) rivals.push_back(tried_from(attempt));
    }
    for (Tried& rival : rivals) judge(rival);
    return rivals;
  }

  /// Neither the believed pose nor a rival again.
  bool is_other(const Attempt& attempt, const Tried& believed,
                const std::vector<Tried>& rivals) const {
    constexpr double kAgainM = 0.3;
    const Eigen::Vector3d at = in_map(attempt).translation();
    const auto is_there = [&](const Tried& t) {
      return (t.candidate.T_map_scan.translation() - at).norm() < kAgainM;
    };
    return !is_there(believed) && std::none_of(rivals.begin(), rivals.end(), is_there);
  }

  /// What the CELLs around the answer say of it.
  void ask_around(Tried& tried) const {
    RelocalisationCandidate& candidate = tried.candidate;
    if (candidate.confidence < kWorthAsking) return;
    candidate.surroundings =
        score_surroundings(around_(candidate.cell, candidate.T_map_scan), query_.scored,
                           query_.search, candidate.T_map_scan, options_.registration);
    candidate.confidence = confidence_of(candidate.structure, candidate.surroundings,
                                         candidate.registration.degeneracy.weakest_share);
  }

  bool is_believed(const RelocalisationCandidate& candidate, double confidence) const {
    return candidate.confidence >= confidence &&
           is_acceptable(candidate.registration, options_.acceptance) &&
           (prior_ || !candidate.registration.degeneracy.degenerate);
  }

  bool is_certain() const {
    return !tried_.empty() && is_believed(tried_.front().candidate, kCertain);
  }

  /// Best first.
  std::vector<RelocalisationCandidate> decide() {
    std::vector<RelocalisationCandidate> candidates;
    if (tried_.empty()) return candidates;
    choose_among_rivals();
    RelocalisationCandidate& best = tried_.front().candidate;
    // A prior says where to look; what is nowhere alike there was tried all the same.
    const bool looks_alike =
        prior_ || best.surroundings.cells >= kFewestAround || best.similarity >= kLooksAlike;
    best.accepted = is_certain() || (is_believed(best, options_.min_confidence) && looks_alike);
    for (Tried& tried : tried_) candidates.push_back(std::move(tried.candidate));
    return candidates;
  }

  /// Of believed poses of one place, the CELLs around choose; and what they think of the others,
  /// here and anywhere, is doubt in the chosen one.
  void choose_among_rivals() {
    const auto by_those_around = [&](const Tried& a, const Tried& b) {
      return agreement(a.candidate.surroundings) < agreement(b.candidate.surroundings);
    };
    const RelocalisationCandidate first = tried_.front().candidate;
    const auto others = std::stable_partition(tried_.begin(), tried_.end(), [&](const Tried& t) {
      return t.believed && t.candidate.surroundings.cells >= kFewestAround &&
             distance_m(t.candidate, first) < kSamePlaceM;
    });
    if (others == tried_.begin()) return;
    std::iter_swap(tried_.begin(), std::max_element(tried_.begin(), others, by_those_around));
    Tried& best = tried_.front();
    double rivals = 0;
    for (const Tried& other : tried_) {
      if (distance_m(other.candidate, best.candidate) < kSamePoseM) continue;
      rivals += odds_against(best.candidate.surroundings, other.candidate.surroundings);
    }
    best.candidate.confidence /= 1 + rivals;
    best.believed = is_believed(best.candidate, options_.min_confidence);
  }

  const std::vector<PlaceToTry>& places_;
  const QueryPoints& query_;
  const AroundProvider& around_;
  const std::optional<PosePrior>& prior_;
  const RelocaliseOptions& options_;
  std::vector<Tried> tried_;
};

}  // namespace

std::vector<RelocalisationCandidate> try_places(const std::vector<PlaceToTry>& places,
                                                const QueryPoints& query,
                                                const AroundProvider& around,
                                                const std::optional<PosePrior>& prior,
                                                const RelocaliseOptions& options) {
  return Trials(places, query, around, prior, options).run();
}

}  // namespace cellmap
