// Encoded changes of a map.
#include "cellmap/codec/changes_codec.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  const cellmap::MapChanges changes =
      cellmap::decode_changes(cellmap::Bytes(bytes.begin(), bytes.end()));
  cellmap::fuzz::must_work([&] { cellmap::decode_changes(cellmap::encode_changes(changes)); });
}
