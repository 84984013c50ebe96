#pragma once

#include <spdlog/logger.h>

#include <memory>
#include <string>

#include "server/api/json_io.hpp"

namespace cellmap::server {

enum class LogFormat {
  kText,  ///< for people
  kJson,  ///< one object a line: time, level, message, request_id where there is one, and fields
};

/// A log on standard error.
std::shared_ptr<spdlog::logger> make_log(const std::string& level, LogFormat format);
std::unique_ptr<spdlog::formatter> make_formatter(LogFormat format);

/// A message of which the JSON format also shows these members. A message that begins with "[id] "
/// is that request's.
std::string with_fields(std::string message, const Json& fields);

}  // namespace cellmap::server
