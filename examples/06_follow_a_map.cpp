// Keeps the poses of a map up to date over a thin link. Usage: 06_follow_a_map URL MAP [UPDATES]
#include <cellmap/client/client.hpp>
#include <cellmap/core/error.hpp>
#include <chrono>
#include <iostream>
#include <map>
#include <string>

int main(int argc, char** argv) try {
  if (argc < 3) throw cellmap::Error(cellmap::ErrorCode::kInvalidArgument, "expected URL MAP");
  cellmap::ClientOptions options;
  options.url = argv[1];
  cellmap::Client client(options);
  std::map<cellmap::CellId, cellmap::Pose> poses;
  cellmap::Revision known = 0;
  for (int left = argc > 3 ? std::stoi(argv[3]) : 1'000'000; left > 0; --left) {
    // Held back by the server until there is something new; only poses travel when a loop is
    // closed.
    const auto news = client.changes(argv[2], known, std::chrono::seconds(20));
    for (const auto id : news.removed) poses.erase(id);
    for (const auto& cell : news.added) poses[cell.id] = cell.T_map_cell;
    for (const auto& [id, T_map_cell] : news.moved) poses[id] = T_map_cell;
    known = news.revision;
    std::cout << "revision " << known << ": " << news.added.size() << " CELLs are new, "
              << news.moved.size() << " moved; " << poses.size() << " in all, "
              << client.traffic().received_bytes << " bytes so far" << std::endl;
  }
} catch (const cellmap::Error& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
