#include "cellmap/codec/byte_planes.hpp"

#include <bit>
#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kMaxWidth = 8;

/// The straight line through the two values before row `i`.
std::uint64_t predicted(std::span<const std::int64_t> values, std::size_t i) {
  if (i == 0) return 0;
  const auto last = static_cast<std::uint64_t>(values[i - 1]);
  if (i == 1) return last;
  return 2 * last - static_cast<std::uint64_t>(values[i - 2]);
}

/// 0, -1, 1, -2, ... become 0, 1, 2, 3, ...
std::uint64_t fold_sign(std::uint64_t value) { return (value << 1) ^ (0 - (value >> 63)); }
std::uint64_t unfold_sign(std::uint64_t value) { return (value >> 1) ^ (0 - (value & 1)); }

}  // namespace

Bytes encode_column(std::span<const std::int64_t> values) {
  std::vector<std::uint64_t> folded(values.size());
  std::uint64_t all = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    folded[i] = fold_sign(static_cast<std::uint64_t>(values[i]) - predicted(values, i));
    all |= folded[i];
  }
  const std::size_t width = (static_cast<std::size_t>(std::bit_width(all)) + 7) / 8;
  Bytes bytes;
  bytes.reserve(width * values.size());
  for (std::size_t plane = 0; plane < width; ++plane) {
    for (const std::uint64_t value : folded) {
      bytes.push_back(static_cast<std::byte>(value >> (8 * plane)));
    }
  }
  return bytes;
}

std::vector<std::int64_t> decode_column(std::span<const std::byte> bytes, std::size_t count,
                                        const char* name) {
  if (bytes.size() % count != 0 || bytes.size() / count > kMaxWidth) {
    throw Error(ErrorCode::kCorruptData, std::string("the column '") + name + "' of " +
                                             std::to_string(count) +
                                             " rows has 0 to 8 bytes a row, but " +
                                             std::to_string(bytes.size()) + " bytes in all");
  }
  std::vector<std::int64_t> values(count);
  for (std::size_t i = 0; i < count; ++i) {
    std::uint64_t folded = 0;
    for (std::size_t at = i, shift = 0; at < bytes.size(); at += count, shift += 8) {
      folded |= std::to_integer<std::uint64_t>(bytes[at]) << shift;
    }
    values[i] = static_cast<std::int64_t>(unfold_sign(folded) + predicted(values, i));
  }
  return values;
}

}  // namespace cellmap
