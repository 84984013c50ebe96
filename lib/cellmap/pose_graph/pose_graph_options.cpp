#include <cmath>
#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

void PoseGraphOptions::validate() const {
  if (max_iterations < 1 || max_iterations > 10'000) {
    throw Error(
        ErrorCode::kInvalidArgument,
        "pose graph: max_iterations must be 1 to 10000, found " + std::to_string(max_iterations));
  }
  if (!(loop_loss_scale >= 0) || !std::isfinite(loop_loss_scale)) {
    throw Error(ErrorCode::kInvalidArgument, "pose graph: loop_loss_scale must be 0 or greater");
  }
  if (threads < 0 || threads > 1024) {
    throw Error(ErrorCode::kInvalidArgument,
                "pose graph: threads must be 0 (all) to 1024, found " + std::to_string(threads));
  }
}

}  // namespace cellmap
