#include "cellmap/core/progress.hpp"

#include "cellmap/core/error.hpp"

namespace cellmap {

void throw_if_stopped(const std::stop_token& stop) {
  if (stop.stop_requested()) throw Error(ErrorCode::kCancelled, "stopped at the caller's request");
}

}  // namespace cellmap
