#pragma once

#include <optional>
#include <string>

#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/store/blob_cache.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap::server {

inline constexpr const char* kCodedCellType = "application/vnd.cellmap.coded-cell";
inline constexpr const char* kCodedCellsType = "application/vnd.cellmap.coded-cells";

/// A form of a CELL in fewer bytes, as an Accept header asks for it.
struct CodedForm {
  CellEncoding encoding = CellEncoding::kPacked;
  double bound_m = 0;      ///< of compact
  bool is_coarse = false;  ///< the first bytes, up to the end of the coarse layer
};

/// The parameters of `type` in an Accept value: encoding=packed (as without one) or compact, with
/// bound=M in metres (0.02 without one), and layers=coarse. Throws Error{kInvalidArgument} for what
/// they cannot be.
CodedForm coded_form(std::string_view accept, std::string_view type);

/// The form as parameters of a media type: ";encoding=compact;bound=0.02".
std::string to_parameters(const CodedForm& form);

/// CELLs that were coded last: coding one takes some milliseconds, and those who follow a map want
/// the same ones. Thread safe.
class CodedCells {
 public:
  explicit CodedCells(const Store& store) : store_(store), cache_(32u << 20) {}

  struct Coded {
    std::shared_ptr<const Bytes> bytes;
    CodedForm form;  ///< of the bytes, with the layers that were asked for
  };
  /// The whole coded CELL, whatever layers are asked for. Where the store keeps it in the form that
  /// is asked for, its bytes. A compact one always: its bytes are the CELL, so no form is more
  /// exact, and a wider bound would add a second error to the first.
  Coded get(const std::string& map, CellId id, const CodedForm& form);

 private:
  const Store& store_;
  BlobCache cache_;
};

}  // namespace cellmap::server
