#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "cellmap/core/error.hpp"

namespace cellmap::fuzz {

/// Runs a decoder on untrusted bytes: it may refuse them with an Error; anything else that it
/// throws or does is a finding.
template <typename Decode>
void accept_or_refuse(const Decode& decode) {
  try {
    decode();
  } catch (const Error&) {
  }
}

inline std::span<const std::byte> bytes_of(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const std::byte*>(data), size};
}

}  // namespace cellmap::fuzz

/// The body of a target, on `bytes`: FUZZ_TARGET(bytes) { ... }
#define FUZZ_TARGET(bytes)                                                                \
  static void fuzz_target(std::span<const std::byte> bytes);                              \
  extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* d, std::size_t n) {           \
    cellmap::fuzz::accept_or_refuse([&] { fuzz_target(cellmap::fuzz::bytes_of(d, n)); }); \
    return 0;                                                                             \
  }                                                                                       \
  static void fuzz_target(std::span<const std::byte> bytes)
