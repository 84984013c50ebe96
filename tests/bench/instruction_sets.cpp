#include "bench/instruction_sets.hpp"

#if __has_include("cellmap/simd/targets.hpp")
#include <vector>

#include "cellmap/simd/targets.hpp"

namespace cellmap::bench {

std::string instruction_set() { return simd::instruction_set(); }

void on_instruction_sets(const std::function<void()>& body) {
  body();
  const std::vector<std::string> sets = simd::instruction_sets();
  const std::string widest = simd::instruction_set();
  for (const std::string& set : sets) {
    if (set == widest || (set != "AVX2" && set != sets.back())) continue;
    simd::restrict_instruction_set(set);
    body();
  }
  simd::restrict_instruction_set("");
}

}  // namespace cellmap::bench
#else
namespace cellmap::bench {

std::string instruction_set() { return ""; }
void on_instruction_sets(const std::function<void()>& body) { body(); }

}  // namespace cellmap::bench
#endif
