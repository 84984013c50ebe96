#include "cellmap/simd/runs.hpp"

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "support/instruction_sets.hpp"

namespace cellmap::simd {
namespace {

TEST(RunStarts, AreWhereAValueDiffersFromTheOneBefore) {
  for (const std::size_t count : {0, 1, 2, 5, 16, 17, 18, 33, 2'048}) {
    for (const double share_of_changes : {0.0, 0.25, 1.0}) {
      std::mt19937 rng(11);
      std::bernoulli_distribution changes(share_of_changes);
      std::vector<std::uint32_t> value(count), slow;
      for (std::size_t i = 0; i < count; ++i) {
        value[i] = i == 0 ? 0xFFFF'FFFF : value[i - 1] + (changes(rng) ? 1 : 0);
        if (i == 0 || value[i] != value[i - 1]) slow.push_back(static_cast<std::uint32_t>(i));
      }
      test::for_each_instruction_set([&](const std::string& name) {
        std::vector<std::uint32_t> start(count + kRunsRoom);
        start.resize(run_starts(value.data(), count, start.data()));
        EXPECT_EQ(start, slow) << name << ' ' << count << ' ' << share_of_changes;
      });
    }
  }
}

}  // namespace
}  // namespace cellmap::simd
