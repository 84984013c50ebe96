#pragma once

namespace cellmap::server {

/// What Linux says of this process (/proc/self); 0 for what it does not say.
struct ProcessFigures {
  double cpu_s = 0;
  double resident_bytes = 0, virtual_bytes = 0;
  double open_descriptors = 0, max_descriptors = 0;
  double threads = 0;
  double start_unix_s = 0;
};

ProcessFigures read_process_figures();

}  // namespace cellmap::server
