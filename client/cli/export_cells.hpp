#pragma once

#include "client/cli/command_line.hpp"

namespace CLI {
class App;
}

namespace cellmap::cli {

/// The verbs of `export` that go over all CELLs: points, discs, tiles, occupancy.
void add_cell_exports(CLI::App& group, Verbs& verbs);

}  // namespace cellmap::cli
