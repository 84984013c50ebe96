#include "cellmap/place/relocalise.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/core/parallel.hpp"
#include "cellmap/place/polar_image.hpp"
#include "cellmap/pose_graph/information.hpp"

namespace cellmap {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;
/// Width of a sector of the image, which is how exact its yaw is.
constexpr double kSectorRad = 2 * std::numbers::pi / PolarImage::kSectors;
/// How far from a CELL's base a scan may be and still be registered to it.
constexpr double kCellReachM = 12.0;
constexpr double kGridStepM = 2.0, kGridStepRad = 5.0 * kRadPerDeg;
/// No direction is reported as less certain than this: it means "not measured".
constexpr double kLeastInformation = 1e-2;

/// A CELL to be tried, from where.
struct PlaceToTry {
  CellId cell;
  double merit = 0;  // what places are ordered by: likeness of the images
  std::vector<Pose> starts;
};

/// A prior in the frame of one CELL.
class LocalPrior {
 public:
  LocalPrior(const PosePrior& prior, const Pose& T_map_cell)
      : prior_(prior), T_cell_scan_(T_map_cell.inverse() * prior.T_map_scan) {}

  bool allows(const Pose& T_cell_scan, double margin_m, double margin_rad) const {
    const Eigen::Vector2d apart =
        (T_cell_scan.translation() - T_cell_scan_.translation()).head<2>();
    const double turn = yaw_of(T_cell_scan_.inverse() * T_cell_scan);
    return apart.norm() <= prior_.radius_m + margin_m &&
           std::abs(turn) <= prior_.yaw_range_rad + margin_rad;
  }

  /// A grid over all that the prior allows, from its middle outwards, as long as the scan would
  /// still be near enough to the CELL.
  std::vector<Pose> grid() const {
    const int turns = static_cast<int>(
        std::ceil(std::min(prior_.yaw_range_rad, std::numbers::pi) / kGridStepRad));
    const int steps =
        static_cast<int>(std::ceil(std::min(prior_.radius_m, kCellReachM) / kGridStepM));
    std::vector<Pose> poses;
    for (int i = -steps; i <= steps; ++i) {
      for (int j = -steps; j <= steps; ++j) {
        const double x = T_cell_scan_.translation().x() + i * kGridStepM;
        const double y = T_cell_scan_.translation().y() + j * kGridStepM;
        if (std::hypot(x, y) > kCellReachM) continue;
        for (int k = -turns; k <= turns; ++k) {
          const Pose pose = upright_pose(x, y, yaw_of(T_cell_scan_) + k * kGridStepRad);
          if (allows(pose, 0.0, kGridStepRad)) poses.push_back(pose);
        }
      }
    }
    return poses;
  }

