#pragma once

#include <string>

#include "cellmap/client/client.hpp"

namespace cellmap {

/// Keeps a comparison of map representations (the JSON of `cellmap compare`) with a map of a
/// server, instead of the last one. Throws as `Client`.
void put_comparison(const ClientOptions& server, const std::string& map, const std::string& json);

/// The one that is kept. Throws as `Client`; Error{kNotFound} where there is none.
std::string comparison_text(const ClientOptions& server, const std::string& map);

}  // namespace cellmap
