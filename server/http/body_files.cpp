#include "server/http/body_files.hpp"

#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>

namespace cellmap::server {
namespace {

/// The upper bits of a product with 2^64 / golden ratio (Knuth, TAOCP 3, 6.4): addresses have
/// nothing in their lower ones.
std::size_t slot_of(const void* address) {
  return (reinterpret_cast<std::uintptr_t>(address) * 0x9E3779B97F4A7C15u) >> 56;
}

std::shared_ptr<const Descriptor> file_of(const Bytes& bytes) {
  const int descriptor = ::memfd_create("cellmapd-body", MFD_CLOEXEC);
  if (descriptor < 0) return nullptr;
  auto file = std::make_shared<const Descriptor>(descriptor);
  const ssize_t written = ::write(descriptor, bytes.data(), bytes.size());
  return written == static_cast<ssize_t>(bytes.size()) ? file : nullptr;
}

}  // namespace

std::shared_ptr<const Descriptor> BodyFiles::find(const std::shared_ptr<const Bytes>& bytes) {
  if (bytes->size() < kLeastBytes || bytes->size() > kMostBytes) return nullptr;
  Slot& slot = slots_[slot_of(bytes.get())];
  const std::lock_guard lock(slot.mutex);
  if (slot.bytes.owner_before(bytes) || bytes.owner_before(slot.bytes)) {
    slot.bytes = bytes;
    slot.file.reset();
  } else if (!slot.file) {
    slot.file = file_of(*bytes);
  }
  return slot.file;
}

}  // namespace cellmap::server
