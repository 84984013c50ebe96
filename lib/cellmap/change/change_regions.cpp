#include "cellmap/change/change_regions.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>

namespace cellmap {
namespace {

/// Sets that are joined step by step.
class Sets {
 public:
  explicit Sets(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), std::size_t{0});
  }
  std::size_t of(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::size_t a, std::size_t b) {
    a = of(a);
    b = of(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::size_t> parent_;
};

using Box = std::array<std::int64_t, 3>;

/// Joins patches within `gap_m`. Cubes of that edge over the root of three hold only patches that
/// belong together, so that each is entered once and only cubes have to be compared.
Sets joined(const std::vector<ChangedPatch>& patches, double gap_m) {
  const double edge_m = gap_m / std::sqrt(3.0);
  std::map<Box, std::vector<std::size_t>> cubes;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    Box box;
    for (int axis = 0; axis < 3; ++axis) {
      box[static_cast<std::size_t>(axis)] =
          static_cast<std::int64_t>(std::floor(patches[i].position[axis] / edge_m));
    }
    cubes[box].push_back(i);
  }
  Sets sets(patches.size());
  const auto near = [&](std::size_t a, std::size_t b) {
    return (patches[a].position - patches[b].position).norm() <= gap_m;
  };
  const auto touch = [&](const std::vector<std::size_t>& a, const std::vector<std::size_t>& b) {
    if (sets.of(a.front()) == sets.of(b.front())) return;
    for (const std::size_t i : a) {
      for (const std::size_t j : b) {
        if (near(i, j)) return sets.join(i, j);
      }
    }
  };
  for (const auto& [box, members] : cubes) {
    for (const std::size_t i : members) sets.join(members.front(), i);
  }
  for (const auto& [box, members] : cubes) {
    for (std::int64_t x = -2; x <= 2; ++x) {
      for (std::int64_t y = -2; y <= 2; ++y) {
        for (std::int64_t z = -2; z <= 2; ++z) {
          const Box other{box[0] + x, box[1] + y, box[2] + z};
          if (!(box < other)) continue;
          if (const auto found = cubes.find(other); found != cubes.end())
            touch(members, found->second);
        }
      }
    }
  }
  return sets;
}

ChangeRegion region_of(const std::vector<const ChangedPatch*>& patches, PatchChange change) {
  ChangeRegion region;
  region.change = change;
  region.patches = static_cast<std::uint32_t>(patches.size());
  std::map<CellId, double> area_m2;
  for (const ChangedPatch* patch : patches) {
    region.box.extend(patch->position);
    region.centroid += patch->position / static_cast<double>(patches.size());
    area_m2[patch->cell] += patch->area_m2;
  }
  for (const auto& [cell, area] : area_m2) {
    region.cells.push_back(cell);
    region.area_m2 = std::max(region.area_m2, area);
  }
  return region;
}

}  // namespace

std::vector<ChangeRegion> group_changes(const std::vector<ChangedPatch>& patches,
                                        PatchChange change, double gap_m,
                                        std::size_t least_patches) {
  Sets sets = joined(patches, gap_m);
  std::map<std::size_t, std::vector<const ChangedPatch*>> groups;
  for (std::size_t i = 0; i < patches.size(); ++i) groups[sets.of(i)].push_back(&patches[i]);
  std::vector<ChangeRegion> regions;
  for (const auto& [first, members] : groups) {
    if (members.size() >= least_patches) regions.push_back(region_of(members, change));
  }
  std::ranges::stable_sort(regions, std::greater{}, &ChangeRegion::area_m2);
  return regions;
}

}  // namespace cellmap
