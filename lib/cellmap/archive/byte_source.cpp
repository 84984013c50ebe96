#include "cellmap/archive/byte_source.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

/// POSIX calls, because a file is read and written at given places and made durable.
class LocalFile : public ByteFile {
 public:
  LocalFile(int descriptor, std::string name) : descriptor_(descriptor), name_(std::move(name)) {}
  ~LocalFile() override { ::close(descriptor_); }
  LocalFile(const LocalFile&) = delete;
  LocalFile& operator=(const LocalFile&) = delete;

  Bytes read(std::uint64_t offset, std::size_t length) override {
    const std::uint64_t end = size();
    Bytes bytes(std::min<std::uint64_t>(length, end - std::min(offset, end)));
    for (std::size_t done = 0; done < bytes.size();) {
      const ssize_t n = ::pread(descriptor_, bytes.data() + done, bytes.size() - done,
                                static_cast<off_t>(offset + done));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) fail("cannot read");
      if (n == 0) {  // it became shorter
        bytes.resize(done);
        break;
      }
      done += static_cast<std::size_t>(n);
    }
    return bytes;
  }

  std::uint64_t size() override {
    struct stat status {};
    if (::fstat(descriptor_, &status) != 0) fail("cannot read the size of");
    return static_cast<std::uint64_t>(status.st_size);
  }

  std::string name() const override { return name_; }

  void write(std::uint64_t offset, std::span<const std::byte> bytes) override {
    while (!bytes.empty()) {
      const ssize_t n =
          ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) fail("cannot write");
      bytes = bytes.subspan(static_cast<std::size_t>(n));
      offset += static_cast<std::uint64_t>(n);
    }
  }

  void resize(std::uint64_t size) override {
    if (::ftruncate(descriptor_, static_cast<off_t>(size)) != 0) fail("cannot resize");
  }

  void sync() override {
    if (::fsync(descriptor_) != 0) fail("cannot write to disk");
  }

 private:
  [[noreturn]] void fail(const char* what) const {
    if (errno == ENOSPC || errno == EDQUOT || errno == EFBIG) {
      throw Error(ErrorCode::kDiskFull, "there is no room for '" + name_ + "': " +
                                            std::strerror(errno) + "; free space and repeat");
    }
    throw Error(ErrorCode::kIo, std::string(what) + " '" + name_ + "': " + std::strerror(errno));
  }

  int descriptor_;
  std::string name_;
};

class BorrowedSource : public ByteSource {
 public:
  explicit BorrowedSource(ByteSource& source) : source_(source) {}
  Bytes read(std::uint64_t offset, std::size_t length) override {
    return source_.read(offset, length);
  }
  std::uint64_t size() override { return source_.size(); }
  void restart() override { source_.restart(); }
  std::string name() const override { return source_.name(); }

 private:
  ByteSource& source_;
};

}  // namespace

std::unique_ptr<ByteSource> borrowed(ByteSource& source) {
  return std::make_unique<BorrowedSource>(source);
}

Bytes MemoryFile::read(std::uint64_t offset, std::size_t length) {
  const std::uint64_t begin = std::min<std::uint64_t>(offset, bytes_.size());
  const std::uint64_t end = begin + std::min<std::uint64_t>(length, bytes_.size() - begin);
  return Bytes(bytes_.begin() + static_cast<std::ptrdiff_t>(begin),
               bytes_.begin() + static_cast<std::ptrdiff_t>(end));
}

void MemoryFile::write(std::uint64_t offset, std::span<const std::byte> bytes) {
  if (bytes_.size() < offset + bytes.size()) bytes_.resize(offset + bytes.size());
  std::copy(bytes.begin(), bytes.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(offset));
}

std::unique_ptr<ByteFile> open_temporary_file(const std::filesystem::path& folder) {
  const auto where = folder.empty() ? std::filesystem::temp_directory_path() : folder;
  // One that never had a name is gone with the process, however that ends.
  int descriptor = ::open(where.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (descriptor < 0 && (errno == EOPNOTSUPP || errno == EISDIR || errno == ENOENT)) {
    std::string name = (where / "cellmap-XXXXXX").string();
    descriptor = ::mkostemp(name.data(), O_CLOEXEC);
    if (descriptor >= 0) ::unlink(name.c_str());
  }
  if (descriptor < 0) {
    throw Error(ErrorCode::kIo,
                "cannot make a file in '" + where.string() + "': " + std::strerror(errno));
  }
  return std::make_unique<LocalFile>(descriptor, "a temporary file");
}

std::unique_ptr<ByteFile> open_file(const std::filesystem::path& file, FileMode mode) {
  const int flags = mode == FileMode::kRead     ? O_RDONLY
                    : mode == FileMode::kUpdate ? O_RDWR
                                                : O_RDWR | O_CREAT | O_TRUNC;
  const int descriptor = ::open(file.c_str(), flags | O_CLOEXEC, 0644);
  if (descriptor < 0) {
    const bool missing = errno == ENOENT;
    throw Error(missing ? ErrorCode::kNotFound : ErrorCode::kIo,
                "cannot open '" + file.string() + "': " + std::strerror(errno));
  }
  return std::make_unique<LocalFile>(descriptor, file.string());
}

}  // namespace cellmap
