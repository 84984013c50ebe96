#include <string>
#include <string_view>

#include "cellmap/core/error.hpp"
#include "cellmap/place/loop_detection.hpp"
#include "cellmap/place/pose_search.hpp"
#include "cellmap/place/relocalise.hpp"
#include "cellmap/place/structure_score.hpp"

namespace cellmap {
namespace {

void check_option(bool holds, const char* rule) {
  if (!holds) throw Error(ErrorCode::kInvalidArgument, rule);
}

PoseSearchOptions search_of(const auto& options) {
  PoseSearchOptions search;
  search.search_points = options.search_points;
  search.refine_points = options.refine_points;
  search.registration = options.registration;
  return search;
}

}  // namespace

AcceptanceOptions searched_place_acceptance() {
  AcceptanceOptions options;
  options.min_inlier_ratio_hit = 0.5;
  options.max_share_in_front = 0.3;
  return options;
}

AcceptanceOptions default_place_acceptance() {
  AcceptanceOptions options;
  options.max_share_in_front = 0.02;
  return options;
}

RegistrationOptions default_place_registration() {
  RegistrationOptions options;
  options.convergence_translation_m = 1e-3;
  options.convergence_rotation_rad = 1e-4;
  return options;
}

void StructureAcceptance::validate() const {
  const auto is_share = [](double value) { return value >= 0 && value <= 1; };
  if (is_share(min_inlier_ratio) && is_share(max_share_in_front) && is_share(min_confirmed_ratio) &&
      is_share(max_share_seen_through)) {
    return;
  }
  throw Error(ErrorCode::kInvalidArgument,
              "structure acceptance: its ratios and shares must be within 0 and 1");
}

void PoseSearchOptions::validate() const {
  if (search_points < 100 || refine_points < search_points) {
    throw Error(ErrorCode::kInvalidArgument,
                "pose search: 100 <= search_points <= refine_points must hold, found " +
                    std::to_string(search_points) + " and " + std::to_string(refine_points));
  }
  registration.validate();
}

std::string to_string(LoopAcceptance acceptance) {
  return acceptance == LoopAcceptance::kPaper ? "paper" : "scores";
}

std::optional<LoopAcceptance> loop_acceptance_from(std::string_view name) {
  for (const auto acceptance : {LoopAcceptance::kScores, LoopAcceptance::kPaper}) {
    if (name == to_string(acceptance)) return acceptance;
  }
  return std::nullopt;
}

void LoopOptions::validate() const {
  check_option(candidates <= 1000, "loop options need candidates <= 1000");
  check_option(closures >= 1, "loop options need closures >= 1");
  check_option(max_distance_m > 0 && max_distance_m <= 1e6,
               "loop options need 0 < max_distance_m <= 1e6");
  check_option(drift_m_per_m > 0 && drift_m_per_m <= 10,
               "loop options need 0 < drift_m_per_m <= 10");
  check_option(drift_deg_per_m > 0 && drift_deg_per_m <= 180,
               "loop options need 0 < drift_deg_per_m <= 180");
  check_option(seeds <= 1000, "loop options need seeds <= 1000");
  check_option(max_reverse_difference_m > 0, "loop options need max_reverse_difference_m > 0");
  check_option(max_reverse_difference_deg > 0, "loop options need max_reverse_difference_deg > 0");
  acceptance.validate();
  structure.validate();
  search().validate();
}

PoseSearchOptions LoopOptions::search() const { return search_of(*this); }

void RelocaliseOptions::validate() const {
  check_option(candidates >= 1 && candidates <= 1000, "relocalise needs 1 <= candidates <= 1000");
  check_option(shortlist >= candidates, "relocalise needs shortlist >= candidates");
  check_option(searched >= 1 && searched <= 1000, "relocalise needs 1 <= searched <= 1000");
  check_option(screen_points >= 100 && screen_points <= search_points,
               "relocalise needs 100 <= screen_points <= search_points");
  check_option(starts >= 1 && starts <= 1000, "relocalise needs 1 <= starts <= 1000");
  check_option(alternatives <= 1000, "relocalise needs alternatives <= 1000");
  check_option(threads >= 0, "relocalise needs threads >= 0");
  check_option(min_confidence >= 0 && min_confidence <= 1,
               "relocalise needs 0 <= min_confidence <= 1");
  acceptance.validate();
  search().validate();
}

PoseSearchOptions RelocaliseOptions::search() const { return search_of(*this); }

}  // namespace cellmap
