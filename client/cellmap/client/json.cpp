#include "cellmap/client/json.hpp"

#include <chrono>
#include <cstdio>

#include "cellmap/client/json_reading.hpp"

namespace cellmap::client {
namespace {

constexpr int kMaxDepth = 32;

}  // namespace

Json parse_json(std::string_view text) {
  const auto bounded = [](int depth, Json::parse_event_t, Json&) {
    if (depth > kMaxDepth) {
      throw Error(ErrorCode::kCorruptData, "JSON nested deeper than 32 levels");
    }
    return true;
  };
  return decoded("answer", [&] { return Json::parse(text, bounded); });
}

const Json& member(const Json& json, const char* key) {
  return decoded("answer", [&]() -> const Json& { return json.at(key); });
}

std::string text_member(const Json& json, const char* key) {
  return decoded("answer", [&] { return json.at(key).get<std::string>(); });
}

std::uint64_t unsigned_member(const Json& json, const char* key) {
  return decoded("answer", [&] { return count(json, key); });
}

std::string dump(const Json& json, bool indented) {
  return json.dump(indented ? 2 : -1, ' ', false, Json::error_handler_t::replace);
}

Pose pose_from_json(const Json& json) {
  return decoded("pose", [&] { return pose_from_xyz_qxyzw(numbers<7>(json)); });
}

Matrix6d matrix_from_json(const Json& json) {
  return decoded("6x6 matrix", [&] {
    const auto values = numbers<21>(json);
    Matrix6d matrix;
    std::size_t next = 0;
    for (int row = 0; row < 6; ++row) {
      for (int column = row; column < 6; ++column) {
        matrix(row, column) = matrix(column, row) = values[next++];
      }
    }
    return matrix;
  });
}

Stamp stamp_from_rfc3339(const std::string& text) {
  using namespace std::chrono;
  int year, month, day, hour, minute, used = 0;
  double second;
  char zone = 0;
  const int fields = std::sscanf(text.c_str(), "%4d-%2d-%2d%*1[Tt ]%2d:%2d:%lf%c%n", &year, &month,
                                 &day, &hour, &minute, &second, &zone, &used);
  const year_month_day date{std::chrono::year(year), std::chrono::month(unsigned(month)),
                            std::chrono::day(unsigned(day))};
  if (fields < 7 || (zone != 'Z' && zone != 'z') || used != int(text.size()) || !date.ok() ||
      hour < 0 || hour > 23 || minute < 0 || minute > 59 || !(second >= 0 && second < 61)) {
    throw Error(ErrorCode::kCorruptData,
                "'" + text + "' is not a time such as 2026-11-22T03:45:09Z");
  }
  const nanoseconds midnight = sys_days(date).time_since_epoch();
  return (midnight + hours(hour) + minutes(minute)).count() + stamp_from_seconds(second);
}

namespace {

ErrorCode code_of_status(int status) {
  switch (status) {
    case 401:
      return ErrorCode::kUnauthenticated;
    case 403:
      return ErrorCode::kPermissionDenied;
    case 404:
    case 410:
      return ErrorCode::kNotFound;
    case 405:
    case 406:
    case 415:
    case 501:
      return ErrorCode::kUnsupported;
    case 409:
      return ErrorCode::kConflict;
    case 412:
      return ErrorCode::kPreconditionFailed;
    case 413:
    case 414:
    case 431:
      return ErrorCode::kTooLarge;
    case 422:
      return ErrorCode::kCorruptData;
    case 429:
      return ErrorCode::kRateLimited;
    case 507:
      return ErrorCode::kDiskFull;
    case 408:
    case 502:
    case 503:
    case 504:
      return ErrorCode::kUnavailable;
    default:
      return status < 500 ? ErrorCode::kInvalidArgument : ErrorCode::kInternal;
  }
}

}  // namespace

Error problem_to_error(int status, std::string_view content_type, std::string_view body,
                       const std::string& what) {
  if (content_type.starts_with("application/problem+json")) {
    try {
      const Json problem = parse_json(body);
      const std::string name = problem.value("code", "");
      ErrorCode code = error_code_from_string(name);
      if (to_string(code) != name) code = code_of_status(status);
      const std::string detail = problem.value("detail", problem.value("title", ""));
      if (!detail.empty()) return Error(code, detail);
    } catch (const std::exception&) {
      // Not what it claims to be: the status has to do.
    }
  }
  return Error(code_of_status(status), what + " was answered with HTTP status " +
                                           std::to_string(status) +
                                           " and no explanation; is it a CELLmap server?");
}

}  // namespace cellmap::client
