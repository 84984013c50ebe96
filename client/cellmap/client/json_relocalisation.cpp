#include "cellmap/client/json_reading.hpp"

namespace cellmap::client {
namespace {

GeoPose geopose_from(const Json& json) {
  const Json &position = json.at("position"), &q = json.at("quaternion");
  return {position.at("lat").get<double>(), position.at("lon").get<double>(),
          position.at("h").get<double>(),
          Eigen::Quaterniond(q.at("w").get<double>(), q.at("x").get<double>(),
                             q.at("y").get<double>(), q.at("z").get<double>())};
}

/// A server of before these had none but the scores.
void read_evidence(const Json& json, RelocalisationCandidate& candidate) {
  candidate.registration.scores = scores_from_json(json.at("scores"));
  candidate.confidence = number_or(json, "confidence", 0);
  candidate.similarity = number_or(json, "similarity", 0);
  if (json.contains("surroundings")) {
    const Json& around = json.at("surroundings");
    candidate.surroundings.cells = integer<std::uint32_t>(around.at("cells"));
    candidate.surroundings.parts = integer<std::uint32_t>(around.at("parts"));
    candidate.surroundings.agreement = around.at("agreement").get<double>();
    candidate.surroundings.free_ratio = around.at("free_ratio").get<double>();
  }
  if (json.contains("residuals")) {
    const Json& points = json.at("residuals").at("points");
    for (std::size_t i = 0; i < candidate.residuals.points.size(); ++i) {
      candidate.residuals.points[i] = integer<std::uint32_t>(points.at(i));
    }
  }
}

}  // namespace

Json to_json(const Relocalisation& relocalisation) {
  const RelocalisationAnswer& answer = relocalisation.answer;
  Json json = {{"found", answer.found.has_value()}};
  if (answer.found) {
    json["T_map_scan"] = to_json(answer.found->T_map_scan);
    json["covariance"] = to_json(answer.covariance);
    json["cell"] = {{"id", answer.found->cell.value}};
    if (relocalisation.cell_hash) json["cell"]["hash"] = to_hex(*relocalisation.cell_hash);
    json["T_cell_scan"] = to_json(answer.found->T_cell_scan);
    if (relocalisation.geopose) json["geopose"] = to_json(*relocalisation.geopose);
    document::add_evidence(json, *answer.found);
    json["degenerate"] = answer.found->registration.degeneracy.degenerate;
  }
  json["alternatives"] = Json::array();
  for (const RelocalisationCandidate& other : answer.alternatives) {
    Json alternative{{"cell", other.cell.value},
                     {"T_map_scan", to_json(other.T_map_scan)},
                     {"accepted", other.accepted}};
    document::add_evidence(alternative, other);
    json["alternatives"].push_back(std::move(alternative));
  }
  json["cells_considered"] = answer.cells_considered;
  json["revision"] = relocalisation.revision;
  json["time_ms"] = relocalisation.time_ms;
  return json;
}

namespace {

RelocalisationCandidate found_from(const Json& json) {
  RelocalisationCandidate found;
  found.cell = id<CellId>(json.at("cell").at("id"));
  found.T_map_scan = pose_from_json(json.at("T_map_scan"));
  found.T_cell_scan = pose_from_json(json.at("T_cell_scan"));
  found.registration.T_target_source = found.T_cell_scan;
  found.registration.converged = true;
  read_evidence(json, found);
  found.registration.degeneracy.degenerate = json.at("degenerate");
  found.accepted = true;
  return found;
}

RelocalisationCandidate alternative_from(const Json& json) {
  RelocalisationCandidate other;
  const Json& cell = json.at("cell");
  other.cell = id<CellId>(cell.is_object() ? cell.at("id") : cell);
  other.T_map_scan = pose_from_json(json.at("T_map_scan"));
  read_evidence(json, other);
  other.accepted = json.at("accepted");
  return other;
}

}  // namespace

Relocalisation relocalisation_from_json(const Json& json) {
  return decoded("relocalisation answer", [&] {
    Relocalisation relocalisation;
    RelocalisationAnswer& answer = relocalisation.answer;
    if (json.at("found").get<bool>()) {
      answer.found = found_from(json);
      answer.covariance = matrix_from_json(json.at("covariance"));
      if (json.contains("geopose")) relocalisation.geopose = geopose_from(json.at("geopose"));
      relocalisation.cell_hash = content_hash_from_hex(json.at("cell").at("hash"));
    }
    answer.alternatives =
        list_of<RelocalisationCandidate>(json.at("alternatives"), alternative_from);
    answer.cells_considered = integer<std::size_t>(json.at("cells_considered"));
    relocalisation.revision = count(json, "revision");
    relocalisation.time_ms = json.at("time_ms");
    return relocalisation;
  });
}

}  // namespace cellmap::client