 private:
  PosePrior prior_;
  Pose T_cell_scan_;
};

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

/// Covariance of exp(xi) * T_map_scan from information of exp(xi) * T_cell_scan; directions that
/// the scan did not measure get a standard deviation of 10 (m or rad), not infinity.
Matrix6d covariance_in_map(const RegistrationResult& result, const Pose& T_map_cell) {
  Matrix6d information = realistic_information(result.information, result.T_target_source);
  if (result.degeneracy.degenerate) {
    // The weak motion is given at the scan's origin; nothing is claimed of it beyond 1 m or 1 rad.
    Tangent weak = result.degeneracy.weakest;
    weak.head<3>() += result.T_target_source.translation().cross(weak.tail<3>());
    const Tangent pull = information * weak;
    const double weight = weak.dot(pull);
    if (weight > 1.0) information -= pull * pull.transpose() * ((1.0 - 1.0 / weight) / weight);
  }
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(0.5 *
                                                       (information + information.transpose()));
  const Tangent values = solver.eigenvalues().cwiseMax(kLeastInformation).cwiseInverse();
  const Matrix6d& V = solver.eigenvectors();
  const Matrix6d Ad = adjoint(T_map_cell);
  const Matrix6d covariance = Ad * V * values.asDiagonal() * V.transpose() * Ad.transpose();
  return 0.5 * (covariance + covariance.transpose());
}

PointCloud finite_points(const PointCloud& scan) {
  PointCloud clean;
  clean.reserve(scan.size());
  for (std::size_t i = 0; i < scan.size(); ++i) {
    if (scan[i].allFinite() && scan[i].squaredNorm() > 0) clean.push_back(scan[i]);
  }
  return clean;
}

/// The best pose at one place on few points.
std::optional<RegistrationResult> search_place(const RegistrationTarget& target,
                                               const PointCloud& scan, std::vector<Pose> starts,
                                               const std::optional<LocalPrior>& prior,
                                               const RelocaliseOptions& options) {
  if (prior) {
    constexpr std::size_t kGridPoints = 400;
    const auto from_grid =
        best_of_grid(target, thinned(scan, kGridPoints), prior->grid(), options.starts);
    starts.insert(starts.end(), from_grid.begin(), from_grid.end());
  }
  for (RegistrationResult& result : search_poses(target, scan, starts, options.search())) {
    if (!prior || prior->allows(result.T_target_source, 1.0, kGridStepRad)) return result;
  }
  return std::nullopt;
}

/// Places farther apart than this are not the same.
constexpr double kSamePlaceM = 5.0;

double distance_m(const RelocalisationCandidate& a, const RelocalisationCandidate& b) {
  return (a.T_map_scan.translation() - b.T_map_scan.translation()).norm();
}

bool is_refined(const RelocalisationCandidate& candidate) {
  return candidate.structure.points > 0 || candidate.structure.planes > 0;
}

/// The places that are registered with many points: the best few, and the best few elsewhere, which
/// show whether the first stand out.
std::vector<std::size_t> places_to_refine(const std::vector<RelocalisationCandidate>& ordered) {
  constexpr std::size_t kBest = 3, kElsewhere = 2;
  std::vector<std::size_t> chosen;
  std::size_t elsewhere = 0;
  for (std::size_t i = 0; i < ordered.size(); ++i) {
    const bool is_elsewhere = distance_m(ordered[i], ordered.front()) > kSamePlaceM;
    if (i >= kBest && !(is_elsewhere && elsewhere < kElsewhere)) continue;
    elsewhere += is_elsewhere;
    chosen.push_back(i);
  }
  return chosen;
}

/// Registers many points and says whether the pose is believed by itself.
void refine(const RegistrationTarget& target, const PointCloud& scan, const Pose& T_map_cell,
            const std::optional<PosePrior>& prior, const RelocaliseOptions& options,
            RelocalisationCandidate& candidate) {
  const PoseSearchOptions search = options.search();
  candidate.registration = refine_pose(target, scan, candidate.T_cell_scan, search);
  candidate.T_cell_scan = candidate.registration.T_target_source;
  candidate.T_map_scan = T_map_cell * candidate.T_cell_scan;
  if (prior && !LocalPrior(*prior, T_map_cell).allows(candidate.T_cell_scan, 1.0, kGridStepRad)) {
    return;
  }
  candidate.structure =
      score_structure(target, thinned(scan, search.refine_points), candidate.T_cell_scan);
  candidate.accepted = is_acceptable(candidate.registration, options.acceptance) &&
                       is_acceptable(candidate.structure, options.structure);
}

/// Whether a place that is not believed by itself stands out from all others.
bool stands_out(const RelocalisationCandidate& best,
                const std::vector<RelocalisationCandidate>& tried, bool has_prior,
                const RelocaliseOptions& options) {
  if (!is_acceptable(best.registration, options.busy_acceptance) ||
      !is_acceptable(best.structure, options.busy_structure)) {
    return false;
  }
  bool has_rival = false;
  for (const RelocalisationCandidate& rival : tried) {
    if (!is_refined(rival) || distance_m(best, rival) <= kSamePlaceM) continue;
    has_rival = true;
    if (agreement(best.structure) - agreement(rival.structure) < options.min_dominance)
      return false;
  }
  return has_rival || has_prior;
}

bool better(const RelocalisationCandidate& a, const RelocalisationCandidate& b) {
  if (a.accepted != b.accepted) return a.accepted;
  if (is_refined(a) != is_refined(b)) return is_refined(a);
  if (is_refined(a)) return agreement(a.structure) > agreement(b.structure);
  return agreement(a.registration.scores) > agreement(b.registration.scores);
}

/// Every place on few points, best first.
std::vector<RelocalisationCandidate> try_places(
    const std::vector<PlaceToTry>& places, const PointCloud& scan, const PoseGraph& graph,
    const std::map<CellId, std::shared_ptr<const RegistrationTarget>>& targets,
    const std::optional<PosePrior>& prior, const RelocaliseOptions& options) {
  std::vector<RelocalisationCandidate> tried(places.size());
  parallel_for(places.size(), 1, options.threads, [&](std::size_t i, std::size_t) {
    const CellId cell = places[i].cell;
    const Pose& T_map_cell = graph.nodes.at(cell);
    std::optional<LocalPrior> local;
    if (prior) local.emplace(*prior, T_map_cell);
    tried[i].cell = cell;
    if (auto best = search_place(*targets.at(cell), scan, places[i].starts, local, options)) {
      tried[i].registration = std::move(*best);
      tried[i].T_cell_scan = tried[i].registration.T_target_source;
      tried[i].T_map_scan = T_map_cell * tried[i].T_cell_scan;
    }
  });
  std::erase_if(tried, [](const auto& c) { return c.registration.scores.points == 0; });
  std::stable_sort(tried.begin(), tried.end(), better);
  return tried;
}

/// Registers the best places with many points and decides; best first.
std::vector<RelocalisationCandidate> decide(
    std::vector<RelocalisationCandidate> tried, const PointCloud& scan, const PoseGraph& graph,
    const std::map<CellId, std::shared_ptr<const RegistrationTarget>>& targets,
    const std::optional<PosePrior>& prior, const RelocaliseOptions& options) {
  const std::vector<std::size_t> chosen = places_to_refine(tried);
  parallel_for(chosen.size(), 1, options.threads, [&](std::size_t k, std::size_t) {
    RelocalisationCandidate& candidate = tried[chosen[k]];
    refine(*targets.at(candidate.cell), scan, graph.nodes.at(candidate.cell), prior, options,
           candidate);
  });
  std::stable_sort(tried.begin(), tried.end(), better);
  if (!tried.empty() && !tried.front().accepted) {
    tried.front().accepted = stands_out(tried.front(), tried, prior.has_value(), options);
  }
  return tried;
}

void require(bool holds, const char* rule) {
  if (!holds) throw Error(ErrorCode::kInvalidArgument, std::string("relocalise needs ") + rule);
}

void validate(const PosePrior& prior) {
  require(is_rigid(prior.T_map_scan), "a rigid prior pose");
  require(prior.radius_m > 0 && prior.radius_m <= 1e6, "0 < radius_m <= 1e6 of the prior");
  require(prior.yaw_range_rad >= 0 && prior.yaw_range_rad <= 7,
          "0 <= yaw_range_rad <= 7 of the prior");
}

}  // namespace

