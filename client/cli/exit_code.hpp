#pragma once

#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap::cli {

/// What `cellmap` returns to the shell. Stable: scripts depend on the numbers.
constexpr int kSuccess = 0;
constexpr int kUsageError = 2;  ///< the command line itself: unknown verb, missing or malformed option

/// 3 and up, one a code, in the order of `ErrorCode`; 130 for cancelled, as a shell does for Ctrl-C.
int exit_code(ErrorCode code);

/// The table of all exit codes for `--help`.
std::string exit_code_help();

}  // namespace cellmap::cli
