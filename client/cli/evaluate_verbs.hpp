#pragma once

#include "client/cli/command_line.hpp"

namespace cellmap::cli {

/// `evaluate relocalisation`, declared under `evaluate`.
void add_evaluate_relocalisation(CLI::App& group, Verbs& verbs);

/// `evaluate diff`, the same.
void add_evaluate_diff(CLI::App& group, Verbs& verbs);

}  // namespace cellmap::cli
