#pragma once

#include <cstddef>

#include "server/api/api.hpp"

namespace cellmap::server {

/// Pairs of CELLs that one comparison of sessions may take: about 40 s of one thread. A map of 577
/// CELLs, driven again, has some 3,000.
inline constexpr std::size_t kMaxDiffPairs = 4'000;

void add_diff_route(Router& router, Services& services);

}  // namespace cellmap::server
