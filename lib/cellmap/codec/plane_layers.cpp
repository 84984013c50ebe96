#include "cellmap/codec/plane_layers.hpp"

namespace cellmap {

DecodedPlanes merged_layers(CodingLattice& lattice, std::size_t layers) {
  auto& [coarse, fine] = lattice.memory.layers;
  if (layers == 1) return coarse;
  DecodedPlanes both;
  const std::size_t size = coarse.indices.size() + fine.indices.size();
  both.indices.resize(size);
  both.planes.resize(size);
  constexpr std::uint32_t kEnd = 0xffffffff;  // beyond every lattice
  coarse.indices.push_back(kEnd);
  fine.indices.push_back(kEnd);
  const std::uint32_t *a = coarse.indices.data(), *b = fine.indices.data();
  const Plane *plane_a = coarse.planes.data(), *plane_b = fine.planes.data();
  for (std::size_t k = 0; k < size; ++k) {  // without branches: which is first cannot be foreseen
    const bool is_a = *a < *b;
    both.indices[k] = is_a ? *a : *b;
    both.planes[k] = *(is_a ? plane_a : plane_b);
    a += is_a;
    plane_a += is_a;
    b += !is_a;
    plane_b += !is_a;
  }
  return both;
}

}  // namespace cellmap
