#include "cellmap/core/error.hpp"

#include <array>
#include <utility>

namespace cellmap {
namespace {

constexpr std::array<std::pair<ErrorCode, std::string_view>, 16> kNames = {{
    {ErrorCode::kInvalidArgument, "invalid-argument"},
    {ErrorCode::kNotFound, "not-found"},
    {ErrorCode::kAlreadyExists, "already-exists"},
    {ErrorCode::kConflict, "conflict"},
    {ErrorCode::kPreconditionFailed, "precondition-failed"},
    {ErrorCode::kCorruptData, "corrupt-data"},
    {ErrorCode::kUnsupported, "unsupported"},
    {ErrorCode::kTooLarge, "too-large"},
    {ErrorCode::kUnavailable, "unavailable"},
    {ErrorCode::kCancelled, "cancelled"},
    {ErrorCode::kIo, "io"},
    {ErrorCode::kUnauthenticated, "unauthenticated"},
    {ErrorCode::kPermissionDenied, "permission-denied"},
    {ErrorCode::kRateLimited, "rate-limited"},
    {ErrorCode::kDiskFull, "disk-full"},
    {ErrorCode::kInternal, "internal"},
}};

}  // namespace

std::string_view to_string(ErrorCode code) {
  for (const auto& [known, name] : kNames) {
    if (known == code) return name;
  }
  return "internal";
}

ErrorCode error_code_from_string(std::string_view name) {
  for (const auto& [code, known] : kNames) {
    if (known == name) return code;
  }
  return ErrorCode::kInternal;
}

}  // namespace cellmap
