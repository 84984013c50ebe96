// CELLs; the first byte says which: raw ones behind their hash, as a store gives them out, else a
// zstd frame or a batch.
#include "cellmap/codec/cell_batch.hpp"
#include "cellmap/codec/zstd.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  using namespace cellmap;
  const int kind = fuzz::take_kind(bytes, 3);
  if (kind == 0) {
    const Cell cell = decode_stored_cell(zstd_compress(bytes, 1));
    fuzz::must_work([&] { decode_cell(encode_cell(cell).bytes); });
  } else if (kind == 1) {
    zstd_decompress(bytes, 1 << 20);
  } else {
    CellBatchReader reader(bytes);
    while (const auto cell = reader.next()) {
      fuzz::accept_or_refuse([&] { decode_cell(Bytes(cell->bytes.begin(), cell->bytes.end())); });
    }
  }
}
