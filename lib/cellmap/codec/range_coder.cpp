#include "cellmap/codec/range_coder.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr int kTail = 4;  // bytes of a range

std::uint32_t low_bits(std::uint32_t value, int count) {
  return value & ((std::uint32_t{1} << count) - 1);
}

}  // namespace

void RangeEncoder::settle_carry() {
  if (low_ >> 32 == 0) return;
  low_ &= 0xffffffff;
  auto at = bytes_.end();
  do {
    --at;
    *at = static_cast<std::byte>(std::to_integer<unsigned>(*at) + 1);
  } while (*at == std::byte{0});
}

void RangeEncoder::shift() {
  settle_carry();
  while (range_ < kMinRange) {
    bytes_.push_back(static_cast<std::byte>(low_ >> 24));
    low_ = low_ << 8 & 0xffffffff;
    range_ <<= 8;
  }
}

std::uint32_t RangeEncoder::bits(int count, std::uint32_t value) {
  for (int left = count; left > 0;) {
    const int part = std::min(left, kBitsAtOnce);
    left -= part;
    range_ >>= part;
    low_ += std::uint64_t{range_} * low_bits(value >> left, part);
    if (range_ < kMinRange) shift();
  }
  return value;
}

Bytes RangeEncoder::finish() && {
  settle_carry();
  for (int i = 0; i < kTail; ++i) {
    bytes_.push_back(static_cast<std::byte>(low_ >> 24));
    low_ = low_ << 8 & 0xffffffff;
  }
  return std::move(bytes_);
}

RangeDecoder::RangeDecoder(std::span<const std::byte> bytes)
    : next_(bytes.data()), end_(bytes.data() + bytes.size()) {
  for (int i = 0; i < kTail; ++i) shift();
  range_ = 0xffffffff;
}

void RangeDecoder::check() const {
  if (missing_ == 0) return;
  throw Error(ErrorCode::kCorruptData, "the coded planes end early: " + std::to_string(missing_) +
                                           " bytes more were read than there are");
}

void RangeDecoder::finish() const {
  check();
  if (next_ == end_) return;
  throw Error(ErrorCode::kCorruptData, "the coded planes end before the last " +
                                           std::to_string(end_ - next_) + " of their bytes");
}

}  // namespace cellmap
