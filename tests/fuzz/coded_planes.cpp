// The streams of a coded CELL behind its hashes. Before them: the encoding and the lattice, the
// bytes of the coarse layer, and how many planes each layer is said to have.
#include <algorithm>

#include "cellmap/codec/compact_planes.hpp"
#include "cellmap/codec/packed_planes.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  if (bytes.size() < 7) return;
  const auto byte = [&](std::size_t i) { return std::to_integer<std::size_t>(bytes[i]); };
  const auto number = [&](std::size_t i) { return byte(i) | byte(i + 1) << 8; };
  const auto kind =
      byte(0) & 2 ? cellmap::LatticeKind::kFibonacciBands : cellmap::LatticeKind::kFibonacci;
  cellmap::CodingLattice lattice({kind, 1'000});
  const auto data = bytes.subspan(7);
  const std::size_t coarse = std::min(number(1), data.size());
  const cellmap::LayerView layers[] = {{data.first(coarse), number(3)},
                                       {data.subspan(coarse), number(5)}};
  if (byte(0) & 1) {
    cellmap::decode_packed_planes(lattice, layers);
  } else {
    cellmap::decode_compact_planes(
        lattice, layers, 0.02,
        byte(0) & 4 ? cellmap::CompactVersion::k1 : cellmap::CompactVersion::k2);
  }
}
