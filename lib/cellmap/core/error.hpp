#pragma once

#include <stdexcept>
#include <string>
#include <string_view>

namespace cellmap {

/// What went wrong, as a closed list shared by the library, the HTTP API and the command line.
/// The API maps each code to one HTTP status (server/problem.hpp), the command line to one exit
/// code (client/cli/exit_code.hpp). The names returned by `to_string` are part of the API.
enum class ErrorCode {
  kInvalidArgument,  ///< "invalid-argument": a value is malformed or outside its documented range
  kNotFound,         ///< "not-found": the named map, CELL, job, loop or file does not exist
  kAlreadyExists,    ///< "already-exists": the name is taken by something else
  kConflict,         ///< "conflict": the operation contradicts the present state
  kPreconditionFailed,  ///< "precondition-failed": a stated condition (If-Match) does not hold
  kCorruptData,         ///< "corrupt-data": bytes fail verification or validation
  kUnsupported,  ///< "unsupported": well-formed, but a kind or version this build cannot read
  kTooLarge,     ///< "too-large": over a documented limit
  kUnavailable,  ///< "unavailable": overloaded or shutting down; the same request may work later
  kCancelled,    ///< "cancelled": stopped at the caller's request
  kIo,           ///< "io": the operating system, the disk or the network failed
  kInternal,     ///< "internal": a fault of this program
  kUnauthenticated,   ///< "unauthenticated": no token, or one that is unknown or has expired
  kPermissionDenied,  ///< "permission-denied": the token is not good for this
  kRateLimited,       ///< "rate-limited": more requests than the token or the address may send
  kDiskFull,          ///< "disk-full": nothing was changed; the same works once there is room
};

/// Stable lower-case name, for example "not-found".
std::string_view to_string(ErrorCode code);

/// The machine failed, not what it was given: kIo and kDiskFull.
constexpr bool is_io(ErrorCode code) {
  return code == ErrorCode::kIo || code == ErrorCode::kDiskFull;
}

/// Inverse of `to_string`; unknown names give `kInternal`.
ErrorCode error_code_from_string(std::string_view name);

/// The one exception of the project: the world outside failed or sent something wrong.
/// The message is shown to users: it says what was expected, what was found and what to do.
/// Outcomes of the domain (no loop, not converged) are values, never exceptions.
class Error : public std::runtime_error {
 public:
  Error(ErrorCode code, const std::string& message) : std::runtime_error(message), code_(code) {}
  ErrorCode code() const { return code_; }

 private:
  ErrorCode code_;
};

}  // namespace cellmap
