#include "cellmap/client/download.hpp"

#include "cellmap/core/error.hpp"
#include "cellmap/core/progress.hpp"

namespace cellmap::client {
namespace {

constexpr std::size_t kPieceBytes = 4u << 20;
constexpr int kAttempts = 5;

void copy(ByteSource& from, ByteFile& to, const std::stop_token& stop,
          const std::function<void(std::uint64_t, std::uint64_t)>& progress) {
  from.restart();
  to.resize(0);
  // The size is known after the first read, which may make a server begin to produce the bytes.
  for (std::uint64_t done = 0;;) {
    throw_if_stopped(stop);
    const Bytes piece = from.read(done, kPieceBytes);
    to.write(done, piece);
    done += piece.size();
    const std::uint64_t size = from.size();
    if (progress) progress(done, size);
    if (done >= size || piece.empty()) return;
  }
}

}  // namespace

void download(ByteSource& from, ByteFile& to, const std::stop_token& stop,
              const std::function<void(std::uint64_t, std::uint64_t)>& progress) {
  for (int attempt = 1;; ++attempt) {
    try {
      return copy(from, to, stop, progress);
    } catch (const Error& error) {
      if (error.code() != ErrorCode::kPreconditionFailed || attempt == kAttempts) throw;
    }
  }
}

}  // namespace cellmap::client
