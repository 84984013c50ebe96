#pragma once

#include <semaphore>

#include "cellmap/core/error.hpp"
#include "server/api/api.hpp"

namespace cellmap::server {

/// One of the few relocalisations and comparisons that may run at a time: they take a processor for
/// long. Waits for it; throws Error{kUnavailable} where none is to be had.
class Turn {
 public:
  explicit Turn(Services& services) : turns_(services.relocalisations) {
    if (!turns_.try_acquire_for(services.options.relocalisation_wait)) {
      throw Error(ErrorCode::kUnavailable,
                  "Too many relocalisations and comparisons at a time; try again.");
    }
  }
  ~Turn() { turns_.release(); }
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;

 private:
  std::counting_semaphore<>& turns_;
};

}  // namespace cellmap::server
