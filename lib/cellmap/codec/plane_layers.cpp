#include "cellmap/codec/plane_layers.hpp"

#include <utility>

namespace cellmap {

void merge_layer(DecodedPlanes& decoded, DecodedPlanes layer) {
  if (decoded.indices.empty()) {
    decoded = std::move(layer);
    return;
  }
  DecodedPlanes both;
  const std::size_t size = decoded.indices.size() + layer.indices.size();
  both.indices.reserve(size);
  both.planes.reserve(size);
  for (std::size_t a = 0, b = 0; both.indices.size() < size;) {
    const bool is_first = b == layer.indices.size() ||
                          (a < decoded.indices.size() && decoded.indices[a] < layer.indices[b]);
    const DecodedPlanes& from = is_first ? decoded : layer;
    std::size_t& at = is_first ? a : b;
    both.indices.push_back(from.indices[at]);
    both.planes.push_back(from.planes[at++]);
  }
  decoded = std::move(both);
}

}  // namespace cellmap
