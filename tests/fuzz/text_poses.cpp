// Poses as text; the first byte says which: KITTI or TUM rows, g2o, g2o as Ceres' example takes it.
#include "cellmap/pose_graph/pose_graph.hpp"
#include "cellmap/scan/trajectory.hpp"
#include "fuzz/file_of.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  using namespace cellmap;
  const int kind = fuzz::take_kind(bytes, 3);
  if (kind == 0) {
    const fuzz::FileOf file(bytes);
    const auto format = trajectory_format(file.path());
    const std::string text = to_text(read_trajectory(file.path()), format);
    const fuzz::FileOf again(std::as_bytes(std::span(text)));
    fuzz::must_work([&] { read_trajectory(again.path()); });
  } else {
    const auto meaning =
        kind == 1 ? G2oInformation::kRightPerturbation : G2oInformation::kCeresExample;
    to_g2o(pose_graph_from_g2o(fuzz::text_of(bytes), meaning));
  }
}
