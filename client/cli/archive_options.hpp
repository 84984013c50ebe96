#pragma once

#include <string>
#include <string_view>

#include "cellmap/archive/archive_writer.hpp"

namespace CLI {
class App;
}

namespace cellmap::cli {

/// Declares --encoding and --bound.
void add_archive_options(CLI::App& verb, std::string& encoding, std::string& bound);

/// "raw", "packed" or "compact", and a length as "20mm", "0.02m" or "2cm". Throws
/// Error{kInvalidArgument}.
ArchiveOptions archive_options(const std::string& encoding, const std::string& bound);

}  // namespace cellmap::cli
