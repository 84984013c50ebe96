#pragma once

#include <cstddef>
#include <optional>
#include <string>

namespace cellmap {

class Store;

/// What a store keeps beside a map that is no part of it: one text for each name, replaced as a
/// whole. Gone with its map. No part of a revision. Durability, concurrency and errors as `Store`.
class Documents {
 public:
  static constexpr std::size_t kMaxBytes = 4u << 20;

  virtual ~Documents() = default;

  /// Names are the program's own ("comparison"). Error{kNotFound} where there is no such map,
  /// {kTooLarge} above kMaxBytes.
  virtual void put_document(const std::string& map, const std::string& name,
                            const std::string& text) = 0;
  /// nullopt where none was kept; Error{kNotFound} where there is no such map.
  virtual std::optional<std::string> document(const std::string& map,
                                              const std::string& name) const = 0;
  /// One that is not there is gone already; Error{kNotFound} where there is no such map.
  virtual void remove_document(const std::string& map, const std::string& name) = 0;
};

/// The documents of a store. Throws Error{kUnsupported} for an engine that keeps none.
Documents& documents_of(Store& store);

}  // namespace cellmap
