#include "cellmap/place/region_owners.hpp"

#include <cassert>

#include "cellmap/core/checksum.hpp"

namespace cellmap {
namespace {

/// The last step of SplitMix64: every bit of the input changes half of those of the output.
std::uint64_t mixed(std::uint64_t x) {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

std::uint64_t bits_of(const RegionKey& region) {
  return std::uint64_t{static_cast<std::uint32_t>(region.x)} << 32 |
         static_cast<std::uint32_t>(region.y);
}

}  // namespace

RegionOwners::RegionOwners(std::span<const std::string> owners, std::string_view map)
    : owners_(owners.begin(), owners.end()) {
  assert(!owners_.empty());
  for (const std::string& owner : owners_) {
    const std::string name = owner + '\n' + std::string(map);
    seeds_.push_back(checksum(std::as_bytes(std::span(name))));
  }
}

std::size_t RegionOwners::owner_of(const RegionKey& region) const {
  std::size_t best = 0;
  std::uint64_t highest = 0;
  for (std::size_t i = 0; i < seeds_.size(); ++i) {
    const std::uint64_t weight = mixed(seeds_[i] ^ mixed(bits_of(region)));
    const bool ties = i > 0 && weight == highest;
    if (i == 0 || weight > highest || (ties && owners_[i] < owners_[best])) {
      best = i;
      highest = weight;
    }
  }
  return best;
}

}  // namespace cellmap
