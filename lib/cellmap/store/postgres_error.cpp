#include "cellmap/store/postgres_error.hpp"

#include <string_view>

#include "cellmap/core/error.hpp"
#include "cellmap/store/sql_connection.hpp"

namespace cellmap {

std::string without_line_end(const char* message) {
  std::string text = message == nullptr ? "" : message;
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  for (char& c : text) c = c == '\n' ? ' ' : c;
  return text;
}

void throw_postgres_error(const std::string& state, const std::string& message) {
  const std::string detail = " (PostgreSQL " + (state.empty() ? "" : state + ": ") + message + ")";
  const auto is_of = [&](std::string_view of) { return state.starts_with(of); };
  if (state == "53100") {
    throw Error(ErrorCode::kDiskFull,
                "store: the database's disk is full and nothing was changed; free space" + detail);
  }
  if (state == "40001" || state == "40P01") {
    throw TakenBack("store: the database is busy; try again" + detail);
  }
  if (state.empty() || is_of("08") || is_of("53") || is_of("57") || is_of("40") ||
      state == "55P03" || state == "25006") {
    throw Error(ErrorCode::kUnavailable,
                "store: the database cannot be reached or is busy; try again" + detail);
  }
  if (is_of("XX") || is_of("58")) {
    throw Error(ErrorCode::kCorruptData,
                "store: the database reports damage; restore it from a backup" + detail);
  }
  if (is_of("28") || is_of("42501") || is_of("3D")) {
    throw Error(ErrorCode::kIo,
                "store: the database does not let this user in, or there is none of that name; "
                "check address, name and rights" +
                    detail);
  }
  if (is_of("22021") || is_of("22P05")) {
    throw Error(ErrorCode::kInvalidArgument, "a text is no valid UTF-8 or holds a null" + detail);
  }
  throw Error(ErrorCode::kInternal, "store: unexpected database error" + detail);
}

}  // namespace cellmap
