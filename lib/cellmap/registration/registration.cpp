#include "cellmap/registration/registration.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <memory>
#include <optional>
#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/registration/information.hpp"
#include "cellmap/registration/residuals.hpp"
#include "cellmap/registration/scores.hpp"

namespace cellmap {
namespace {

/// A normal matrix scaled to unit diagonal with a smaller eigenvalue leaves a motion undetermined.
constexpr double kSingular = 1e-9;

/// The Gauss-Newton step of H xi = -g; nothing where H leaves a motion undetermined.
std::optional<Tangent> solve(const NormalSystem& system) {
  if (!(system.H.diagonal().minCoeff() > 0)) return std::nullopt;
  const Tangent scale = system.H.diagonal().cwiseSqrt().cwiseInverse();
  const Matrix6d scaled = scale.asDiagonal() * system.H * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(scaled);
  if (!(eigen.eigenvalues()[0] > kSingular)) return std::nullopt;
  const Tangent rotated = eigen.eigenvectors().transpose() * (scale.asDiagonal() * system.g);
  const Tangent step = eigen.eigenvectors() * rotated.cwiseQuotient(eigen.eigenvalues());
  return Tangent(-(scale.asDiagonal() * step));
}

/// Lengthens steps that creep. Correspondences follow the pose only as it moves, so along a weak
/// motion each step goes a part of the way and the next ones repeat it a little shorter; where two
/// steps in a row agree, their ratio tells the sum of the rest (Aitken).
class CreepAccelerator {
 public:
  explicit CreepAccelerator(double median_range_m) : range_m_(median_range_m) {}

  Tangent lengthened(const Tangent& step) {
    Tangent metric = step;
    metric.tail<3>() *= range_m_;
    const double before = previous_.squaredNorm();
    const double ratio = before > 0 ? metric.dot(previous_) / before : 0.0;
    const bool agree = ratio > 0 && metric.dot(previous_) > 0.8 * metric.norm() * previous_.norm();
    if (!agree || ratio < kLeastRatio) {
      previous_ = metric;
      return step;
    }
    previous_.setZero();  // the next two steps are plain again
    return step * std::min(1.0 / (1.0 - std::min(ratio, 0.99)), kMostLengthening);
  }

 private:
  static constexpr double kLeastRatio = 0.5;
  static constexpr double kMostLengthening = 10.0;
  double range_m_;
  Tangent previous_ = Tangent::Zero();
};

/// Terms whose scans may have been thinned.
struct ThinnedTerms {
  std::vector<PointCloud> scans;
  std::vector<RegistrationTerm> terms;
};

/// Every n-th point of each scan, n being `step_of(number of points)`.
template <typename StepOf>
ThinnedTerms thin(std::span<const RegistrationTerm> terms, const StepOf& step_of) {
  ThinnedTerms thinned;
  thinned.scans.reserve(terms.size());  // terms point at them
  for (RegistrationTerm term : terms) {
    const std::size_t step = step_of(term.scan->size());
    if (step > 1) {
      thinned.scans.push_back(every_nth(*term.scan, step));
      term.scan = &thinned.scans.back();
    }
    thinned.terms.push_back(term);
  }
  return thinned;
}

/// What a registration works with from the first iteration to the scores.
struct Problem {
  std::span<const RegistrationTerm> terms;
  const RegistrationOptions& options;
  double median_range_m;

  ReuseBound reuse() const {
    return {median_range_m,
            options.reuse_share * terms.front().target->lattice().patch_radius_rad()};
  }
};

/// The terms of a stage, thinned where it has more points than `most` (0: any number).
struct StageTerms {
  std::size_t most;
  ThinnedTerms thinned;
  std::vector<MatchedTerm> terms;

