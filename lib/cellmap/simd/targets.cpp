#include "cellmap/simd/targets.hpp"

#include <hwy/highway.h>

#include "cellmap/core/error.hpp"

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
    if (kept == 0) {
      std::string known;
      for (const std::string& one : instruction_sets()) known += " " + one;
      throw Error(ErrorCode::kInvalidArgument,
                  "instruction set '" + name + "' is not here; this machine has" + known);
    }
    hwy::SetSupportedTargetsForTest(kept);
  }
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

}  // namespace cellmap::simd
