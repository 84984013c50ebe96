#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>

#include "cellmap/client/client.hpp"
#include "cellmap/codec/cell_form.hpp"
#include "cellmap/codec/coded_cell.hpp"

namespace cellmap {

/// In which few bytes CELLs travel.
struct CodedCellForm {
  CellEncoding encoding = CellEncoding::kCompact;
  double bound_m = kDefaultCompactBoundM;  ///< of compact
};

/// Packed or compact; Error{kInvalidArgument} for raw.
CodedCellForm coded_form_of(const CellForm& form);

/// A CELL that came in few bytes, verified: its content hash, of a coarse one its coarse hash.
struct FetchedCodedCell {
  CellId id;
  Bytes bytes;  ///< as they came: a coded CELL, or its beginning where `decoded.is_coarse`
  /// The map's own CELL is the one of `raw_hash`, or, where the map keeps it compact, this one.
  DecodedCell decoded;
  std::uint64_t file_bytes = 0;  ///< of the whole coded CELL
};

/// Reads the CELLs of a map over thin links: compact within a bound, about a twelfth of their bytes
/// at 20 mm, and first a coarse quarter of their planes where that will do. Uses no cache on disk.
/// A map that keeps its CELLs compact has them in no other form: those bytes come for every form
/// whose bound is no tighter; for a tighter one, or packed: Error{kConflict} that names the bound.
/// Throws what `Client` throws. Not thread safe; movable.
class CodedCellReader {
 public:
  /// Throws Error{kInvalidArgument} for a bad URL or option. Connects on first use.
  explicit CodedCellReader(const ClientOptions& options);
  ~CodedCellReader();
  CodedCellReader(CodedCellReader&&) noexcept;
  CodedCellReader& operator=(CodedCellReader&&) noexcept;

  FetchedCodedCell cell(const std::string& map, CellId id, const CodedCellForm& form = {});

  /// A quarter of its planes, the same as in the whole, in about a third of the bytes.
  FetchedCodedCell coarse_cell(const std::string& map, CellId id, const CodedCellForm& form = {});

  /// The CELLs of a list (`Client::all_cells`) in batches, in the order in which they come; each
  /// must be one of the list's content, else Error{kConflict}.
  void for_each_cell(
      const std::string& map, std::span<const CellRecord> cells, const CodedCellForm& form,
      const std::function<void(const CellRecord&, const FetchedCodedCell&)>& on_cell);

  Traffic traffic() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap
