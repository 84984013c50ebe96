#pragma once

#include <cstddef>
#include <functional>

namespace cellmap {

/// Calls `body(begin, end)` on consecutive sub-ranges that cover [0, count) exactly once, on at
/// most `threads` threads (0, or more than the machine has: as many as the machine has). Sub-ranges
/// are multiples of `grain` long except the last, and their bounds do not depend on the thread
/// count, so a body that writes per sub-range results gives the same bytes for any thread count.
/// Serial when count <= grain or threads == 1: below about a millisecond starting threads costs
/// more than the work. The first exception thrown by a body is rethrown here.
void parallel_for(std::size_t count, std::size_t grain, int threads,
                  const std::function<void(std::size_t begin, std::size_t end)>& body);

}  // namespace cellmap
