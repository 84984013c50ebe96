// Where was this scan taken, and what is around? Usage: 05_ask_a_server URL MAP SCAN.bin
#include <cellmap/client/client.hpp>
#include <cellmap/core/error.hpp>
#include <cellmap/scan/scan_source.hpp>
#include <iostream>

int main(int argc, char** argv) try {
  if (argc != 4)
    throw cellmap::Error(cellmap::ErrorCode::kInvalidArgument, "expected URL MAP SCAN");
  cellmap::ClientOptions options;
  options.url = argv[1];
  cellmap::Client client(options);

  const auto answer = client.relocalise(argv[2], cellmap::read_kitti_bin(argv[3]));
  if (!answer.answer.found) {
    std::cout << "not found among " << answer.answer.cells_considered << " CELLs\n";
    return 2;
  }
  const auto& here = *answer.answer.found;
  std::cout << "at " << here.T_map_scan.translation().transpose() << ", confidence "
            << here.confidence << ", " << answer.time_ms << " ms\n";

  cellmap::CellQuery around;
  around.near = here.T_map_scan.translation();
  around.radius_m = 20;
  for (const auto& record : client.cells(argv[2], around).cells) {
    const auto fetched = client.cell(argv[2], record.id);  // verified against its hash
    std::cout << "CELL " << record.id.value << ": " << fetched.encoded.bytes.size() << " bytes\n";
  }
} catch (const cellmap::Error& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
