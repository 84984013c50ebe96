#include "cellmap/client/files.hpp"

#include <unistd.h>

#include <fstream>
#include <random>
#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap::client {
namespace fs = std::filesystem;
namespace {

/// A name beside `file` that no other process or thread writes to.
fs::path temporary_beside(const fs::path& file) {
  std::random_device random;
  fs::path temporary = file;
  temporary += ".tmp" + std::to_string(::getpid()) + "-" + std::to_string(random());
  return temporary;
}

}  // namespace

std::span<const std::byte> as_bytes(std::string_view text) {
  return {reinterpret_cast<const std::byte*>(text.data()), text.size()};
}

std::string_view as_text(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

void make_directory(const fs::path& directory) {
  std::error_code error;
  fs::create_directories(directory, error);
  if (error) {
    throw Error(ErrorCode::kIo,
                "cannot make the folder '" + directory.string() + "': " + error.message());
  }
}

void write_file_atomically(const fs::path& file, std::span<const std::byte> bytes) {
  const fs::path temporary = temporary_beside(file);
  std::ofstream stream(temporary, std::ios::binary);
  stream.write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
  stream.close();
  std::error_code error;
  if (stream) fs::rename(temporary, file, error);
  if (!stream || error) {
    std::error_code ignored;
    fs::remove(temporary, ignored);
    throw Error(ErrorCode::kIo, "cannot write '" + file.string() +
                                    "'; check that the folder exists and the disk has space");
  }
}

void write_file_atomically(const fs::path& file, std::string_view text) {
  write_file_atomically(file, as_bytes(text));
}

std::optional<Bytes> read_file(const fs::path& file, std::uint64_t max_bytes) {
  std::error_code error;
  const std::uint64_t size = fs::file_size(file, error);
  if (error == std::errc::no_such_file_or_directory) return std::nullopt;
  if (!error && size > max_bytes) {
    throw Error(ErrorCode::kTooLarge, "'" + file.string() + "' has " + std::to_string(size) +
                                          " bytes; at most " + std::to_string(max_bytes) +
                                          " were expected");
  }
  std::ifstream stream(file, std::ios::binary);
  Bytes bytes(error ? 0 : size);
  stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  if (error || !stream) throw Error(ErrorCode::kIo, "cannot read '" + file.string() + "'");
  return bytes;
}

}  // namespace cellmap::client