void RelocaliseOptions::validate() const {
  require(candidates >= 1 && candidates <= 1000, "1 <= candidates <= 1000");
  require(starts >= 1 && starts <= 1000, "1 <= starts <= 1000");
  require(alternatives <= 1000, "alternatives <= 1000");
  require(threads >= 0, "threads >= 0");
  require(min_dominance >= 0 && min_dominance <= 1, "0 <= min_dominance <= 1");
  acceptance.validate();
  structure.validate();
  busy_acceptance.validate();
  busy_structure.validate();
  search().validate();
}

PoseSearchOptions RelocaliseOptions::search() const {
  PoseSearchOptions options;
  options.search_points = search_points;
  options.refine_points = refine_points;
  options.registration = registration;
  return options;
}

struct PlaceIndex::Impl {
  std::map<CellId, PolarImage> images;

  /// CELLs in the index with a pose and, where there is a prior, near enough to it.
  std::vector<CellId> cells_to_consider(const PoseGraph& graph,
                                        const std::optional<PosePrior>& prior) const {
    std::vector<CellId> cells;
    for (const auto& [id, image] : images) {
      const auto node = graph.nodes.find(id);
      if (node == graph.nodes.end()) continue;
      const double reach = prior ? prior->radius_m + kCellReachM : 0.0;
      if (!prior ||
          (node->second.translation() - prior->T_map_scan.translation()).head<2>().norm() <=
              reach) {
        cells.push_back(id);
      }
    }
    return cells;
  }

