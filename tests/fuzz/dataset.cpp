// The text files of a recorded drive, with a zero byte after each: times, calibration, poses.
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "cellmap/scan/scan_source.hpp"
#include "fuzz/fuzz.hpp"

namespace {

/// A folder of this process in memory, where there is one.
class Folder {
 public:
  Folder()
      : path_(std::filesystem::path(std::filesystem::exists("/dev/shm") ? "/dev/shm" : "/tmp") /
              ("cellmap-fuzz-" + std::to_string(getpid()))) {
    std::filesystem::create_directories(path_ / "velodyne");
    for (const char* name : {"velodyne/000000.bin", "velodyne/000001.bin"}) {
      write(name, std::string(16, '\0'));
    }
  }
  ~Folder() { std::filesystem::remove_all(path_); }

  void write(const std::string& name, std::string_view text) const {
    std::ofstream(path_ / name, std::ios::binary) << text;
  }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace

FUZZ_TARGET(bytes) {
  std::string_view text = cellmap::fuzz::text_of(bytes);
  const Folder folder;
  for (const char* name : {"times.txt", "calib.txt", "poses.txt"}) {
    const auto end = std::min(text.find('\0'), text.size());
    if (end > 0) folder.write(name, text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  const auto drive = cellmap::open_dataset(folder.path());
  while (drive->next()) {
  }
}
