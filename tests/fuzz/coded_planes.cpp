// The streams of a coded CELL behind its hashes. The first four bytes say the encoding, the lattice
// and how many planes the layers are said to have.
#include "cellmap/codec/compact_planes.hpp"
#include "cellmap/codec/packed_planes.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  if (bytes.size() < 4) return;
  const auto number = [&](std::size_t i) { return std::to_integer<std::size_t>(bytes[i]); };
  const auto kind =
      number(0) & 2 ? cellmap::LatticeKind::kFibonacciBands : cellmap::LatticeKind::kFibonacci;
  cellmap::CodingLattice lattice({kind, 1'000});
  const auto data = bytes.subspan(4);
  const std::size_t coarse = data.size() * number(1) / 255;
  const cellmap::LayerView layers[] = {{data.first(coarse), number(2)},
                                       {data.subspan(coarse), 3 * number(3)}};
  if (number(0) & 1) {
    cellmap::decode_packed_planes(lattice, layers);
  } else {
    cellmap::decode_compact_planes(
        lattice, layers, 0.02,
        number(0) & 4 ? cellmap::CompactVersion::k1 : cellmap::CompactVersion::k2);
  }
}
