// What is checked of a PCD or PLY before PCL sees it; the first byte says which.
#include "cellmap/pcl/cloud_header.hpp"
#include "fuzz/file_of.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  const int kind = cellmap::fuzz::take_kind(bytes, 2);
  const cellmap::fuzz::FileOf file(bytes);
  kind == 0 ? cellmap::pcl_io::check_pcd(file.path()) : cellmap::pcl_io::check_ply(file.path());
}
