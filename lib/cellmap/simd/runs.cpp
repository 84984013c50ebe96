#include "cellmap/simd/runs.hpp"

// Compiles the rest of this file once for each instruction set.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "cellmap/simd/runs.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace cellmap::simd::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using U = hn::CappedTag<std::uint32_t, kRunsRoom>;

std::size_t RunStarts(const std::uint32_t* value, std::size_t count, std::uint32_t* start) {
  if (count == 0) return 0;
  const U u;
  const std::size_t lanes = hn::Lanes(u);
  start[0] = 0;
  std::size_t found = 1, i = 1;
  for (; i + lanes <= count; i += lanes) {
    const auto differs = hn::Ne(hn::LoadU(u, value + i), hn::LoadU(u, value + i - 1));
    const auto position = hn::Iota(u, static_cast<std::uint32_t>(i));
    hn::StoreU(hn::Compress(position, differs), u, start + found);
    found += hn::CountTrue(u, differs);
  }
  for (; i < count; ++i) {
    start[found] = static_cast<std::uint32_t>(i);
    found += value[i] != value[i - 1];
  }
  return found;
}

}  // namespace
}  // namespace cellmap::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace cellmap::simd {

HWY_EXPORT(RunStarts);

std::size_t run_starts(const std::uint32_t* value, std::size_t count, std::uint32_t* start) {
  return HWY_DYNAMIC_DISPATCH(RunStarts)(value, count, start);
}

}  // namespace cellmap::simd
#endif
