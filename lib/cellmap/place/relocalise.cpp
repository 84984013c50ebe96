#include "cellmap/place/relocalise.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>
#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/core/parallel.hpp"
#include "cellmap/place/place_search.hpp"
#include "cellmap/place/place_trials.hpp"
#include "cellmap/pose_graph/information.hpp"

namespace cellmap {
namespace {

/// No direction is reported as less certain than this: it means "not measured".
constexpr double kLeastInformation = 1e-2;

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

void require(bool holds, const char* rule) {
  if (!holds) throw Error(ErrorCode::kInvalidArgument, std::string("relocalise needs ") + rule);
}

void validate(const PosePrior& prior) {
  require(is_rigid(prior.T_map_scan), "a rigid prior pose");
  require(prior.radius_m > 0 && prior.radius_m <= 1e6, "0 < radius_m <= 1e6 of the prior");
  require(prior.yaw_range_rad >= 0 && prior.yaw_range_rad <= 7,
          "0 <= yaw_range_rad <= 7 of the prior");
}

/// The query without points that are no points. Throws Error{kInvalidArgument}.
RelocalisationQuery checked(const RelocalisationQuery& query) {
  if (query.prior) validate(*query.prior);
  const bool has_normals = !query.normals.empty();
  require(!has_normals || query.normals.size() == query.points.size(),
          "as many normals as points, or none");
  RelocalisationQuery clean;
  clean.prior = query.prior;
  clean.points.reserve(query.points.size());
  for (std::size_t i = 0; i < query.points.size(); ++i) {
    if (!query.points[i].allFinite() || !(query.points[i].squaredNorm() > 0)) continue;
    if (has_normals && !query.normals[i].allFinite()) continue;
    clean.points.push_back(query.points[i]);
    if (has_normals) clean.normals.push_back(query.normals[i]);
  }
  return clean;
}

/// A part that lies in memory as a whole.
class WholePart : public PlaceParts {
 public:
  explicit WholePart(const PlacePart& part) : part_(part) {}
  std::shared_ptr<const PlacePart> part(const RegionKey&) const override {
    return {std::shared_ptr<const PlacePart>(), &part_};  // owned by the index
  }
  bool is_at_hand(const RegionKey&) const override { return true; }

 private:
  const PlacePart& part_;
};

/// One CELL and the alignments to start from; without a start where the prior allows none.
PlaceToTry place_at(const AlikePlace& alike, const DescribedQuery& query, const PoseGraph& graph,
                    const std::optional<PosePrior>& prior, const RelocaliseOptions& options) {
  constexpr std::size_t kEnoughForAPrior = 300;
  PlaceToTry place;
  place.cell = alike.id;
  place.T_map_cell = graph.nodes.at(alike.id);
  place.T_cell_ground = alike.place.T_ground_cell.inverse();
  place.merit = -1.0;  // nothing alike
  std::optional<LocalPrior> local;
  if (prior) local.emplace(*prior, place.T_map_cell);
  for (const PlaceAlignment& a :
       align(query, alike.place, local ? kEnoughForAPrior : options.starts)) {
    if (place.starts.size() >= options.starts) break;
    if (local && !local->allows(a.T_cell_query, kStartMarginM, kStartMarginRad)) continue;
    if (place.starts.empty()) place.merit = a.similarity;
    place.starts.push_back(a.T_cell_query);
  }
  return place;
}

/// The CELL and the nearest others around a pose, no two at the same place.
std::vector<CellAround> cells_around(CellId own, const Pose& T_map_scan,
                                     const PlaceRegions& considered, const PoseGraph& graph,
                                     const TargetProvider& targets) {
  constexpr double kReachM = 30.0, kApartM = 4.0;
  constexpr std::size_t kMost = 7;
  const Eigen::Vector3d position = T_map_scan.translation();
  const PlaceRegions around = considered.within(position.head<2>(), kReachM);
  std::vector<std::pair<double, CellId>> near;
  for (const PlaceRegions::Region& region : around.all()) {
    for (std::size_t i = 0; i < region.ids.size(); ++i) {
      const double metres = (region.positions[i] - position).norm();
      if (region.ids[i] != own && metres <= kReachM) near.push_back({metres, region.ids[i]});
    }
  }
  std::sort(near.begin(), near.end());
  std::vector<CellAround> cells = {{targets(own), graph.nodes.at(own)}};
  for (const auto& [metres, id] : near) {
    if (cells.size() >= kMost) break;
    const Pose& T = graph.nodes.at(id);
    const bool is_apart = std::all_of(cells.begin(), cells.end(), [&](const CellAround& c) {
      return (c.T_map_cell.translation() - T.translation()).norm() >= kApartM;
    });
    if (is_apart) cells.push_back({targets(id), T});
  }
  return cells;
}

/// The places most like the query, most alike first.
std::vector<PlaceToTry> similar_places(const DescribedQuery& query, const PlaceRegions& considered,
                                       const PlaceSearcher& searcher, const PoseGraph& graph,
                                       const std::optional<PosePrior>& prior,
                                       const RelocaliseOptions& options) {
  // What a place is most alike at may not be what a prior allows.
  const std::vector<AlikePlace> alike =
      most_alike(query.views(), considered, searcher,
                 prior ? options.shortlist : options.candidates, options.effort());
  std::vector<PlaceToTry> places(alike.size());
  parallel_for(alike.size(), 1, options.effort(), [&](std::size_t i, std::size_t) {
    places[i] = place_at(alike[i], query, graph, prior, options);
  });
  std::stable_sort(places.begin(), places.end(),
                   [](const PlaceToTry& a, const PlaceToTry& b) { return a.merit > b.merit; });
  if (places.size() > options.candidates) places.resize(options.candidates);
  return places;
}

}  // namespace

struct PlaceIndex::Impl {
  PlacePart whole;  // where there are no regions
  std::shared_ptr<const PlaceRegions> regions;
  std::shared_ptr<const PlaceSearcher> searcher;

