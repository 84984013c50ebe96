#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

#include "cellmap/core/error.hpp"

namespace cellmap::fuzz {

/// Runs a decoder on untrusted bytes: it may refuse them with an Error; anything else that it
/// throws or does is a finding, and so is an Error that blames this program. False: refused.
template <typename Decode>
bool accept_or_refuse(const Decode& decode) {
  try {
    decode();
    return true;
  } catch (const Error& error) {
    if (error.code() == ErrorCode::kInternal) throw std::logic_error(error.what());
    return false;
  }
}

/// What was read can be written and is then read again: a refusal is a finding.
template <typename Work>
void must_work(const Work& work) {
  try {
    work();
  } catch (const Error& error) {
    throw std::logic_error("what was accepted is refused: " + std::string(error.what()));
  }
}

inline std::span<const std::byte> bytes_of(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const std::byte*>(data), size};
}

inline std::string_view text_of(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// The first byte, which says what the rest is: 0 to `kinds` - 1. Takes it off; 0 without bytes.
inline int take_kind(std::span<const std::byte>& bytes, int kinds) {
  if (bytes.empty()) return 0;
  const int kind = std::to_integer<int>(bytes[0]) % kinds;
  bytes = bytes.subspan(1);
  return kind;
}

}  // namespace cellmap::fuzz

/// What a target returns where it refuses: libFuzzer wants 0, the replay wants to know.
#ifndef FUZZ_REFUSED
#define FUZZ_REFUSED 0
#endif

/// The body of a target, on `bytes`: FUZZ_TARGET(bytes) { ... }
#define FUZZ_TARGET(bytes)                                                      \
  static void fuzz_target(std::span<const std::byte> bytes);                    \
  extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* d, std::size_t n) { \
    const auto input = cellmap::fuzz::bytes_of(d, n);                           \
    const auto run = [&] { fuzz_target(input); };                               \
    return cellmap::fuzz::accept_or_refuse(run) ? 0 : FUZZ_REFUSED;             \
  }                                                                             \
  static void fuzz_target(std::span<const std::byte> bytes)
