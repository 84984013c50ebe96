#pragma once

#include <algorithm>
#include <string_view>

#include "cellmap/simd/targets.hpp"

namespace cellmap::bench {

/// Calls `body` unrestricted and then with the library's kernels held to narrower instruction sets:
/// AVX2, the narrowest SSE, and (`also_scalar`) none, as far as this processor and build know them.
template <typename Body>
void on_instruction_sets(bool also_scalar, const Body& body) {
  const std::string widest = simd::instruction_set();
  body();
  const std::vector<std::string> sets = simd::instruction_sets();
  for (const std::string_view wanted : {"AVX2", "SSE2", "SSSE3", "SCALAR"}) {
    const bool there = std::find(sets.begin(), sets.end(), wanted) != sets.end();
    if (!there || wanted == widest || (wanted == "SCALAR" && !also_scalar)) continue;
    simd::restrict_instruction_set(std::string(wanted));
    body();
  }
  simd::restrict_instruction_set("");
}

}  // namespace cellmap::bench