  StageTerms(const Problem& problem, std::size_t most_points)
      : most(most_points), thinned(thin(problem.terms, [most_points](std::size_t points) {
          return most_points == 0 ? 1 : (points + most_points - 1) / most_points;
        })) {
    for (const RegistrationTerm& term : thinned.terms) {
      terms.emplace_back(term, problem.options.effort(), problem.reuse());
    }
  }
};

/// Runs one stage from `result.T_target_source`; false where the registration has come to its end.
bool run_stage(const Problem& problem, const RegistrationStage& stage, bool is_last,
               std::span<MatchedTerm> terms, RegistrationResult& result) {
  const RegistrationOptions& options = problem.options;
  CreepAccelerator accelerator(problem.median_range_m);
  for (int i = 0; i < stage.max_iterations; ++i) {
    const Pose& T = result.T_target_source;
    NormalSystem system;
    for (MatchedTerm& term : terms) term.add_normal_equations(T, stage, system);
    if (system.points < options.min_points_in_gate) return false;
    const std::optional<Tangent> step = solve(system);
    if (!step) return false;
    const Pose moved = exp(*step) * T;
    const double translation = (moved.translation() - T.translation()).norm();
    ++result.iterations;
    if (is_last && translation < options.convergence_translation_m &&
        step->tail<3>().norm() < options.convergence_rotation_rad) {
      result.T_target_source = moved;
      result.converged = terms.front().is_fresh();  // all of them look up together
      if (result.converged) return false;
      for (MatchedTerm& term : terms) term.forget();
      continue;
    }
    const bool may_creep = stage.kernel != RobustKernel::kNone;
    result.T_target_source = may_creep ? exp(accelerator.lengthened(*step)) * T : moved;
  }
  return !is_last;
}

/// Runs all stages; returns the terms of the last one.
std::unique_ptr<StageTerms> iterate(const Problem& problem, RegistrationResult& result) {
  const std::vector<RegistrationStage> stages =
      problem.options.stages.empty() ? default_registration_stages() : problem.options.stages;
  std::unique_ptr<StageTerms> at;
  for (std::size_t s = 0; s < stages.size(); ++s) {
    if (!at || at->most != stages[s].max_points) {
      at = std::make_unique<StageTerms>(problem, stages[s].max_points);
    }
    if (!run_stage(problem, stages[s], s + 1 == stages.size(), at->terms, result)) break;
  }
  return at;
}

/// Scores, information and what the geometry does not hold, at the pose of the result.
void judge(const Problem& problem, std::span<MatchedTerm> terms, RegistrationResult& result) {
  const Pose& T = result.T_target_source;
  std::vector<HitDistances> hits;
  for (MatchedTerm& term : terms) hits.push_back(term.distances(T));
  result.scores = scores_of(hits);
  result.rmse_m = inlier_rmse_m(hits);
  const HeldMotions held = held_motions(information_of(terms, hits, T), T, problem.median_range_m,
                                        problem.options.degeneracy_share);
  result.degeneracy = held.degeneracy;
  result.information = with_systematic_deviation(held.information, T, problem.options);
}

RegistrationResult register_terms(std::span<const RegistrationTerm> all_terms,
                                  const Pose& T_initial, const RegistrationOptions& options) {
  options.validate();
  assert(is_rigid(T_initial));
  const ThinnedTerms selected = thin(all_terms, [&](std::size_t) { return options.point_step; });
  const Problem problem{selected.terms, options, median_range_m(selected.terms)};
  RegistrationResult result;
  result.T_target_source = T_initial;
  std::unique_ptr<StageTerms> last = iterate(problem, result);
  if (!options.judge) return result;
  if (last->most != 0) last = std::make_unique<StageTerms>(problem, 0);
  judge(problem, last->terms, result);
  return result;
}

}  // namespace

RegistrationTarget::RegistrationTarget(std::shared_ptr<const Cell> cell,
                                       std::shared_ptr<const Lattice> lattice)
    : cell_(std::move(cell)), lattice_(std::move(lattice)) {
  if (cell_->lattice != lattice_->spec()) {
    throw Error(ErrorCode::kInvalidArgument, "a CELL of the lattice " + to_string(cell_->lattice) +
                                                 " cannot be read with the lattice " +
                                                 to_string(lattice_->spec()));
  }
  slots_.assign(lattice_->size(), 0);
  const std::vector<std::uint32_t>& indices = cell_->indices;  // ascending
  if (!indices.empty()) first_ = indices.front();
  hesse_planes_.assign(indices.empty() ? 1 : indices.back() - first_ + 2, simd::kNoPlane);
  for (std::size_t k = 0; k < indices.size(); ++k) {
    const Plane& plane = cell_->planes[k];
    const Eigen::Vector3d normal(plane.nx, plane.ny, plane.nz);
    const double offset_m = plane.distance_m * normal.dot(lattice_->direction(indices[k]));
    slots_[indices[k]] = static_cast<std::uint32_t>(k + 1);
    hesse_planes_[indices[k] - first_] = {plane.nx, plane.ny, plane.nz,
                                          static_cast<float>(offset_m)};
  }
}

RegistrationResult register_scan(const RegistrationTarget& target, const PointCloud& scan,
                                 const Pose& T_cell_scan_initial,
                                 const RegistrationOptions& options) {
  const std::array terms = {RegistrationTerm{&target, &scan, false}};
  return register_terms(terms, T_cell_scan_initial, options);
}

RegistrationResult register_cells(const RegistrationTarget& a, const PointCloud& scan_a,
                                  const RegistrationTarget& b, const PointCloud& scan_b,
                                  const Pose& T_a_b_initial, const RegistrationOptions& options) {
  const std::array terms = {RegistrationTerm{&a, &scan_b, false},
                            RegistrationTerm{&b, &scan_a, true}};
  return register_terms(terms, T_a_b_initial, options);
}

}  // namespace cellmap
