// Head, states, footer and lists of an archive, each for itself; the first byte says which.
#include "cellmap/codec/archive_cells.hpp"
#include "cellmap/codec/archive_footer.hpp"
#include "cellmap/codec/archive_layout.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  if (bytes.empty()) return;
  const auto part = bytes.subspan(1);
  switch (std::to_integer<int>(bytes[0]) % 5) {
    case 0:
      cellmap::decode_archive_head(part);
      return;
    case 1:
      cellmap::decode_archive_state(part);
      return;
    case 2:
      cellmap::decode_archive_footer(part);
      return;
    case 3:
      cellmap::decode_archive_scans(part);
      return;
    default:
      cellmap::decode_archive_record_header(part);
  }
}
