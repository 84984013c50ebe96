#pragma once

#include <functional>

namespace cellmap {

/// Runs `work` on a thread of its own that yields a busy processor to others, waits for it and
/// throws what it throws. For what computes for long beside threads that answer quickly: of a
/// processor that both want it gets about a quarter (nice 5). Threads that help it by
/// `parallel_for` do not yield. Starting the thread costs some 50 us.
void run_in_background(const std::function<void()>& work);

}  // namespace cellmap
