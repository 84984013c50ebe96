#pragma once

#include "client/cli/command_line.hpp"

namespace cellmap::cli {

void add_copy(CLI::App& app, Verbs& verbs);

}  // namespace cellmap::cli
