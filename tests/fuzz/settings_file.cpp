// The file of cellmapd's settings.
#include <sstream>

#include "fuzz/file_of.hpp"
#include "fuzz/fuzz.hpp"
#include "server/settings.hpp"

FUZZ_TARGET(bytes) {
  const cellmap::fuzz::FileOf file(bytes);
  std::ostringstream out, err;
  cellmap::server::read_settings({"--config", file.path()}, out, err);
}
