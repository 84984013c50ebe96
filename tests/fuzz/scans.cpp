// Bodies of scans; the first byte says which: one scan, a batch, KITTI's points.
#include "cellmap/codec/scan_batch.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  using namespace cellmap;
  const int kind = fuzz::take_kind(bytes, 3);
  const Bytes body(bytes.begin(), bytes.end());
  if (kind == 0) {
    const PosedScan scan = decode_scan(body);
    fuzz::must_work([&] { decode_scan(encode_scan(scan)); });
  } else if (kind == 1) {
    Bytes again;
    const auto scans = decode_scan_batch(body);
    fuzz::must_work([&] {
      for (const PosedScan& scan : scans) append_to_scan_batch(again, scan);
      decode_scan_batch(again);
    });
  } else {
    parse_kitti_bin(body);
  }
}
