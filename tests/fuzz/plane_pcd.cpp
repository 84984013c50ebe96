// A PCD of the released code's folder.
#include "cellmap/codec/plane_pcd.hpp"

#include "fuzz/file_of.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) { cellmap::read_plane_pcd(cellmap::fuzz::FileOf(bytes).path(), 1'000); }
