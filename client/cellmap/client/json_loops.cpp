#include "cellmap/client/json_reading.hpp"

// Constraints and loops.

namespace cellmap::client {
namespace {

ConstraintKind kind_from(const std::string& name) {
  for (const auto kind :
       {ConstraintKind::kOdometry, ConstraintKind::kBidirectional, ConstraintKind::kLoop}) {
    if (to_string(kind) == name) return kind;
  }
  throw Error(ErrorCode::kCorruptData, "unknown constraint kind '" + name + "'");
}

ConstraintOrigin origin_from(const std::string& name) {
  for (const auto origin :
       {ConstraintOrigin::kMapper, ConstraintOrigin::kDetection, ConstraintOrigin::kUser}) {
    if (to_string(origin) == name) return origin;
  }
  throw Error(ErrorCode::kCorruptData, "unknown constraint origin '" + name + "'");
}

}  // namespace

RegistrationScores scores_from_json(const Json& json) {
  return decoded("registration scores", [&] {
    RegistrationScores scores;
    scores.points = integer<std::uint32_t>(json.at("points"));
    scores.hits = integer<std::uint32_t>(json.at("hits"));
    scores.inlier_ratio_all = number_or(json, "inlier_ratio_all", 0);
    scores.inlier_ratio_hit = number_or(json, "inlier_ratio_hit", 0);
    scores.share_in_front = number_or(json, "share_in_front", 0);
    scores.share_beyond = number_or(json, "share_beyond", 0);
    scores.median_residual_m = number_or(json, "median_residual_m", 0);
    return scores;
  });
}

Constraint constraint_from_json(const Json& json) {
  return decoded("constraint", [&] {
    Constraint constraint;
    constraint.id = id<ConstraintId>(json.at("id"));
    constraint.from = id<CellId>(json.at("from"));
    constraint.to = id<CellId>(json.at("to"));
    constraint.T_from_to = pose_from_json(json.at("pose"));
    constraint.information = matrix_from_json(json.at("information"));
    constraint.kind = kind_from(json.at("kind"));
    constraint.origin = origin_from(json.at("origin"));
    constraint.scores = scores_from_json(json.at("scores"));
    constraint.weight = number_or(json, "weight", 1);
    constraint.pinned = json.value("pinned", false);
    return constraint;
  });
}

Json constraints_to_json(const std::vector<Constraint>& constraints) {
  Json list = Json::array();
  for (const Constraint& constraint : constraints) list.push_back(to_json(constraint));
  return list;
}

Json to_json(const LoopList& list) {
  return {{"revision", list.revision}, {"loops", constraints_to_json(list.loops)}};
}

ConstraintReport constraint_report_from_json(const Json& json) {
  return decoded("report on a loop", [&] {
    ConstraintReport report;
    report.constraint = constraint_from_json(json);
    report.verdict = verdict(report.constraint);
    report.gap_m = json.at("gap_m").get<double>();
    report.gap_deg = json.at("gap_deg").get<double>();
    report.chi2 = json.at("chi2").get<double>();
    return report;
  });
}

LoopList loop_list_from_json(const Json& json) {
  return decoded("list of loops", [&] {
    return LoopList{count(json, "revision"),
                    list_of<Constraint>(json.at("loops"), constraint_from_json)};
  });
}

Json to_json(const LoopReport& report) {
  return {{"revision", report.revision},
          {"loops", constraints_to_json(report.loops)},
          {"moved", report.moved},
          {"initial_cost", report.initial_cost},
          {"final_cost", report.final_cost}};
}

LoopReport loop_report_from_json(const Json& json) {
  return decoded("report on loops", [&] {
    LoopReport report;
    report.revision = count(json, "revision");
    if (json.contains("loops")) {
      report.loops = list_of<Constraint>(json.at("loops"), constraint_from_json);
    }
    report.moved = json.contains("moved") ? count(json, "moved") : 0;
    report.initial_cost = number_or(json, "initial_cost", 0);
    report.final_cost = number_or(json, "final_cost", 0);
    return report;
  });
}

}  // namespace cellmap::client
