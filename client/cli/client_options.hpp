#pragma once

#include "client/cli/map_reader.hpp"

namespace cellmap::cli {

/// How the server of a place is talked to. Throws Error{kInvalidArgument} where none was named.
ClientOptions client_options_of(const Place& place);

}  // namespace cellmap::cli
