#include "cellmap/scan/text_table.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <fstream>

namespace cellmap {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kBlanks = " \t\r\v\f,";  // some tools write commas

std::vector<std::string_view> split(std::string_view line) {
  std::vector<std::string_view> words;
  std::size_t begin = line.find_first_not_of(kBlanks);
  while (begin != std::string_view::npos) {
    const std::size_t end = std::min(line.find_first_of(kBlanks, begin), line.size());
    words.push_back(line.substr(begin, end - begin));
    begin = line.find_first_not_of(kBlanks, end);
  }
  return words;
}

/// A word for a message: short, and without control characters of a binary file.
std::string quoted(std::string_view word) {
  std::string shown;
  for (const char c : word.substr(0, 40)) shown += c >= ' ' && c <= '~' ? c : '?';
  return "\"" + shown + (word.size() > 40 ? "...\"" : "\"");
}

template <typename Number>
Number parse(const TextTable& table, const TextRow& row, std::size_t column) {
  if (column >= row.words.size()) {
    throw table.error(row, "expected at least " + std::to_string(column + 1) + " numbers, found " +
                               std::to_string(row.words.size()));
  }
  std::string_view word = row.words[column];
  if (word.starts_with('+')) word.remove_prefix(1);  // from_chars knows no plus sign
  Number value = 0;
  const auto [end, code] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (code != std::errc{} || end != word.data() + word.size()) {
    throw table.error(row, "expected a number, found " + quoted(row.words[column]));
  }
  if (!std::isfinite(value)) {
    throw table.error(row, "expected a finite number, found " + quoted(row.words[column]));
  }
  return value;
}

}  // namespace

std::string read_file(const fs::path& file, std::size_t max_bytes) {
  std::error_code code;
  const fs::file_status status = fs::status(file, code);
  if (!fs::exists(status)) throw Error(ErrorCode::kNotFound, file.string() + ": no such file");
  if (!fs::is_regular_file(status)) {
    throw Error(ErrorCode::kIo, file.string() + ": expected a regular file");
  }
  std::ifstream in(file, std::ios::binary);
  const std::uintmax_t size = fs::file_size(file, code);
  if (!in || code) throw Error(ErrorCode::kIo, file.string() + ": cannot be opened for reading");
  if (size > max_bytes) {
    throw Error(ErrorCode::kTooLarge, file.string() + ": expected at most " +
                                          std::to_string(max_bytes) + " bytes, found " +
                                          std::to_string(size));
  }
  std::string bytes(size, '\0');
  in.read(bytes.data(), static_cast<std::streamsize>(size));
  if (static_cast<std::uintmax_t>(in.gcount()) != size) {
    throw Error(ErrorCode::kIo, file.string() + ": expected " + std::to_string(size) +
                                    " bytes, could read " + std::to_string(in.gcount()));
  }
  return bytes;
}

void write_file(const fs::path& file, std::string_view bytes) {
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  out.close();
  if (!out) {
    throw Error(ErrorCode::kIo, file.string() + ": cannot be written (does the folder exist, is " +
                                    "there space?)");
  }
}

TextTable::TextTable(const fs::path& file)
    : file_(file), text_(read_file(file, kMaxTextFileBytes)) {
  const std::string_view text = text_;
  std::size_t line = 0;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    ++line;
    std::vector<std::string_view> words = split(text.substr(begin, end - begin));
    if (!words.empty() && !words[0].starts_with('#')) rows_.push_back({line, std::move(words)});
    begin = end + 1;
  }
}

double TextTable::number(const TextRow& row, std::size_t column) const {
  return parse<double>(*this, row, column);
}

Stamp TextTable::seconds(const TextRow& row, std::size_t column) const {
  // A double loses a hundred nanoseconds in Unix time; long double has the bits.
  const long double value = parse<long double>(*this, row, column);
  constexpr long double kMaxSeconds = 9.2e9L;
  if (std::abs(value) > kMaxSeconds) {
    throw error(
        row, "expected a time in seconds, found " + quoted(row.words[column]) + " (nanoseconds?)");
  }
  return static_cast<Stamp>(std::llround(value * 1e9L));
}

Error TextTable::error(const TextRow& row, const std::string& message) const {
  return Error(ErrorCode::kCorruptData,
               file_.string() + ":" + std::to_string(row.line) + ": " + message);
}

std::string seconds_text(Stamp stamp) {
  constexpr std::uint64_t kUnit = 1'000'000'000;
  const std::uint64_t magnitude =
      stamp < 0 ? ~static_cast<std::uint64_t>(stamp) + 1 : static_cast<std::uint64_t>(stamp);
  std::array<char, 32> text;
  std::snprintf(text.data(), text.size(), "%s%llu.%09llu", stamp < 0 ? "-" : "",
                static_cast<unsigned long long>(magnitude / kUnit),
                static_cast<unsigned long long>(magnitude % kUnit));
  return text.data();
}

}  // namespace cellmap
