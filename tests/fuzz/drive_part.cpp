// CELLs of a drive that another worker made, as they lie in the store.
#include "cellmap/codec/drive_part_codec.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  using namespace cellmap;
  const std::vector<MadeCell> cells = decode_drive_part(bytes);
  fuzz::must_work([&] { decode_drive_part(encode_drive_part(cells)); });
}