  /// The CELLs with a pose and, where there is a prior, near enough to it. Never null.
  std::shared_ptr<const PlaceRegions> considered(const PoseGraph& graph,
                                                 const std::optional<PosePrior>& prior) const {
    auto all = regions;
    if (!all) {
      auto at = whole.ids().begin();
      const auto holds = [&](CellId id) {
        while (at != whole.ids().end() && *at < id) ++at;
        return at != whole.ids().end() && *at == id;
      };
      all = std::make_shared<const PlaceRegions>(graph, holds);
    }
    if (!prior) return all;
    const Eigen::Vector2d centre = prior->T_map_scan.translation().head<2>();
    return std::make_shared<const PlaceRegions>(all->within(centre, prior->radius_m + kCellReachM));
  }
};

PlaceIndex::PlaceIndex() : impl_(new Impl) {}
PlaceIndex::PlaceIndex(std::shared_ptr<const PlaceRegions> regions,
                       std::shared_ptr<const PlaceSearcher> searcher)
    : impl_(new Impl{{}, std::move(regions), std::move(searcher)}) {}
PlaceIndex::~PlaceIndex() = default;
PlaceIndex::PlaceIndex(PlaceIndex&&) noexcept = default;
PlaceIndex& PlaceIndex::operator=(PlaceIndex&&) noexcept = default;

void PlaceIndex::add(CellId id, const Cell& cell, const Lattice& lattice) {
  assert(!impl_->searcher);
  impl_->whole.put(id, describe_place(reconstruct_points(cell, lattice)));
}

void PlaceIndex::remove(CellId id) {
  assert(!impl_->searcher);
  impl_->whole.remove(id);
}

std::size_t PlaceIndex::size() const {
  return impl_->regions ? impl_->regions->cells() : impl_->whole.size();
}

PosePrior prior_from_covariance(const Pose& T_map_scan, const Matrix6d& covariance, double sigmas) {
  require(is_rigid(T_map_scan), "a rigid prior pose");
  require(covariance.allFinite() && covariance.diagonal().minCoeff() > 0 && sigmas > 0,
          "a finite covariance of a prior with a positive diagonal, and positive sigmas");
  // A small motion (rho, phi) about the map's origin moves the scan by rho + phi x t.
  Eigen::Matrix<double, 3, 6> J;
  J << Eigen::Matrix3d::Identity(), -skew(T_map_scan.translation());
  const Eigen::Matrix2d plan = (J * covariance * J.transpose()).topLeftCorner<2, 2>();
  const double widest = Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(plan).eigenvalues()[1];
  PosePrior prior;
  prior.T_map_scan = T_map_scan;
  prior.radius_m = std::clamp(sigmas * std::sqrt(std::max(widest, 0.0)), 1.0, 1e6);
  prior.yaw_range_rad = std::clamp(sigmas * std::sqrt(covariance(5, 5)), 0.087, std::numbers::pi);
  return prior;
}

RelocalisationQuery RelocalisationQuery::from_scan(PointCloud scan) {
  return {std::move(scan), {}, std::nullopt};
}

RelocalisationQuery RelocalisationQuery::from_scans(std::span<const PosedScan> scans) {
  RelocalisationQuery query;
  for (const PosedScan& scan : scans) {
    query.points.append(
        transformed(scan.points, scans.back().T_odom_sensor.inverse() * scan.T_odom_sensor));
  }
  return query;
}

RelocalisationQuery RelocalisationQuery::from_cell(const Cell& cell, const Lattice& lattice) {
  RelocalisationQuery query{reconstruct_points(cell, lattice), {}, std::nullopt};
  for (const Plane& plane : cell.planes) query.normals.push_back({plane.nx, plane.ny, plane.nz});
  return query;
}

RelocalisationAnswer PlaceIndex::relocalise(const PointCloud& scan, const PoseGraph& graph,
                                            const TargetProvider& targets,
                                            const std::optional<PosePrior>& prior,
                                            const RelocaliseOptions& options) const {
  RelocalisationQuery query = RelocalisationQuery::from_scan(scan);
  query.prior = prior;
  return relocalise(query, graph, targets, options);
}

RelocalisationAnswer PlaceIndex::relocalise(const RelocalisationQuery& raw_query,
                                            const PoseGraph& graph, const TargetProvider& targets,
                                            const RelocaliseOptions& options) const {
  options.validate();
  const RelocalisationQuery query = checked(raw_query);
  RelocalisationAnswer answer;
  const auto considered = impl_->considered(graph, query.prior);
  answer.cells_considered = considered->cells();
  if (query.points.empty() || considered->cells() == 0) return answer;

  const DescribedQuery described(query.points, options.registration.give_way);
  const PartsSearcher whole(std::make_shared<const WholePart>(impl_->whole));
  const PlaceSearcher& searcher = impl_->searcher ? *impl_->searcher : whole;
  std::vector<PlaceToTry> places =
      similar_places(described, *considered, searcher, graph, query.prior, options);
  for (PlaceToTry& place : places) {
    place.target = targets(place.cell);  // a provider has one caller
    options.registration.give_way();
  }
  const auto around = [&](CellId own, const Pose& T_map_scan) {
    return cells_around(own, T_map_scan, *considered, graph, targets);
  };
  std::vector<RelocalisationCandidate> tried =
      try_places(places, QueryPoints(query, described, options), around, query.prior, options);
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
