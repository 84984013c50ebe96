#include "client/cli/form_flags.hpp"

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

std::optional<CellForm> FormFlags::form() const {
  if (encoding.empty() && !bound.empty()) {
    throw Error(ErrorCode::kInvalidArgument, "--bound goes with --encoding compact");
  }
  if (encoding.empty()) return std::nullopt;
  return cell_form(encoding, bound.empty() ? std::nullopt : std::optional(metres_of(bound)));
}

void add_form_flags(CLI::App& verb, FormFlags& flags, const std::string& what) {
  verb.add_option("--encoding", flags.encoding,
                  what +
                      ". raw and packed: every bit; compact: planes within --bound, a tenth to "
                      "a fifteenth of the bytes")
      ->check(CLI::IsMember({"raw", "packed", "compact"}));
  verb.add_option("--bound", flags.bound,
                  "With compact: no point of a plane moves by more, along its normal (1mm to 1m) "
                  "[20mm]");
}

}  // namespace cellmap::cli
