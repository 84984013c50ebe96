#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/store/object_store_options.hpp"

namespace cellmap {

/// An object in a listing.
struct StoredObject {
  std::string name;
  std::uint64_t bytes = 0;
};

/// Bytes by name, in a bucket of an S3-compatible service, under its prefix. Thread safe; requests
/// of several threads run at the same time.
///
/// A put object is durable when `put` returns, as far as the service promises, and read by all that
/// ask from then on. Names have 1 to 200 characters of a-z, 0-9, '-', '_', '.' and '/'.
///
/// Every member throws Error: kUnavailable where nobody answers in time, for a second after
/// somebody found that, or where the service asks to come back later; kIo where it refuses the keys
/// or has no such bucket; kInternal for what no such service answers. No message holds a key.
class ObjectStore {
 public:
  virtual ~ObjectStore() = default;

  /// Puts or replaces. At most 1 GiB, else Error{kTooLarge}.
  virtual void put(const std::string& name, std::span<const std::byte> bytes) = 0;
  /// nullopt where there is none. Error{kCorruptData} where it is longer than `most`, of which no
  /// more is read, or shorter than was announced.
  virtual std::optional<Bytes> get(const std::string& name, std::size_t most) = 0;
  /// One that is not there is no error.
  virtual void remove(const std::string& name) = 0;
  /// In order of names.
  virtual void list(const std::function<void(const StoredObject&)>& each) = 0;
};

/// Asks for nothing yet. Throws as `ObjectStoreOptions::validate`.
std::unique_ptr<ObjectStore> open_object_store(const ObjectStoreOptions& options);

}  // namespace cellmap
