#include "cellmap/pcl/header_text.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <sstream>

#include "cellmap/pcl/cloud_header.hpp"

namespace cellmap::pcl_io {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxLineBytes = std::size_t{1} << 20;

}  // namespace

HeaderText::HeaderText(const fs::path& file) : file_(file) {
  std::error_code code;
  const fs::file_status status = fs::status(file, code);
  if (!fs::exists(status)) throw Error(ErrorCode::kNotFound, file.string() + ": no such file");
  if (!fs::is_regular_file(status)) {
    throw Error(ErrorCode::kIo, file.string() + ": expected a regular file");
  }
  size_ = fs::file_size(file, code);
  in_.open(file, std::ios::binary);
  if (code || !in_) throw Error(ErrorCode::kIo, file.string() + ": cannot be opened for reading");
}

bool HeaderText::next(std::vector<std::string>& words) {
  words.clear();
  line_.clear();
  char c = 0;
  while (in_.get(c) && c != '\n') {
    line_ += c;
    if (line_.size() > kMaxLineBytes) {
      ++line_number_;
      throw corrupt("expected a line of text, found over a megabyte without an end of line");
    }
  }
  if (!in_ && line_.empty()) return false;
  in_.clear();
  ++line_number_;
  std::istringstream in(line_);
  for (std::string word; in >> word;) words.push_back(word);
  return true;
}

std::uint64_t HeaderText::bytes_left() {
  const auto position = static_cast<std::uint64_t>(in_.tellg());
  return size_ > position ? size_ - position : 0;
}

std::uint32_t HeaderText::read_u32() {
  unsigned char bytes[4] = {};
  in_.read(reinterpret_cast<char*>(bytes), sizeof(bytes));
  if (in_.gcount() != sizeof(bytes)) throw corrupt("expected four more bytes, found the end");
  return static_cast<std::uint32_t>(bytes[0]) | static_cast<std::uint32_t>(bytes[1]) << 8 |
         static_cast<std::uint32_t>(bytes[2]) << 16 | static_cast<std::uint32_t>(bytes[3]) << 24;
}

std::uint64_t HeaderText::whole_number(const std::string& word) const {
  const bool digits = !word.empty() && word.size() <= 18 &&
                      word.find_first_not_of("0123456789") == std::string::npos;
  if (!digits) throw corrupt("expected a whole number, found " + in_quotes(word));
  return std::stoull(word);
}

Error HeaderText::error(ErrorCode code, const std::string& message) const {
  return Error(code, file_.string() + ":" + std::to_string(line_number_) + ": " + message);
}

std::string in_quotes(std::string_view word) {
  std::string shown = "\"";
  for (const char c : word.substr(0, 40)) shown += c >= ' ' && c <= '~' ? c : '?';
  shown += word.size() > 40 ? "...\"" : "\"";
  return shown;
}

bool is_number_or_nan(std::string_view word) {
  if (word == "nan" || word == "NaN" || word == "NAN") return true;
  if (word.starts_with('+')) word.remove_prefix(1);
  double value = 0;
  const auto [end, code] = std::from_chars(word.data(), word.data() + word.size(), value);
  return code == std::errc{} && end == word.data() + word.size() && std::isfinite(value);
}

void check_row(const HeaderText& text, const std::vector<std::string>& words,
               std::uint64_t values) {
  if (words.size() != values) {
    throw text.corrupt("expected a point of " + std::to_string(values) + " numbers, found " +
                       std::to_string(words.size()));
  }
  const auto bad = std::find_if_not(words.begin(), words.end(), is_number_or_nan);
  if (bad != words.end()) {
    throw text.corrupt("expected a finite number or nan, found " + in_quotes(*bad));
  }
}

void check_point_count(const HeaderText& text, std::uint64_t points) {
  if (points == 0) throw text.corrupt("expected a scan, found a cloud without points");
  if (points > kMaxPoints) {
    throw text.error(ErrorCode::kTooLarge,
                     "expected a scan of at most " + std::to_string(kMaxPoints) +
                         " points, found one that announces " + std::to_string(points));
  }
}

}  // namespace cellmap::pcl_io
