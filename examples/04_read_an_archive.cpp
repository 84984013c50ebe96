// A map in a file: what is in it, and one CELL of it. Usage: 04_read_an_archive FILE.cellmap
#include <cellmap/archive/archive_reader.hpp>
#include <cellmap/core/error.hpp>
#include <iostream>

int main(int argc, char** argv) try {
  if (argc != 2) throw cellmap::Error(cellmap::ErrorCode::kInvalidArgument, "expected one archive");
  cellmap::ArchiveReader archive(cellmap::open_file(argv[1], cellmap::FileMode::kRead));
  const auto& about = archive.footer();
  std::cout << about.map << " at revision " << about.revision << ": " << about.cells << " CELLs, "
            << about.planes << " planes, off by at most " << about.bound_m << " m\n";
  const auto& [id, T_map_cell] = *archive.pose_graph().nodes.begin();
  const cellmap::ArchiveCell found = archive.cell(id);
  std::cout << "CELL " << id.value << " has " << found.cell.planes.size() << " planes and lies at "
            << T_map_cell.translation().transpose() << '\n';
} catch (const cellmap::Error& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
