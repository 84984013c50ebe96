#include <CLI/CLI.hpp>
#include <memory>

#include "client/cli/command_line.hpp"

namespace cellmap::cli {
void add_build(CLI::App&, Verbs&) {}
}  // namespace cellmap::cli
