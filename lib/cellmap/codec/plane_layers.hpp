#pragma once

#include <algorithm>
#include <array>
#include <span>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/codec/index_coding.hpp"
#include "cellmap/codec/plane_prediction.hpp"

namespace cellmap {

/// Index and planes of one layer of a CELL as bytes.
struct CodedLayer {
  Bytes bytes;
  std::size_t planes = 0;
};
using CodedLayers = std::array<CodedLayer, kPlaneLayers>;

/// The same as it is read.
struct LayerView {
  std::span<const std::byte> bytes;
  std::size_t planes = 0;
};

/// Calls `use(k, sphere, point of it)` for each of the lattice points, which ascend.
template <typename Use>
void visit_points(const CodingLattice& lattice, std::span<const std::uint32_t> indices,
                  const Use& use) {
  std::size_t sphere = 0;
  for (std::size_t k = 0; k < indices.size(); ++k) {
    while (indices[k] >= lattice.spheres[sphere].first + lattice.spheres[sphere].count) ++sphere;
    use(k, sphere, lattice.spheres[sphere].point(indices[k] - lattice.spheres[sphere].first));
  }
}

/// The first `layers` of the lattice's memory as one, so that lattice indices ascend.
DecodedPlanes merged_layers(CodingLattice& lattice, std::size_t layers);

}  // namespace cellmap
