#include "server/api/problem.hpp"

#include <algorithm>
#include <array>

#include "server/api/json_io.hpp"

namespace cellmap::server {
namespace {

struct ProblemRow {
  ErrorCode code;
  int status;
  const char* title;
};

constexpr std::array kProblemTable{
    ProblemRow{ErrorCode::kInvalidArgument, 400, "Invalid argument"},
    ProblemRow{ErrorCode::kCorruptData, 422, "Corrupt data"},
    ProblemRow{ErrorCode::kNotFound, 404, "Not found"},
    ProblemRow{ErrorCode::kAlreadyExists, 409, "Already exists"},
    ProblemRow{ErrorCode::kConflict, 409, "Conflict"},
    ProblemRow{ErrorCode::kPreconditionFailed, 412, "Precondition failed"},
    ProblemRow{ErrorCode::kUnsupported, 415, "Unsupported"},
    ProblemRow{ErrorCode::kTooLarge, 413, "Too large"},
    ProblemRow{ErrorCode::kUnavailable, 503, "Unavailable"},
    ProblemRow{ErrorCode::kCancelled, 409, "Cancelled"},
    ProblemRow{ErrorCode::kIo, 500, "Input or output failed"},
    ProblemRow{ErrorCode::kUnauthenticated, 401, "Unauthenticated"},
    ProblemRow{ErrorCode::kPermissionDenied, 403, "Permission denied"},
    ProblemRow{ErrorCode::kRateLimited, 429, "Too many requests"},
    ProblemRow{ErrorCode::kDiskFull, 507, "Disk full"},
    ProblemRow{ErrorCode::kInternal, 500, "Internal error"},
};

const ProblemRow& row_of(ErrorCode code) {
  const auto* row = std::ranges::find(kProblemTable, code, &ProblemRow::code);
  return row == kProblemTable.end() ? kProblemTable.back() : *row;
}

Response document(int status, const std::string& code, const std::string& title,
                  const std::string& detail, const std::optional<std::uint64_t>& next_scan = {}) {
  Json json{{"type", "/problems/" + code},
            {"title", title},
            {"status", status},
            {"detail", detail},
            {"code", code},
            {"instance", ""}};
  if (next_scan) json["next_scan"] = *next_scan;
  Response response = json_response(json, status);
  response.headers.set("Content-Type", "application/problem+json");
  response.headers.set("Cache-Control", "no-store");
  return response;
}

}  // namespace

int status_of(ErrorCode code) { return row_of(code).status; }

Response problem(ErrorCode code, const std::string& detail,
                 const std::optional<std::uint64_t>& next_scan) {
  const ProblemRow& row = row_of(code);
  Response response =
      document(row.status, std::string(to_string(code)), row.title, detail, next_scan);
  if (code == ErrorCode::kUnavailable) response.headers.set("Retry-After", "1");
  return response;
}

Response method_not_allowed(const std::string& allow) {
  Response response = document(405, "method-not-allowed", "Method not allowed",
                               "This resource answers " + allow + ".");
  response.headers.set("Allow", allow);
  return response;
}

Response not_acceptable(std::span<const std::string_view> available) {
  std::string types(available.front());
  for (std::size_t i = 1; i < available.size(); ++i) {
    types.append(i + 1 < available.size() ? ", " : " or ").append(available[i]);
  }
  return document(406, "not-acceptable", "Not acceptable",
                  "This resource comes as " + types + "; the Accept header allows none of it.");
}

Response range_not_satisfiable(std::size_t size) {
  Response response =
      document(416, "range-not-satisfiable", "Range not satisfiable",
               "The range lies outside of the " + std::to_string(size) + " bytes there are.");
  response.headers.set("Content-Range", "bytes */" + std::to_string(size));
  return response;
}

Response problem_with_status(int status, ErrorCode code, const std::string& detail) {
  return document(status, std::string(to_string(code)), row_of(code).title, detail);
}

namespace {

/// Null where the response is none.
const std::string* problem_text(const Response& response) {
  const auto* body = std::get_if<std::string>(&response.body);
  const bool is_problem =
      body && response.headers.get("Content-Type") == "application/problem+json";
  return is_problem ? body : nullptr;
}

}  // namespace

std::string problem_code(const Response& response) {
  const auto* text = problem_text(response);
  return text ? Json::parse(*text).value("code", "") : "";
}

void set_instance(Response& response, std::string_view path, const std::string& request_id) {
  const auto* text = problem_text(response);
  if (!text) return;
  Json json = Json::parse(*text);
  json["instance"] = std::string(path);
  json["request_id"] = request_id;
  response.body = dump(json);
}

}  // namespace cellmap::server
