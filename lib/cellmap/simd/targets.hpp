#pragma once

#include <string>
#include <vector>

namespace cellmap::simd {

/// The kernels of this room are compiled for several instruction sets; the widest that the
/// processor has is chosen when one is first called. These are for tests and benchmarks, which
/// compare them; a program has no reason to call them.

/// Names of those this processor can run, the widest first, for example {"AVX3", "AVX2", "SSE4",
/// "SSSE3", "SCALAR"} (AVX3 is AVX-512); while a restriction holds, those that it leaves.
std::vector<std::string> instruction_sets();

/// The one in use.
std::string instruction_set();

/// From now on no wider one than `name` is used; an empty name lifts the restriction. Throws
/// Error{kInvalidArgument}, without a restriction left, for a name that this processor or this
/// build does not have. Affects the whole process: not while another thread computes.
void restrict_instruction_set(const std::string& name);

}  // namespace cellmap::simd
