#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string_view>

#include "cellmap/codec/cell_codec.hpp"

namespace cellmap::client {

/// Writes a file so that readers see the old bytes or the new ones, never a part: a temporary
/// file beside it, then a rename. Throws Error{kIo} naming the file.
void write_file_atomically(const std::filesystem::path& file, std::span<const std::byte> bytes);
void write_file_atomically(const std::filesystem::path& file, std::string_view text);

/// The whole file; nullopt where it is not there. Throws Error{kIo} where it cannot be read, and
/// Error{kTooLarge} above `max_bytes`.
std::optional<Bytes> read_file(const std::filesystem::path& file, std::uint64_t max_bytes);

/// Makes a folder and its parents where they are missing. Throws Error{kIo} naming it.
void make_directory(const std::filesystem::path& directory);

/// The bytes of a text.
std::span<const std::byte> as_bytes(std::string_view text);
/// The text that bytes are.
std::string_view as_text(std::span<const std::byte> bytes);

}  // namespace cellmap::client
