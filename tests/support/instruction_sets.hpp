#pragma once

#include <functional>
#include <string>

#include "cellmap/simd/targets.hpp"

namespace cellmap::test {

/// Calls `body(name)` once for every instruction set of this processor with no wider one in use.
inline void for_each_instruction_set(const std::function<void(const std::string&)>& body) {
  for (const std::string& name : simd::instruction_sets()) {
    simd::restrict_instruction_set(name);
    body(name);
  }
  simd::restrict_instruction_set("");
}

}  // namespace cellmap::test
