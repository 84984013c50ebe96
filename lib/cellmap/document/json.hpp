#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "cellmap/core/stamp.hpp"
#include "cellmap/geometry/lattice.hpp"
#include "cellmap/geometry/pose.hpp"
#include "cellmap/map/georeference.hpp"
#include "cellmap/place/relocalise.hpp"
#include "cellmap/pose_graph/edit.hpp"
#include "cellmap/store/store.hpp"

/// The JSON documents of the HTTP API (schema/openapi.yaml) that the server answers with and the
/// command line prints. Not installed: the JSON library stays out of the public headers.
namespace cellmap::document {

using Json = nlohmann::ordered_json;

Json to_json(const Pose& pose);           ///< [x, y, z, qx, qy, qz, qw]
Json to_json(const Matrix6d& symmetric);  ///< 21 numbers, upper triangle by rows
Json to_json(const LatticeSpec& lattice);
Json to_json(const MapInfo& map);
Json to_json(const CellRecord& cell);
Json to_json(const RegistrationScores& scores);
Json to_json(const Constraint& constraint);
Json to_json(const ConstraintReport& report);  ///< the constraint, and how it stands
Json to_json(const Georeference& georeference);
Json to_json(const GeoPose& geopose);  ///< OGC GeoPose 1.0, Basic Quaternion

/// What speaks for a place and against it, as further members of its document.
void add_evidence(Json& json, const RelocalisationCandidate& candidate);

/// RFC 3339 in UTC with milliseconds, for example "2026-11-22T03:45:09.250Z".
std::string to_rfc3339(Stamp unix_time);

}  // namespace cellmap::document
