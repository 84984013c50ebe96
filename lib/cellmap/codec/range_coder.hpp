#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "cellmap/codec/cell_codec.hpp"

namespace cellmap {

/// How likely a bit is 1, learnt from the bits before it: the mean of a fast and a slow average,
/// so that it finds its level soon and then keeps still. Both in units of 2^-16.
class BitModel {
 public:
  constexpr BitModel() = default;
  /// Begins at `probability` / 256 that the bit is 1, 1 to 255.
  explicit constexpr BitModel(std::uint8_t probability) : averages_(probability * 0x01000100u) {}

  /// In units of 2^-15, 35 to 32732: no bit is ever certain.
  std::uint32_t probability() const { return ((averages_ >> 16) + (averages_ & 0xffff)) >> 2; }

  /// A 1 takes both averages nearer to 65,535, by a 16th and a 128th of what is left, a 0 nearer to
  /// 0: the same of the complement.
  void learn(bool bit) { bit ? learn_1() : learn_0(); }
  void learn_1() { averages_ = ~fallen(~averages_); }
  void learn_0() { averages_ = fallen(averages_); }

 private:
  static constexpr std::uint32_t fallen(std::uint32_t averages) {
    return averages - ((averages >> 4 & 0x0fff0000) | (averages >> 7 & 0x000001ff));
  }

  std::uint32_t averages_ = 0x80008000;  ///< the fast one in the upper half
};

/// Writes bits in as much room as their models leave (FORMAT.md, "Range coding"). What is written
/// and what is read are one function template over `Coder`: an encoder's `bit`, `plain_bit` and
/// `bits` take the value and return it, a decoder's return what was read.
class RangeEncoder {
 public:
  bool bit(BitModel& model, bool value) {
    const std::uint32_t bound = (range_ >> 15) * model.probability();
    if (value) {
      range_ = bound;
    } else {
      low_ += bound;
      range_ -= bound;
    }
    model.learn(value);
    if (range_ < kMinRange) shift();
    return value;
  }

  /// `count` bits, 0 to 32, that nothing is known of.
  std::uint32_t bits(int count, std::uint32_t value);
  bool plain_bit(bool value) { return bits(1, value) != 0; }

  Bytes finish() &&;

 private:
  static constexpr std::uint32_t kMinRange = 1u << 24;

  void shift();
  void settle_carry();

  Bytes bytes_;
  std::uint64_t low_ = 0;
  std::uint32_t range_ = 0xffffffff;
};

constexpr int kBitsAtOnce = 16;  ///< that nothing is known of; a range has at least 24

/// Reads any bytes without fault: beyond their end it reads zeros, which `check` reports.
class RangeDecoder {
 public:
  /// `bytes` must outlive the decoder.
  explicit RangeDecoder(std::span<const std::byte> bytes);

  [[gnu::always_inline]] bool bit(BitModel& model, bool = false) {
    const std::uint32_t bound = (range_ >> 15) * model.probability();
    if (code_ < bound) {
      range_ = bound;
      model.learn_1();
      fill();
      return true;
    }
    code_ -= bound;
    range_ -= bound;
    model.learn_0();
    fill();
    return false;
  }

  [[gnu::always_inline]] std::uint32_t bits(int count, std::uint32_t = 0) {
    std::uint32_t value = 0;
    for (int left = count; left > 0;) {
      const int part = left < kBitsAtOnce ? left : kBitsAtOnce;
      left -= part;
      range_ >>= part;
      // No encoder leaves more than that; whoever does reads large numbers.
      const std::uint32_t most = (std::uint32_t{1} << part) - 1, quotient = code_ / range_;
      const std::uint32_t read = quotient < most ? quotient : most;
      code_ -= read * range_;
      value = value << part | read;
      fill();
    }
    return value;
  }
  /// The same as one of `bits`, without a division.
  bool plain_bit(bool = false) {
    range_ >>= 1;
    const bool value = code_ >= range_;
    code_ -= value ? range_ : 0;
    fill();
    return value;
  }

  /// Throws Error{kCorruptData} where more was read than there is: ask now and then, so that a
  /// short input cannot keep a decoder busy.
  void check() const;

  /// Throws Error{kCorruptData} unless all bytes were read.
  void finish() const;

 private:
  static constexpr std::uint32_t kMinRange = 1u << 24;

  void fill() {
    while (range_ < kMinRange) [[unlikely]] {
        shift();
      }
  }
  void shift() {
    std::uint32_t next = 0;
    if (next_ != end_) {
      next = std::to_integer<std::uint32_t>(*next_++);
    } else {
      ++missing_;
    }
    code_ = code_ << 8 | next;
    range_ <<= 8;
  }

  const std::byte *next_, *end_;
  std::size_t missing_ = 0;  ///< bytes that were read beyond the end
  std::uint32_t code_ = 0;
  std::uint32_t range_ = 0xffffffff;
};

/// Models of an integer that is most often small: zero or not, the sign as it comes, the number of
/// binary digits in unary, the second digit; the other digits as they come.
struct IntegerModel {
  static constexpr int kDigits = 10;  ///< integers of more digits share models
  BitModel is_zero;
  BitModel more_digits[kDigits];
  BitModel second_digit[kDigits];
};

/// An integer and whether it is 0, +-1 or larger (2): what the next one is coded by. Known by the
/// way that its bits took, so that the processor need not wait for the integer itself.
struct CodedInteger {
  std::int64_t value = 0;
  int size = 0;
};

/// `value` of at most `max_digits` binary digits, at most 32, beside its sign. Returns it.
template <typename Coder>
[[gnu::always_inline]] inline CodedInteger code_integer(Coder& coder, IntegerModel& model,
                                                        int max_digits, std::int64_t value = 0) {
  if (coder.bit(model.is_zero, value == 0)) return {};
  const bool is_negative = coder.plain_bit(value < 0);
  const auto magnitude = static_cast<std::uint64_t>(value < 0 ? -value : value);
  const auto slot = [](int digits) {
    return digits < IntegerModel::kDigits ? digits : IntegerModel::kDigits - 1;
  };
  int rest = 0;  // digits after the first
  while (rest + 1 < max_digits && coder.bit(model.more_digits[slot(rest)], magnitude >> rest > 1)) {
    ++rest;
  }
  std::uint64_t read = 1;
  if (rest > 0) {
    read =
        2 | std::uint64_t{coder.bit(model.second_digit[slot(rest)], magnitude >> (rest - 1) & 1)};
  }
  if (rest > 1) {
    const std::uint32_t mask = (std::uint32_t{1} << (rest - 1)) - 1;
    read = read << (rest - 1) | coder.bits(rest - 1, static_cast<std::uint32_t>(magnitude) & mask);
  }
  const auto result = static_cast<std::int64_t>(read);
  return {is_negative ? -result : result, rest > 0 ? 2 : 1};
}

}  // namespace cellmap
