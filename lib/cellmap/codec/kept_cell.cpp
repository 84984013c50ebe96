#include "cellmap/codec/kept_cell.hpp"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::string_view kCodedIdentifier = "CCOD";
constexpr std::size_t kIdentifierOffset = 4;  // of every FlatBuffer

CellForm form_of(const DecodedCell& decoded) {
  return decoded.encoding == CellEncoding::kPacked ? CellForm{KeptEncoding::kPacked, 0}
                                                   : compact_form(decoded.bound_m);
}

KeptCell opened(Bytes bytes) {
  DecodedCell decoded = decode_coded_cell(bytes);
  KeptCell kept;
  kept.coded = CodedCopy{form_of(decoded), {decoded.hash, std::move(bytes)}, decoded.raw_hash};
  kept.cell = std::make_shared<const Cell>(std::move(decoded.cell));
  kept.encoded = encode_cell(*kept.cell);
  return kept;
}

}  // namespace

KeptCell keep_cell(std::shared_ptr<const Cell> cell, const CellForm& form,
                   std::optional<EncodedCell> as_it_came) {
  form.validate();
  if (form.encoding == KeptEncoding::kCompact) {
    KeptCell kept = opened(encode_compact_cell(*cell, form.bound_m()).bytes);
    if (as_it_came) kept.coded->source = as_it_came->hash;
    return kept;
  }
  if (form.encoding == KeptEncoding::kRaw) {
    EncodedCell encoded = as_it_came ? *std::move(as_it_came) : encode_cell(*cell);
    return {std::move(cell), std::move(encoded)};
  }
  KeptCell kept{cell, encode_cell(*cell)};
  kept.coded =
      CodedCopy{form, encode_packed_cell(*cell), as_it_came ? as_it_came->hash : kept.encoded.hash};
  return kept;
}

KeptCell keep_coded_cell(Bytes bytes, const CellForm& form) {
  KeptCell kept = opened(std::move(bytes));
  if (!kept.coded->form.is_exact() || kept.coded->form == form) return kept;
  return keep_cell(std::move(kept.cell), form);
}

bool is_coded_cell(std::span<const std::byte> bytes) {
  if (bytes.size() < kIdentifierOffset + kCodedIdentifier.size()) return false;
  return std::ranges::equal(bytes.subspan(kIdentifierOffset, kCodedIdentifier.size()),
                            kCodedIdentifier,
                            [](std::byte a, char b) { return std::to_integer<char>(a) == b; });
}

KeptCell open_kept_cell(Bytes bytes, const ContentHash& hash) {
  KeptCell kept;
  if (is_coded_cell(bytes)) {
    kept = opened(std::move(bytes));
  } else {
    const CellView view = view_cell(bytes);
    kept.cell = std::make_shared<const Cell>(view.to_cell());
    kept.encoded = {view.hash, std::move(bytes)};
  }
  if (kept.encoded.hash == hash) return kept;
  throw Error(ErrorCode::kCorruptData,
              "the bytes kept for CELL content " + to_hex(hash) +
                  " are those of another one: " + to_hex(kept.encoded.hash));
}

}  // namespace cellmap
