#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "cellmap/client/resources.hpp"
#include "cellmap/document/json.hpp"
#include "cellmap/evaluation/trajectory_metrics.hpp"

/// The JSON of the HTTP API (schema/openapi.yaml) from and to the library's types. Not installed:
/// the JSON library stays out of the public headers. The command line prints the same documents.
///
/// All `*_from_json` throw Error{kCorruptData} naming what is missing or of the wrong type.
namespace cellmap::client {

using document::Json;
using document::to_json;
using document::to_rfc3339;

/// Parses a bounded, untrusted document: at most 32 levels deep. Throws Error{kCorruptData}.
Json parse_json(std::string_view text);

/// A member that must be there. Throws Error{kCorruptData} naming it.
const Json& member(const Json& json, const char* key);
std::string text_member(const Json& json, const char* key);
std::uint64_t unsigned_member(const Json& json, const char* key);

/// One line, or indented for people. Text that is not UTF-8 is replaced, never an error.
std::string dump(const Json& json, bool indented = true);

Pose pose_from_json(const Json& json);
Matrix6d matrix_from_json(const Json& json);

/// Throws Error{kCorruptData} for anything that is not an RFC 3339 time.
Stamp stamp_from_rfc3339(const std::string& text);

MapInfo map_info_from_json(const Json& json);
/// The members "encoding" and "bound_m" of a request.
void put_form(Json& json, const CellForm& form);
CellForm form_from_json(const Json& json);

CellRecord cell_record_from_json(const Json& json);
Json to_json(const CellPage& page);
CellPage cell_page_from_json(const Json& json);
Json to_json(const Session& session);  ///< as the API has it
Session session_from_json(const Json& json);
SessionCell session_cell_from_json(const Json& json);
ContentHash content_hash_from_json(const Json& json);
PutCellResult put_cell_result_from_json(const Json& json);

RegistrationScores scores_from_json(const Json& json);
Constraint constraint_from_json(const Json& json);
Json constraints_to_json(const std::vector<Constraint>& constraints);
Changes changes_from_json(const Json& json);
RevisionEvent revision_event_from_json(const Json& json);

Json to_json(const Relocalisation& answer);
Relocalisation relocalisation_from_json(const Json& json);

Json to_json(const LoopList& list);
ConstraintReport constraint_report_from_json(const Json& json);
LoopList loop_list_from_json(const Json& json);
Json to_json(const LoopReport& report);
LoopReport loop_report_from_json(const Json& json);

Json to_json(const Job& job);
Job job_from_json(const Json& json);
Json to_json(const IngestRequest& request);

/// The error of a problem document (RFC 9457): its code and its detail. `status` decides where the
/// body is no problem document or its code is not of our list; `what` says what was asked of whom.
Error problem_to_error(int status, std::string_view content_type, std::string_view body,
                       const std::string& what);

}  // namespace cellmap::client
