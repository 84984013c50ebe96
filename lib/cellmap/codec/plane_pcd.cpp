#include "cellmap/codec/plane_pcd.hpp"

#include <charconv>
#include <cstring>
#include <map>
#include <string>
#include <string_view>

#include "cellmap/core/error.hpp"
#include "cellmap/scan/text_table.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kMaxHeaderBytes = 4'096;
constexpr std::size_t kMostBytesOfAPlane = 256;  // as text

[[noreturn]] void refuse(const std::filesystem::path& file, ErrorCode code,
                         const std::string& message) {
  throw Error(code, file.string() + ": " + message);
}

/// Takes the first line off `text`, without its end.
std::string_view take_line(std::string_view& text) {
  const std::size_t end = text.find('\n');
  std::string_view line = text.substr(0, end);
  text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

/// Takes the first word off `text`; empty where there is none.
std::string_view take_word(std::string_view& text) {
  constexpr std::string_view kBlanks = " \t\r\n";
  text.remove_prefix(std::min(text.find_first_not_of(kBlanks), text.size()));
  const std::string_view word = text.substr(0, text.find_first_of(kBlanks));
  text.remove_prefix(word.size());
  return word;
}

struct Header {
  std::size_t planes = 0;
  bool is_binary = false;
};

std::size_t count_of(const std::filesystem::path& file, std::string_view word,
                     std::size_t max_planes) {
  std::size_t count = 0;
  const auto [end, code] = std::from_chars(word.data(), word.data() + word.size(), count);
  if (code != std::errc{} || end != word.data() + word.size()) {
    refuse(file, ErrorCode::kCorruptData, "expected POINTS and a number in the header of the PCD");
  }
  if (count > max_planes) {
    refuse(file, ErrorCode::kTooLarge,
           "it has " + std::to_string(count) + " planes, but the lattice has " +
               std::to_string(max_planes) + " directions; give the lattice's --lattice-size");
  }
  return count;
}

/// Takes the header off `text`.
Header take_header(const std::filesystem::path& file, std::string_view& text,
                   std::size_t max_planes) {
  const std::string_view begin = text.substr(0, kMaxHeaderBytes);
  std::map<std::string_view, std::string_view> entries;
  for (std::string_view rest = begin; !entries.contains("DATA");) {
    if (rest.empty()) refuse(file, ErrorCode::kCorruptData, "it has no header of a PCD");
    const std::string_view line = take_line(rest);
    text.remove_prefix(static_cast<std::size_t>(rest.data() - text.data()));
    if (line.starts_with('#')) continue;
    const std::size_t blank = std::min(line.find(' '), line.size());
    entries[line.substr(0, blank)] = line.substr(std::min(blank + 1, line.size()));
  }
  const std::pair<const char*, const char*> expected[] = {
      {"FIELDS", "x y z intensity"}, {"SIZE", "4 4 4 4"}, {"TYPE", "F F F F"}};
  for (const auto& [key, value] : expected) {
    if (entries[key] == value) continue;
    refuse(file, ErrorCode::kUnsupported,
           std::string("expected ") + key + " " + value + " (a normal and a distance), found " +
               std::string(entries[key].substr(0, 60)));
  }
  const std::string_view data = entries["DATA"];
  if (data != "ascii" && data != "binary") {
    refuse(file, ErrorCode::kUnsupported,
           "expected DATA ascii or binary, found " + std::string(data.substr(0, 60)));
  }
  return {count_of(file, entries["POINTS"], max_planes), data == "binary"};
}

std::vector<Plane> read_binary(const std::filesystem::path& file, std::string_view data,
                               std::size_t count) {
  constexpr std::size_t kBytes = 4 * sizeof(float);
  if (data.size() < count * kBytes) {
    refuse(file, ErrorCode::kCorruptData,
           "it announces " + std::to_string(count) + " planes, but " +
               std::to_string(data.size() / kBytes) + " follow");
  }
  std::vector<Plane> planes(count);
  for (std::size_t k = 0; k < count; ++k) {
    float v[4];
    std::memcpy(v, data.data() + k * kBytes, kBytes);
    planes[k] = {v[3], v[0], v[1], v[2]};
  }
  return planes;
}

std::vector<Plane> read_text(const std::filesystem::path& file, std::string_view data,
                             std::size_t count) {
  std::vector<Plane> planes;
  for (std::size_t k = 0; k < count; ++k) {
    float v[4];
    for (float& number : v) {
      const std::string_view word = take_word(data);
      const auto [end, code] = std::from_chars(word.data(), word.data() + word.size(), number);
      if (word.empty() || code != std::errc{} || end != word.data() + word.size()) {
        refuse(file, ErrorCode::kCorruptData,
               "expected " + std::to_string(count) + " planes of four numbers, but plane " +
                   std::to_string(k) + " is none");
      }
    }
    planes.push_back({v[3], v[0], v[1], v[2]});
  }
  return planes;
}

}  // namespace

std::vector<Plane> read_plane_pcd(const std::filesystem::path& file, std::size_t max_planes) {
  const std::string bytes = read_file(file, kMaxHeaderBytes + kMostBytesOfAPlane * max_planes);
  std::string_view text = bytes;
  const Header header = take_header(file, text, max_planes);
  return header.is_binary ? read_binary(file, text, header.planes)
                          : read_text(file, text, header.planes);
}

}  // namespace cellmap
