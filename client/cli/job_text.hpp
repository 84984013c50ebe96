#pragma once

#include <string>

#include "cellmap/client/resources.hpp"
#include "client/cli/console.hpp"

namespace cellmap::cli {

/// One line: id, state, session, scans and CELLs, error.
std::string job_line(const Job& job);

/// Shows a job on a progress bar.
void show(ProgressBar& bar, const Job& job);

/// Throws the error of a job that failed or was cancelled.
void throw_unless_succeeded(const Job& job);

}  // namespace cellmap::cli
