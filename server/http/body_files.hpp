#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <mutex>

#include "cellmap/codec/cell_codec.hpp"
#include "server/http/descriptor.hpp"

namespace cellmap::server {

/// Bodies that are sent again and again, as files in memory: of a file the kernel sends the pages
/// as they are, and anything else it copies, which costs a sixth of the fetches of 30 kB over many
/// connections (ARCHITECTURE.md, "The HTTP front"). A body becomes a file when it is sent for the
/// second time; one of 256 may push another one out. Thread safe; O(1).
class BodyFiles {
 public:
  static constexpr std::size_t kLeastBytes = 16u << 10;  ///< below, copying is as cheap
  static constexpr std::size_t kMostBytes = 256u << 10;  ///< so all together are 64 MiB at most

  /// A file with just these bytes, which may be sent while it is held; null where there is none
  /// (yet), or the system has none to give.
  std::shared_ptr<const Descriptor> find(const std::shared_ptr<const Bytes>& bytes);

 private:
  struct Slot {
    std::mutex mutex;
    std::weak_ptr<const Bytes> bytes;  ///< known by its owner, so never taken for later ones
    std::shared_ptr<const Descriptor> file;
  };

  std::array<Slot, 256> slots_;
};

}  // namespace cellmap::server
