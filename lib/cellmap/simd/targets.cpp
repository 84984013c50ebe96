#include "cellmap/simd/targets.hpp"

#include <hwy/highway.h>

#include <stdexcept>

namespace cellmap::simd {

std::vector<std::string> instruction_sets() {
  std::vector<std::string> names;
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    names.emplace_back(hwy::TargetName(target));
  }
  return names;
}

std::string instruction_set() { return instruction_sets().front(); }

void restrict_instruction_set(const std::string& name) {
  hwy::SetSupportedTargetsForTest(0);
  if (!name.empty()) {
    std::int64_t kept = 0;  // targets are bits, the widest the lowest
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
      if (kept != 0 || name == hwy::TargetName(target)) kept |= target;
    }
    if (kept == 0) throw std::invalid_argument("no instruction set " + name + " here");
    hwy::SetSupportedTargetsForTest(kept);
  }
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

}  // namespace cellmap::simd
