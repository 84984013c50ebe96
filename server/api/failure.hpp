#pragma once

#include <exception>
#include <string>

#include "server/api/message.hpp"

namespace cellmap::server {

/// The problem document for any exception that a handler, or the reading of a body, ended with. Of
/// what is the server's own fault only the log tells more: `request_id`
/// says where.
Response problem_of(const std::exception_ptr& failure, const std::string& request_id);

}  // namespace cellmap::server
