#include "cellmap/codec/cell_form.hpp"

#include <array>
#include <cmath>
#include <cstdio>

#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::array kEncodings = {KeptEncoding::kRaw, KeptEncoding::kPacked,
                                   KeptEncoding::kCompact};
constexpr double kMicro = 1e-6;

}  // namespace

std::string_view to_string(KeptEncoding encoding) {
  switch (encoding) {
    case KeptEncoding::kRaw:
      return "raw";
    case KeptEncoding::kPacked:
      return "packed";
    case KeptEncoding::kCompact:
      return "compact";
  }
  return "unknown";
}

void CellForm::validate() const {
  const bool is_compact = encoding == KeptEncoding::kCompact;
  if (is_compact ? bound_um >= kMinCompactBoundM / kMicro && bound_um <= kMaxCompactBoundM / kMicro
                 : bound_um == 0) {
    return;
  }
  throw Error(ErrorCode::kInvalidArgument,
              is_compact ? "the bound of compact CELLs lies between 0.001 and 1 m, found " +
                               std::to_string(bound_m())
                         : "a bound needs the encoding 'compact': " +
                               std::string(to_string(encoding)) + " has none");
}

CellForm compact_form(double bound_m) {
  if (!(bound_m >= kMinCompactBoundM && bound_m <= kMaxCompactBoundM)) {
    throw Error(
        ErrorCode::kInvalidArgument,
        "the bound of compact CELLs lies between 0.001 and 1 m, found " + std::to_string(bound_m));
  }
  return {KeptEncoding::kCompact, static_cast<std::uint32_t>(std::floor(bound_m / kMicro + 1e-3))};
}

CellForm cell_form(std::string_view encoding, std::optional<double> bound_m) {
  for (const KeptEncoding known : kEncodings) {
    if (to_string(known) != encoding) continue;
    if (known == KeptEncoding::kCompact) {
      return compact_form(bound_m.value_or(kDefaultCompactBoundM));
    }
    if (bound_m) break;
    return {known, 0};
  }
  throw Error(ErrorCode::kInvalidArgument,
              "CELLs are kept as raw, packed or compact, and compact alone has a bound; found '" +
                  std::string(encoding) + "'" + (bound_m ? " with a bound" : ""));
}

std::string to_string(const CellForm& form) {
  std::string text(to_string(form.encoding));
  if (form.encoding != KeptEncoding::kCompact) return text;
  char bound[32];
  std::snprintf(bound, sizeof(bound), " %.6g mm", form.bound_um * 1e-3);
  return text + bound;
}

}  // namespace cellmap
