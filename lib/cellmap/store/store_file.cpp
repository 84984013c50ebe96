#include "cellmap/store/store_file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <string>
#include <system_error>
#include <utility>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

// Numbers from statfs(2) and linux/magic.h, which lacks half of them.
constexpr std::array<std::pair<std::uint32_t, std::string_view>, 13> kNetworkFileSystems = {{
    {0x00006969, "NFS"},
    {0x0000517B, "SMB"},
    {0xFF534D42, "CIFS"},
    {0xFE534D42, "SMB2"},
    {0x01021997, "9P"},
    {0x65735546, "FUSE"},
    {0x00C36400, "Ceph"},
    {0x5346414F, "AFS"},
    {0x73757245, "Coda"},
    {0x0BD00BD0, "Lustre"},
    {0x47504653, "GPFS"},
    {0x01161970, "GFS2"},
    {0x7461636F, "OCFS2"},
}};

std::filesystem::path folder_of(const std::filesystem::path& file) {
  const std::filesystem::path folder = file.parent_path();
  return folder.empty() ? "." : folder;
}

std::string system_message() { return std::system_category().message(errno); }

std::string read_owner(int descriptor) {
  char text[32] = {};
  const ssize_t count = ::pread(descriptor, text, sizeof(text) - 1, 0);
  return count > 0 ? " (process " + std::string(text, std::strcspn(text, "\n")) + ")" : "";
}

}  // namespace

std::optional<std::string_view> network_file_system(long magic) {
  for (const auto& [number, name] : kNetworkFileSystems) {
    if (number == static_cast<std::uint32_t>(magic)) return name;
  }
  return std::nullopt;
}

void require_local_file_system(const std::filesystem::path& file) {
  const std::filesystem::path folder = folder_of(file);
  struct statfs status {};
  if (::statfs(folder.c_str(), &status) != 0) {
    throw Error(ErrorCode::kIo, "store " + file.string() + ": cannot look into its folder (" +
                                    system_message() + "); create the folder first");
  }
  if (const auto name = network_file_system(static_cast<long>(status.f_type))) {
    throw Error(ErrorCode::kUnsupported,
                "store " + file.string() + " lies on a network or user-space file system (" +
                    std::string(*name) + "), where a write could be lost; keep it on a local disk");
  }
}

void require_sqlite_or_empty(const std::filesystem::path& file) {
  std::error_code error;
  const auto status = std::filesystem::status(file, error);
  if (!std::filesystem::exists(status)) return;
  if (!std::filesystem::is_regular_file(status)) {
    throw Error(ErrorCode::kIo,
                "store " + file.string() + ": expected a file, found a folder or device");
  }
  std::ifstream stream(file, std::ios::binary);
  if (!stream)
    throw Error(ErrorCode::kIo,
                "store " + file.string() + ": cannot be read; check its permissions");
  constexpr std::string_view kMagic("SQLite format 3\0", 16);
  std::array<char, 16> head{};
  stream.read(head.data(), head.size());
  if (stream.gcount() == 0) return;
  if (std::string_view(head.data(), static_cast<std::size_t>(stream.gcount())) != kMagic) {
    throw Error(ErrorCode::kCorruptData,
                "store " + file.string() +
                    ": is no CELLmap store (it does not begin as an SQLite database does); name "
                    "another file or restore this one from a backup");
  }
}

WriterLock::WriterLock(const std::filesystem::path& file) {
  const std::string name = file.string() + ".lock";
  descriptor_ = ::open(name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (descriptor_ < 0) {
    throw Error(ErrorCode::kIo, "store: cannot create " + name + " (" + system_message() +
                                    "); check the permissions of its folder");
  }
  if (::flock(descriptor_, LOCK_EX | LOCK_NB) != 0) {
    const std::string owner = read_owner(descriptor_);
    ::close(descriptor_);
    throw Error(ErrorCode::kUnavailable,
                "store " + file.string() + " is open for writing elsewhere" + owner +
                    "; stop that program, talk to its server, or open the store read-only");
  }
  const std::string owner = std::to_string(::getpid()) + "\n";
  // The number only makes the message above more helpful, so failing to write it does not matter.
  if (::ftruncate(descriptor_, 0) == 0 &&
      ::pwrite(descriptor_, owner.data(), owner.size(), 0) < 0) {
    errno = 0;
  }
}

WriterLock::~WriterLock() { ::close(descriptor_); }

}  // namespace cellmap
