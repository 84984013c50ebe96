// A coded CELL as a file: its structure. Hashes hold most changes off; coded_planes has none.
#include "cellmap/codec/coded_cell.hpp"

#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  cellmap::fuzz::accept_or_refuse([&] { cellmap::decode_coarse_cell(bytes, bytes.size()); });
  cellmap::validate(cellmap::decode_coded_cell(bytes).cell);
}
