#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "cellmap/core/error.hpp"
#include "server/api/message.hpp"

namespace cellmap::server {

/// The one table from codes to HTTP statuses.
int status_of(ErrorCode code);

/// Problem documents (RFC 9457) for what went wrong; `set_instance` says in which request.
Response problem(ErrorCode code, const std::string& detail,
                 const std::optional<std::uint64_t>& next_scan = std::nullopt);
inline Response problem(const Error& error) { return problem(error.code(), error.what()); }

/// The three that only HTTP knows.
Response method_not_allowed(const std::string& allow);
Response not_acceptable(std::span<const std::string_view> available);
Response range_not_satisfiable(std::size_t size);

/// For the front, which refuses some requests before they reach the API: any status with a code.
Response problem_with_status(int status, ErrorCode code, const std::string& detail);

/// The code of a problem document; "" for other responses.
std::string problem_code(const Response& response);

/// Puts the path of the request and its id into a problem document; leaves other responses alone.
void set_instance(Response& response, std::string_view path, const std::string& request_id);

}  // namespace cellmap::server
