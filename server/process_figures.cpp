#include "server/process_figures.hpp"

#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

namespace cellmap::server {
namespace {

/// Fields of /proc/self/stat from the third on: the second, a name, may hold anything.
std::vector<std::string> stat_fields() {
  std::ifstream file("/proc/self/stat");
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  std::istringstream rest(text.substr(text.rfind(')') + 1));
  return {std::istream_iterator<std::string>(rest), {}};
}

double seconds(clockid_t clock) {
  timespec time{};
  ::clock_gettime(clock, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Without /proc/stat, which a hardened unit does not show.
double boot_unix_s() { return seconds(CLOCK_REALTIME) - seconds(CLOCK_BOOTTIME); }

}  // namespace

ProcessFigures read_process_figures() {
  ProcessFigures figures;
  const auto fields = stat_fields();
  const auto field = [&](std::size_t number) {  // as proc(5) numbers them
    return number - 3 < fields.size() ? std::strtod(fields[number - 3].c_str(), nullptr) : 0.0;
  };
  const double ticks_per_s = static_cast<double>(::sysconf(_SC_CLK_TCK));
  figures.cpu_s = (field(14) + field(15)) / ticks_per_s;
  figures.threads = field(20);
  figures.start_unix_s = boot_unix_s() + field(22) / ticks_per_s;
  figures.virtual_bytes = field(23);
  figures.resident_bytes = field(24) * static_cast<double>(::sysconf(_SC_PAGESIZE));
  std::error_code error;
  for (std::filesystem::directory_iterator entry("/proc/self/fd", error), end;
       !error && entry != end; entry.increment(error)) {
    ++figures.open_descriptors;
  }
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) == 0) {
    figures.max_descriptors = static_cast<double>(limit.rlim_cur);
  }
  return figures;
}

}  // namespace cellmap::server
