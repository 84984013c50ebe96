#pragma once

#include <cstddef>
#include <vector>

namespace cellmap {

/// The lowest node of the component of each node (union-find with path halving).
class Components {
 public:
  explicit Components(std::size_t nodes);

  std::size_t lowest(std::size_t node);
  /// False where the two were joined already.
  bool join(std::size_t a, std::size_t b);

 private:
  std::vector<std::size_t> lowest_;
};

}  // namespace cellmap
