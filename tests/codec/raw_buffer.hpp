#pragma once

#include <cstring>
#include <optional>
#include <string>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {

/// Reads and breaks FlatBuffers by hand, straight from the description of their layout, so that
/// tests do not lean on the code they test.
class RawBuffer {
 public:
  explicit RawBuffer(Bytes& bytes) : bytes_(bytes) {}

  template <typename T>
  T get(std::size_t at) const {
    T value;
    std::memcpy(&value, bytes_.data() + at, sizeof(T));
    return value;
  }
  template <typename T>
  void set(std::size_t at, T value) {
    std::memcpy(bytes_.data() + at, &value, sizeof(T));
  }

  std::size_t root() const { return get<std::uint32_t>(0); }
  /// Where a table's entry for a field is in its vtable.
  std::size_t vtable_entry(std::size_t table, int id) const {
    return table - static_cast<std::size_t>(get<std::int32_t>(table)) + 4 + 2 * id;
  }
  /// Where an inline field of a table is. The field must be present.
  std::size_t field(std::size_t table, int id) const {
    return table + get<std::uint16_t>(vtable_entry(table, id));
  }
  /// Where a table, vector (at its length) or string that a field points to is.
  std::size_t target(std::size_t table, int id) const {
    const std::size_t at = field(table, id);
    return at + get<std::uint32_t>(at);
  }
  /// As if the producer had left the field out.
  void drop_field(std::size_t table, int id) { set<std::uint16_t>(vtable_entry(table, id), 0); }

 private:
  Bytes& bytes_;
};

/// The code that `action` throws and its message, or nullopt where it throws nothing.
struct Thrown {
  ErrorCode code;
  std::string message;
};
template <typename Action>
std::optional<Thrown> thrown_by(Action&& action) {
  try {
    action();
  } catch (const Error& error) {
    return Thrown{error.code(), error.what()};
  }
  return std::nullopt;
}

}  // namespace cellmap
