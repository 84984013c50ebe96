#pragma once

#include <cstddef>
#include <functional>
#include <utility>

#include "cellmap/core/give_way.hpp"

namespace cellmap {

/// How much of a machine that others want too a computation takes.
struct Effort {
  // Most callers have no more to say than a number of threads.
  Effort(int most_threads, GiveWay between = {})  // NOLINT(google-explicit-constructor)
      : threads(most_threads), give_way(std::move(between)) {}

  int threads;  ///< 0, or more than the machine has: as many as the machine has
  GiveWay give_way;
};

/// Calls `body(begin, end)` on consecutive sub-ranges that cover [0, count) exactly once, on at
/// most as many threads as the effort says, and gives way after each. Sub-ranges are multiples of
/// `grain` long except the last, and their bounds do not depend on the thread count, so a body that
/// writes per sub-range results gives the same bytes for any thread count.
/// Serial when count <= grain or on one thread: below about a millisecond starting threads costs
/// more than the work. The first exception thrown by a body is rethrown here.
void parallel_for(std::size_t count, std::size_t grain, const Effort& effort,
                  const std::function<void(std::size_t begin, std::size_t end)>& body);

}  // namespace cellmap
