#pragma once

#include <functional>

#include "server/api/api.hpp"

namespace cellmap::server {

/// Runs `work` as one of the few relocalisations and comparisons that run at a time, because they
/// take a processor for long, and in the background, so that requests that take a millisecond are
/// answered beside them. Waits for its turn; throws Error{kUnavailable} at once where many wait
/// already, and where its turn does not come in time, and what `work` throws. `threads` are as many
/// as the options say where it is alone, else one: together they keep the processors busy anyway.
void in_turn(Services& services, const std::function<void(int threads)>& work);

}  // namespace cellmap::server
