#pragma once

#include "client/cli/command_line.hpp"

namespace cellmap::cli {

void add_compare(CLI::App& app, Verbs& verbs);

}  // namespace cellmap::cli
