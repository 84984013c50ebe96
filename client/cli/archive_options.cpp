#include "client/cli/archive_options.hpp"

#include <CLI/CLI.hpp>
#include <charconv>

#include "cellmap/core/error.hpp"

namespace cellmap::cli {
namespace {

double metres_of(const std::string& text) {
  double value = 0;
  const char* const end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, value);
  const std::string_view unit(parsed.ptr, static_cast<std::size_t>(end - parsed.ptr));
  const double metres = unit == "mm" ? 1e-3 : unit == "cm" ? 1e-2 : unit == "m" ? 1 : 0;
  if (parsed.ec != std::errc() || metres == 0) {
    throw Error(ErrorCode::kInvalidArgument,
                "--bound is a length such as 20mm, 2cm or 0.02m, not '" + text + "'");
  }
  return value * metres;
}

}  // namespace

void add_archive_options(CLI::App& verb, std::string& encoding, std::string& bound) {
  verb.add_option("--encoding", encoding,
                  "packed: every bit; compact: planes within --bound, a tenth of the bytes; raw: "
                  "every bit, as a store keeps it")
      ->check(CLI::IsMember({"packed", "compact", "raw"}))
      ->capture_default_str();
  verb.add_option("--bound", bound,
                  "With compact: no point of a plane moves by more, along its normal (1mm to 1m)")
      ->capture_default_str();
}

ArchiveOptions archive_options(const std::string& encoding, const std::string& bound) {
  ArchiveOptions options;
  options.encoding = archive_encoding_from_string(encoding);
  if (options.encoding == ArchiveEncoding::kCompact) options.bound_m = metres_of(bound);
  options.validate();
  return options;
}

}  // namespace cellmap::cli
