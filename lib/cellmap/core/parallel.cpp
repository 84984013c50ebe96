#include "cellmap/core/parallel.hpp"

#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>

namespace cellmap {

void parallel_for(std::size_t count, std::size_t grain, const Effort& effort,
                  const std::function<void(std::size_t begin, std::size_t end)>& body) {
  if (count == 0) return;
  grain = std::max<std::size_t>(grain, 1);
  const std::size_t chunks = (count + grain - 1) / grain;
  const auto run = [&](std::size_t chunk) {
    body(chunk * grain, std::min(count, (chunk + 1) * grain));
    effort.give_way();
  };
  if (chunks == 1 || effort.threads == 1) {
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) run(chunk);
    return;
  }
  // TBB warns on standard error where it is asked for more threads than the machine has.
  const int available = tbb::info::default_concurrency();
  tbb::task_arena arena(effort.threads > 0 ? std::min(effort.threads, available) : available);
  arena.execute([&] { tbb::parallel_for(std::size_t{0}, chunks, run); });
}

}  // namespace cellmap
