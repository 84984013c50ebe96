#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "cellmap/place/place_regions.hpp"

namespace cellmap {

/// Which of some owners a region of a map is given to: the one for which the hash of (owner, map,
/// region) is greatest (rendezvous hashing). Everybody who knows the same names says the same, in
/// whatever order they know them; an owner that joins or leaves changes the owner of its own share
/// alone. 10 ns an owner and region.
class RegionOwners {
 public:
  /// One owner or more, no two of the same name.
  RegionOwners(std::span<const std::string> owners, std::string_view map);

  std::size_t owner_of(const RegionKey& region) const;  ///< its place in the list

 private:
  std::vector<std::string> owners_;
  std::vector<std::uint64_t> seeds_;  // of each
};

}  // namespace cellmap
