#include "cellmap/client/folder_lock.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include "cellmap/core/error.hpp"

namespace cellmap::client {

FolderLock::FolderLock(const std::filesystem::path& folder) {
  const std::string name = (folder / "lock").string();
  descriptor_ = ::open(name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (descriptor_ < 0) {
    throw Error(ErrorCode::kIo, "cannot make '" + name + "'; check that the folder can be written");
  }
  if (::flock(descriptor_, LOCK_EX | LOCK_NB) != 0) {
    ::close(descriptor_);
    throw Error(ErrorCode::kConflict, "another process keeps '" + folder.string() +
                                          "' up to date; stop it or give another folder");
  }
}

FolderLock::~FolderLock() { ::close(descriptor_); }

}  // namespace cellmap::client
