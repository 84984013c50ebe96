// Values of a store's tables; the first byte says which.
#include "cellmap/store/row_codec.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  using namespace cellmap;
  switch (fuzz::take_kind(bytes, 5)) {
    case 0:
      pose_from_bytes(bytes);
      return;
    case 1:
      pose_from_columns(Eigen::Vector3d::Zero(), bytes);
      return;
    case 2:
      information_from_bytes(bytes);
      return;
    case 3:
      scores_from_bytes(bytes);
      return;
    default:
      scans_from_bytes(bytes);
  }
}
