// A whole archive: read, then repaired. Checksums hold most changes off; archive_parts has none.
#include "cellmap/archive/archive_reader.hpp"
#include "cellmap/archive/repair_archive.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  using namespace cellmap;
  const Bytes copy(bytes.begin(), bytes.end());
  fuzz::accept_or_refuse([&] {
    ArchiveReader reader(std::make_unique<MemoryFile>(copy));
    reader.pose_graph();
    reader.scans();
    std::vector<CellId> ids;
    for (const ArchivedCell& cell : reader.cells()) ids.push_back(cell.id);
    reader.for_each_cell(ids, [](const ArchiveCell& cell) { validate(cell.cell); });
  });
  MemoryFile damaged(copy), repaired;
  repair_archive(damaged, repaired);
}
