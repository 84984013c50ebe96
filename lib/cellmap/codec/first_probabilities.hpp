#pragma once

#include <cstdint>
#include <span>

namespace cellmap {

/// Of each model of compact planes, in units of 1/256, that its first bit is 1 (FORMAT.md, "First
/// probabilities"). Made by tests/codec/train_models.cpp from simulated CELLs.
std::span<const std::uint8_t> compact_first_probabilities();

}  // namespace cellmap
