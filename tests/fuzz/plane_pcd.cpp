// A PCD of the released code's folder.
#include "cellmap/codec/plane_pcd.hpp"

#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  const auto file = std::filesystem::temp_directory_path() /
                    ("cellmap-fuzz-" + std::to_string(getpid()) + ".pcd");
  std::ofstream(file, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
  cellmap::read_plane_pcd(file, 1'000);
}
