#pragma once

#include <functional>

#include "cellmap/core/give_way.hpp"

namespace cellmap {

/// Runs `work` on a thread of its own that yields a busy processor to others, waits for it and
/// throws what it throws. For what computes for long beside threads that answer quickly: of a
/// processor that both want it gets at most about a quarter (nice 5), a little at a time where
/// `work` calls what it is handed. Threads that help it by `parallel_for` keep their priority.
/// Starting the thread costs some 50 us.
void run_in_background(const std::function<void(const GiveWay& give_way)>& work);

}  // namespace cellmap
