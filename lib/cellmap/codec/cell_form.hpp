#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace cellmap {

/// How the bytes of a CELL are kept; the format's numbers.
enum class KeptEncoding : std::uint8_t {
  kRaw = 1,      ///< the CELL in a zstd frame: every bit, mappable once decompressed
  kPacked = 2,   ///< a packed coded CELL: every bit, fewer bytes
  kCompact = 3,  ///< a compact coded CELL: planes within a bound
};

std::string_view to_string(KeptEncoding encoding);  ///< "raw", "packed", "compact"

/// In which bytes a map keeps its CELLs.
struct CellForm {
  KeptEncoding encoding = KeptEncoding::kRaw;
  std::uint32_t bound_um = 0;  ///< of kCompact, micrometres as coded CELLs have it; else 0
  auto operator<=>(const CellForm&) const = default;

  double bound_m() const { return bound_um * 1e-6; }
  /// No plane may be further from its source than in this form.
  bool is_within(const CellForm& other) const { return bound_um <= other.bound_um; }
  bool is_exact() const { return bound_um == 0; }

  /// Throws Error{kInvalidArgument}: a compact form needs a bound of 1 mm to 1 m, others have none.
  void validate() const;
};

/// The bound in whole micrometres, rounded down as `encode_compact_cell` does it. Throws
/// Error{kInvalidArgument} outside 1 mm to 1 m.
CellForm compact_form(double bound_m);

/// "raw", "packed" or "compact", this one within `bound_m` (20 mm where it is not said). Throws
/// Error{kInvalidArgument} for another name, a bound out of range, or one without "compact".
CellForm cell_form(std::string_view encoding, std::optional<double> bound_m);

/// "raw", "packed", "compact 20 mm".
std::string to_string(const CellForm& form);

}  // namespace cellmap
