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
  both.indices.resize(size);
  both.planes.resize(size);
  constexpr std::uint32_t kEnd = 0xffffffff;  // beyond every lattice
  decoded.indices.push_back(kEnd);
  layer.indices.push_back(kEnd);
  const std::uint32_t *a = decoded.indices.data(), *b = layer.indices.data();
  const Plane *plane_a = decoded.planes.data(), *plane_b = layer.planes.data();
  for (std::size_t k = 0; k < size; ++k) {  // without branches: which is first cannot be foreseen
    const bool is_a = *a < *b;
    both.indices[k] = is_a ? *a : *b;
    both.planes[k] = *(is_a ? plane_a : plane_b);
    a += is_a;
    plane_a += is_a;
    b += !is_a;
    plane_b += !is_a;
  }
  decoded = std::move(both);
}

}  // namespace cellmap
