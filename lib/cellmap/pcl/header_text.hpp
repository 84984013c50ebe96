#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

#include "cellmap/core/error.hpp"

namespace cellmap::pcl_io {

/// A cloud file read line by line, first its header, with messages that name file and line.
class HeaderText {
 public:
  /// Throws Error{kNotFound} or {kIo} where `file` is not a readable regular file.
  explicit HeaderText(const std::filesystem::path& file);

  /// The words of the next line; false at the end of the file. A line of more than 1 MiB is
  /// Error{kCorruptData}. Comments are words like others.
  bool next(std::vector<std::string>& words);

  /// Bytes after the last line read.
  std::uint64_t bytes_left();

  /// The next 4 bytes as a little-endian number.
  std::uint32_t read_u32();

  /// A whole number of at most 18 digits; else Error{kCorruptData} with file, line and word.
  std::uint64_t whole_number(const std::string& word) const;

  /// Error of `code` that begins with "FILE:LINE: ".
  Error error(ErrorCode code, const std::string& message) const;
  Error corrupt(const std::string& message) const {
    return error(ErrorCode::kCorruptData, message);
  }

 private:
  std::filesystem::path file_;
  std::uint64_t size_ = 0;
  std::ifstream in_;
  std::string line_;
  std::size_t line_number_ = 0;
};

/// A word of an untrusted file for a message: short, without control characters, in quotes.
std::string in_quotes(std::string_view word);

/// Refuses an ASCII row that is not `values` finite numbers or "nan". PCL reads other words, "inf"
/// and "-nan" among them, as zero or NaN without a word.
void check_row(const HeaderText& text, const std::vector<std::string>& words, std::uint64_t values);

/// Refuses counts of points out of 1 to kMaxPoints.
void check_point_count(const HeaderText& text, std::uint64_t points);

}  // namespace cellmap::pcl_io
