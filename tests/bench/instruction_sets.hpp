#pragma once

#include <functional>
#include <string>

namespace cellmap::bench {

/// The instruction set that the library's kernels use; "" where it has none of its own.
std::string instruction_set();

/// Calls `body` unrestricted and then with the kernels held to AVX2 and to the narrowest set, where
/// this processor has wider ones.
void on_instruction_sets(const std::function<void()>& body);

}  // namespace cellmap::bench
