#pragma once

#include <string>

namespace cellmap {

/// libpq's text without its line ends.
std::string without_line_end(const char* message);

/// Throws what a state of the SQL standard means for us (PostgreSQL manual, appendix A); empty: the
/// server did not say any, because it cannot be reached.
[[noreturn]] void throw_postgres_error(const std::string& state, const std::string& message);

}  // namespace cellmap
