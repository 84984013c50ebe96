#include "cellmap/simd/targets.hpp"

#include <gtest/gtest.h>

#include "support/expect_error.hpp"
#include "support/instruction_sets.hpp"

namespace cellmap::simd {
namespace {

TEST(InstructionSets, ARestrictionLeavesTheNarrowerOnesAndIsLifted) {
  const std::vector<std::string> all = instruction_sets();
  ASSERT_FALSE(all.empty());
  std::size_t narrower = all.size();
  test::for_each_instruction_set([&](const std::string& name) {
    EXPECT_EQ(instruction_set(), name);
    EXPECT_EQ(instruction_sets().size(), narrower--);
  });
  EXPECT_EQ(instruction_sets(), all);
}

TEST(InstructionSets, AnUnknownOneIsRefusedByName) {
  const std::vector<std::string> all = instruction_sets();
  test::expect_error(
      ErrorCode::kInvalidArgument, [] { restrict_instruction_set("MMX"); }, "'MMX' is not here");
  EXPECT_EQ(instruction_sets(), all);
}

}  // namespace
}  // namespace cellmap::simd
