#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>

#include "cellmap/codec/cell_codec.hpp"

namespace cellmap {

/// Bytes that are read in pieces: a file here, a file behind HTTP, memory. Not thread safe.
class ByteSource {
 public:
  virtual ~ByteSource() = default;

  /// `length` bytes from `offset`, fewer only at the end. Throws Error{kIo} where they cannot be
  /// had; Error{kPreconditionFailed} where the bytes have been replaced since the first read
  /// (`restart`, then read all anew).
  virtual Bytes read(std::uint64_t offset, std::size_t length) = 0;
  /// Of everything; known at the latest after the first read.
  virtual std::uint64_t size() = 0;
  /// Forgets what was read: the next read may find other bytes.
  virtual void restart() {}
  /// For messages.
  virtual std::string name() const = 0;
};

/// Reads what another owns, which outlives it.
std::unique_ptr<ByteSource> borrowed(ByteSource& source);

/// Bytes that are written in pieces. What is written is in no safe order before `sync`.
class ByteFile : public ByteSource {
 public:
  /// Throws Error{kIo}, as the next two; {kDiskFull} where there is no room.
  virtual void write(std::uint64_t offset, std::span<const std::byte> bytes) = 0;
  virtual void resize(std::uint64_t size) = 0;
  /// Everything written so far is durable, as far as the disk keeps its word.
  virtual void sync() = 0;
};

class MemoryFile : public ByteFile {
 public:
  explicit MemoryFile(Bytes bytes = {}) : bytes_(std::move(bytes)) {}
  const Bytes& bytes() const { return bytes_; }

  Bytes read(std::uint64_t offset, std::size_t length) override;
  std::uint64_t size() override { return bytes_.size(); }
  std::string name() const override { return "memory"; }
  void write(std::uint64_t offset, std::span<const std::byte> bytes) override;
  void resize(std::uint64_t size) override { bytes_.resize(size); }
  void sync() override {}

 private:
  Bytes bytes_;
};

enum class FileMode { kRead, kUpdate, kCreate };

/// A file of this machine, which several threads may read at once. kCreate replaces one that is
/// there. Throws Error{kNotFound} where there is none, Error{kIo}.
std::unique_ptr<ByteFile> open_file(const std::filesystem::path& file, FileMode mode);

/// A file without a name, gone with the object; in `folder` (empty: the system's for such files).
/// Throws Error{kIo}.
std::unique_ptr<ByteFile> open_temporary_file(const std::filesystem::path& folder = {});

}  // namespace cellmap
