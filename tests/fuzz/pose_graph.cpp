// An encoded pose graph.
#include "cellmap/codec/pose_graph_codec.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  const cellmap::PoseGraph graph =
      cellmap::decode_pose_graph(cellmap::Bytes(bytes.begin(), bytes.end()));
  cellmap::fuzz::must_work([&] { cellmap::decode_pose_graph(cellmap::encode_pose_graph(graph)); });
}
