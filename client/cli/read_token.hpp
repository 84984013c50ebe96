#pragma once

#include <string>

namespace cellmap::cli {

/// The token that stands in a file, or without one in the environment's CELLMAP_TOKEN; "" where
/// there is neither. Never from the command line, which everyone on the machine can read. Throws
/// Error{kNotFound} or {kInvalidArgument}.
std::string read_token(const std::string& file);

}  // namespace cellmap::cli
