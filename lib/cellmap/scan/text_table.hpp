#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/core/stamp.hpp"

namespace cellmap {

/// One line of a text file: the words on it, separated by blanks.
struct TextRow {
  std::size_t line = 0;  ///< from 1
  std::vector<std::string_view> words;
};

/// A text file of rows of words, the shape of every pose, time and calibration file. Blank lines
/// and lines that start with # are left out. Not copyable: the rows point into the text.
class TextTable {
 public:
  /// Reads `file`. Throws Error{kNotFound} where it does not exist, {kIo} where it is not a
  /// readable regular file, {kTooLarge} over `kMaxTextFileBytes`.
  explicit TextTable(const std::filesystem::path& file);
  TextTable(const TextTable&) = delete;
  TextTable& operator=(const TextTable&) = delete;

  const std::filesystem::path& file() const { return file_; }
  const std::vector<TextRow>& rows() const { return rows_; }

  /// Word `column` of `row` as a finite number; Error{kCorruptData} with file, line and word.
  double number(const TextRow& row, std::size_t column) const;

  /// Word `column` of `row`, decimal seconds, as a stamp exact to the nanosecond.
  Stamp seconds(const TextRow& row, std::size_t column) const;

  /// Error{kCorruptData} that begins with "FILE:LINE: ".
  Error error(const TextRow& row, const std::string& message) const;

 private:
  std::filesystem::path file_;
  std::string text_;
  std::vector<TextRow> rows_;
};

/// Over a million poses; a larger file is not a pose file.
constexpr std::size_t kMaxTextFileBytes = std::size_t{256} << 20;

/// Decimal seconds with nine digits after the point, exact: "1567410201.745204700".
std::string seconds_text(Stamp stamp);

/// The bytes of a regular file of at most `max_bytes`. Throws Error{kNotFound}, {kIo} or
/// {kTooLarge} with the file's name.
std::string read_file(const std::filesystem::path& file, std::size_t max_bytes);

/// Writes (or overwrites) `file`; Error{kIo} with the file's name.
void write_file(const std::filesystem::path& file, std::string_view bytes);

}  // namespace cellmap
