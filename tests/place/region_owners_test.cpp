#include "cellmap/place/region_owners.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>

namespace cellmap {
namespace {

using Names = std::vector<std::string>;

Names servers(std::size_t count) {
  Names names;
  for (std::size_t i = 0; i < count; ++i) {
    names.push_back("http://10.0.0." + std::to_string(i + 1) + ":8080");
  }
  return names;
}

/// By region of a square, the name of its owner.
std::map<RegionKey, std::string> owned(const Names& owners, const std::string& map) {
  const RegionOwners of(owners, map);
  std::map<RegionKey, std::string> names;
  for (std::int32_t x = -40; x < 40; ++x) {
    for (std::int32_t y = -40; y < 40; ++y) names[{x, y}] = owners[of.owner_of({x, y})];
  }
  return names;
}

/// As many as n independent choices of probability p give, to five standard deviations.
void expect_share(std::size_t count, std::size_t n, double p) {
  const double expected = static_cast<double>(n) * p;
  EXPECT_NEAR(static_cast<double>(count), expected, 5 * std::sqrt(expected * (1 - p)));
}

TEST(RegionOwners, EachHasAboutTheSameShare) {
  for (const std::size_t count : {2u, 3u, 7u}) {
    std::map<std::string, std::size_t> regions;
    for (const auto& [region, owner] : owned(servers(count), "town")) ++regions[owner];
    ASSERT_EQ(regions.size(), count);
    for (const auto& [owner, n] : regions) expect_share(n, 6400, 1.0 / static_cast<double>(count));
  }
}

/// Else the region at the origin, which every map has, would be one server's.
TEST(RegionOwners, TheSameRegionOfOtherMapsHasOtherOwners) {
  std::size_t first = 0;
  for (int map = 0; map < 900; ++map) {
    first += RegionOwners(servers(3), "map-" + std::to_string(map)).owner_of({0, 0}) == 0;
  }
  expect_share(first, 900, 1.0 / 3);
}

TEST(RegionOwners, WhoLeavesLeavesItsShareToAllOthersAndNothingElseMoves) {
  const auto before = owned(servers(4), "town");
  auto three = servers(4);
  const std::string gone = three[1];
  three.erase(three.begin() + 1);
  const auto after = owned(three, "town");
  std::map<std::string, std::size_t> heirs;
  std::size_t moved = 0;
  for (const auto& [region, owner] : before) {
    if (owner != gone) {
      EXPECT_EQ(after.at(region), owner);
    } else {
      ++heirs[after.at(region)];
      ++moved;
    }
  }
  ASSERT_EQ(heirs.size(), 3u);
  for (const auto& [heir, n] : heirs) expect_share(n, moved, 1.0 / 3);
}

TEST(RegionOwners, TheOrderOfTheListDoesNotMatter) {
  auto turned = servers(5);
  std::ranges::reverse(turned);
  EXPECT_EQ(owned(turned, "town"), owned(servers(5), "town"));
}

TEST(RegionOwners, OneHasAll) { EXPECT_EQ(RegionOwners(servers(1), "town").owner_of({3, -4}), 0u); }

}  // namespace
}  // namespace cellmap
