#include "server/api/coded_cells.hpp"

#include <cmath>
#include <cstdio>

#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/store/read_cell.hpp"
#include "server/api/text.hpp"

namespace cellmap::server {
namespace {

void read_parameter(CodedForm& form, std::optional<double>& bound_m, std::string_view name,
                    std::string_view value) {
  if (equal_no_case(name, "encoding") && (value == "packed" || value == "compact")) {
    form.encoding = value == "packed" ? CellEncoding::kPacked : CellEncoding::kCompact;
  } else if (equal_no_case(name, "bound")) {
    bound_m = parse_number(value);
    if (!bound_m || !(*bound_m >= kMinCompactBoundM && *bound_m <= kMaxCompactBoundM)) {
      throw Error(
          ErrorCode::kInvalidArgument,
          "'bound' of a coded CELL must be 0.001 to 1 (metres), not '" + std::string(value) + "'.");
    }
  } else if (equal_no_case(name, "layers") && (value == "coarse" || value == "all")) {
    form.is_coarse = value == "coarse";
  } else if (!equal_no_case(name, "q")) {
    throw Error(ErrorCode::kInvalidArgument,
                "A coded CELL knows encoding=packed or compact, bound=METRES and layers=coarse or "
                "all, not '" +
                    std::string(name) + "=" + std::string(value) + "'.");
  }
}

/// Names a form of a CELL in the cache.
ContentHash key_of(const ContentHash& hash, const CodedForm& form) {
  CodedForm whole = form;
  whole.is_coarse = false;
  const std::string name = to_hex(hash) + to_parameters(whole);
  return sha256(std::as_bytes(std::span(name)));
}

}  // namespace

CodedForm coded_form(std::string_view accept, std::string_view type) {
  CodedForm form;
  std::optional<double> bound_m;
  for (const auto element : split(accept, ',')) {
    const auto parts = split(element, ';');
    if (parts.empty() || !equal_no_case(parts[0], type)) continue;
    for (const auto part : std::span(parts).subspan(1)) {
      const auto equals = std::min(part.find('='), part.size());
      read_parameter(form, bound_m, part.substr(0, equals),
                     part.substr(std::min(equals + 1, part.size())));
    }
    break;
  }
  if (form.encoding == CellEncoding::kCompact) {
    form.bound_m = bound_m.value_or(kDefaultCompactBoundM);
  } else if (bound_m) {
    throw Error(ErrorCode::kInvalidArgument, "A bound needs encoding=compact: packed has none.");
  }
  return form;
}

std::string to_parameters(const CodedForm& form) {
  std::string text = ";encoding=packed";
  if (form.encoding == CellEncoding::kCompact) {
    char bound[32];
    std::snprintf(bound, sizeof(bound), "%.6g", form.bound_m);
    text = std::string(";encoding=compact;bound=") + bound;
  }
  return form.is_coarse ? text + ";layers=coarse" : text;
}

CodedCells::Coded CodedCells::get(const std::string& map, CellId id, const CodedForm& form) {
  const StoredCell stored = store_.stored_cell(map, id);
  const bool is_compact = stored.form.encoding == KeptEncoding::kCompact;
  if (is_compact ||
      (stored.form.encoding == KeptEncoding::kPacked && form.encoding == CellEncoding::kPacked)) {
    return {std::make_shared<const Bytes>(zstd_decompress(*stored.frame, kMaxCodedCellBytes)),
            {is_compact ? CellEncoding::kCompact : CellEncoding::kPacked, stored.form.bound_m(),
             form.is_coarse}};
  }
  const ContentHash key = key_of(stored.hash, form);
  if (auto known = cache_.find(key)) return {known, form};
  const Cell cell = *open_stored_cell(stored).cell;
  EncodedCell coded = form.encoding == CellEncoding::kPacked
                          ? encode_packed_cell(cell)
                          : encode_compact_cell(cell, form.bound_m);
  auto bytes = std::make_shared<const Bytes>(std::move(coded.bytes));
  cache_.insert(key, bytes);
  return {bytes, form};
}

}  // namespace cellmap::server
