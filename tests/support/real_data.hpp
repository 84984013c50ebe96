#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace cellmap::test {

/// Where the real recordings live: the environment variable CELLMAP_DATA, else ../shared/data
/// beside the project. They are never part of the project; a test that needs them skips without
/// them:
///   const auto folder = real_data("kitti00-dense");
///   if (!exists(folder)) GTEST_SKIP() << "no " << folder;
inline std::filesystem::path real_data(const std::string& name) {
  const char* root = std::getenv("CELLMAP_DATA");
  return std::filesystem::path(root != nullptr ? root : CELLMAP_SOURCE_DIR "/../shared/data") /
         name;
}

}  // namespace cellmap::test