  /// The most similar CELLs and the alignments to start from, most similar first.
  std::vector<PlaceToTry> similar_places(const PointCloud& scan, const std::vector<CellId>& cells,
                                         const PoseGraph& graph,
                                         const std::optional<PosePrior>& prior,
                                         const RelocaliseOptions& options) const {
    const RecentredImages query(scan);
    std::vector<PlaceToTry> places(cells.size());
    parallel_for(cells.size(), 16, options.threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        places[i].cell = cells[i];
        places[i].merit = -2.0;
        std::optional<LocalPrior> local;
        if (prior) local.emplace(*prior, graph.nodes.at(cells[i]));
        for (const Alignment& a : query.align(images.at(cells[i]), local ? 200 : options.starts)) {
          if (places[i].starts.size() >= options.starts) break;
          if (local && !local->allows(a.T_cell_scan, kGridStepM, kSectorRad)) continue;
          if (places[i].starts.empty()) places[i].merit = a.similarity;
          places[i].starts.push_back(a.T_cell_scan);
        }
      }
    });
    std::stable_sort(places.begin(), places.end(),
                     [](const PlaceToTry& a, const PlaceToTry& b) { return a.merit > b.merit; });
    if (places.size() > options.candidates) places.resize(options.candidates);
    return places;
  }
};

PlaceIndex::PlaceIndex() : impl_(new Impl) {}
PlaceIndex::~PlaceIndex() = default;
PlaceIndex::PlaceIndex(PlaceIndex&&) noexcept = default;
PlaceIndex& PlaceIndex::operator=(PlaceIndex&&) noexcept = default;

void PlaceIndex::add(CellId id, const Cell& cell, const Lattice& lattice) {
  impl_->images.insert_or_assign(id, PolarImage(reconstruct_points(cell, lattice)));
}

void PlaceIndex::remove(CellId id) { impl_->images.erase(id); }

std::size_t PlaceIndex::size() const { return impl_->images.size(); }

RelocalisationAnswer PlaceIndex::relocalise(const PointCloud& raw_scan, const PoseGraph& graph,
                                            const TargetProvider& targets,
                                            const std::optional<PosePrior>& prior,
                                            const RelocaliseOptions& options) const {
  options.validate();
  if (prior) validate(*prior);
  RelocalisationAnswer answer;
  const PointCloud scan = finite_points(raw_scan);
  const std::vector<CellId> cells = impl_->cells_to_consider(graph, prior);
  answer.cells_considered = cells.size();
  if (scan.empty() || cells.empty()) return answer;

  const std::vector<PlaceToTry> places = impl_->similar_places(scan, cells, graph, prior, options);
  std::map<CellId, std::shared_ptr<const RegistrationTarget>> loaded;
  for (const PlaceToTry& place : places) loaded[place.cell] = targets(place.cell);
  std::vector<RelocalisationCandidate> tried = decide(
      try_places(places, scan, graph, loaded, prior, options), scan, graph, loaded, prior, options);
  if (!tried.empty() && tried.front().accepted) {
    answer.found = tried.front();
    answer.covariance =
        covariance_in_map(answer.found->registration, graph.nodes.at(answer.found->cell));
    tried.erase(tried.begin());
  }
  if (tried.size() > options.alternatives) tried.resize(options.alternatives);
  answer.alternatives = std::move(tried);
  return answer;
}

}  // namespace cellmap
