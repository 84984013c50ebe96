#include "cellmap/pose_graph/components.hpp"

#include <algorithm>
#include <numeric>

namespace cellmap {

Components::Components(std::size_t nodes) : lowest_(nodes) {
  std::iota(lowest_.begin(), lowest_.end(), std::size_t{0});
}

std::size_t Components::lowest(std::size_t node) {
  for (; lowest_[node] != node; node = lowest_[node]) lowest_[node] = lowest_[lowest_[node]];
  return node;
}

bool Components::join(std::size_t a, std::size_t b) {
  a = lowest(a);
  b = lowest(b);
  lowest_[std::max(a, b)] = std::min(a, b);
  return a != b;
}

}  // namespace cellmap
