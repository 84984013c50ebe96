#pragma once

#include <cstdint>
#include <span>

namespace cellmap {

/// Of each model of compact planes, in units of 1/256, that its first bit is 1 (FORMAT.md, "First
/// probabilities"). Made from simulated CELLs (tests/codec/train_first_probabilities.cpp).
std::span<const std::uint8_t> first_probabilities_1();
std::span<const std::uint8_t> first_probabilities_2();

}  // namespace cellmap
