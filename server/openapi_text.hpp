#pragma once

#include <string>

namespace cellmap::server {

/// schema/openapi.yaml as it was when the server was built.
std::string openapi_text();

}  // namespace cellmap::server
