#include "client/cli/exit_code.hpp"

#include <array>

namespace cellmap::cli {
namespace {

struct Row {
  ErrorCode code;
  int exit_code;
  const char* meaning;
};

constexpr std::array<Row, 16> kTable = {{
    {ErrorCode::kInternal, 1, "a fault of this program"},
    {ErrorCode::kInvalidArgument, 3, "a value is malformed or out of its range"},
    {ErrorCode::kNotFound, 4, "the map, CELL, job, loop or file does not exist"},
    {ErrorCode::kAlreadyExists, 5, "the name is taken by something else"},
    {ErrorCode::kConflict, 6, "the operation contradicts the present state"},
    {ErrorCode::kPreconditionFailed, 7, "a stated condition does not hold"},
    {ErrorCode::kCorruptData, 8, "bytes fail verification"},
    {ErrorCode::kUnsupported, 9, "a kind or version that this build cannot read"},
    {ErrorCode::kTooLarge, 10, "over a documented limit"},
    {ErrorCode::kUnavailable, 11, "the server cannot be reached or is overloaded; try again later"},
    {ErrorCode::kIo, 12, "the disk, the network or the operating system failed"},
    {ErrorCode::kUnauthenticated, 13, "no token, or one that is unknown or has expired"},
    {ErrorCode::kPermissionDenied, 14, "the token is not good for this"},
    {ErrorCode::kRateLimited, 15, "more requests than the server lets this token send"},
    {ErrorCode::kDiskFull, 16, "no room on the disk, here or at the server"},
    {ErrorCode::kCancelled, 130, "stopped on request"},
}};

}  // namespace

int exit_code(ErrorCode code) {
  for (const Row& row : kTable) {
    if (row.code == code) return row.exit_code;
  }
  return 1;
}

std::string exit_code_help() {
  std::string text = "Exit codes:\n  0    success\n  2    the command line is wrong\n";
  for (const Row& row : kTable) {
    std::string number = std::to_string(row.exit_code);
    number.resize(5, ' ');
    text += "  " + number + std::string(to_string(row.code)) + ": " + row.meaning + "\n";
  }
  return text;
}

}  // namespace cellmap::cli
