#include <algorithm>
#include <array>
#include <map>

#include "cellmap/pcl/cloud_header.hpp"
#include "cellmap/pcl/header_text.hpp"

namespace cellmap::pcl_io {
namespace {

using Words = std::vector<std::string>;

constexpr std::array<std::string_view, 10> kKeys = {
    "VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA"};
constexpr std::size_t kMaxPcdHeaderLines = 1000;
constexpr std::size_t kMaxFields = 256;
constexpr std::uint64_t kMaxCount = 4096;             // values of one field: descriptors
constexpr std::uint64_t kMaxCloudBytes = 1ULL << 30;  // of all points in memory
// LZF copies at most 264 bytes for three, so no honest stream grows more than 88-fold.
constexpr std::uint64_t kMaxGrowth = 100;

/// What the header says of one point.
struct PointLayout {
  std::uint64_t bytes = 0;   ///< of one point
  std::uint64_t values = 0;  ///< numbers of one point
};

/// The values of each key, the last of which is DATA. PCL lets the last of two equal keys win and
/// takes beginnings of keys for keys; here both are refused, so that both read the same header.
std::map<std::string, Words> read_entries(HeaderText& text) {
  std::map<std::string, Words> entries;
  Words words;
  for (std::size_t line = 0; line < kMaxPcdHeaderLines && text.next(words); ++line) {
    if (words.empty() || words[0].starts_with('#')) continue;
    const std::string key = words[0];
    if (std::find(kKeys.begin(), kKeys.end(), key) == kKeys.end()) {
      throw text.corrupt("expected a PCD header line (VERSION, FIELDS, SIZE, TYPE, COUNT, WIDTH, " +
                         std::string("HEIGHT, VIEWPOINT, POINTS or DATA), found ") +
                         in_quotes(key));
    }
    words.erase(words.begin());
    if (!entries.emplace(key, words).second) throw text.corrupt("found " + key + " twice");
    if (key == "DATA") return entries;
  }
  throw text.corrupt("expected a PCD header that ends with DATA, found none");
}

const Words& values_of(const HeaderText& text, const std::map<std::string, Words>& entries,
                       const std::string& key, std::size_t count) {
  const auto entry = entries.find(key);
  if (entry == entries.end()) throw text.corrupt("expected " + key + " in the header, found none");
  if (entry->second.size() != count) {
    throw text.corrupt("expected " + std::to_string(count) + " values of " + key + ", found " +
                       std::to_string(entry->second.size()));
  }
  return entry->second;
}

/// x, y and z: one float or double each.
void check_coordinates(const HeaderText& text, const Words& fields, const Words& sizes,
                       const Words& types, const Words& counts) {
  for (const char* name : {"x", "y", "z"}) {
    const auto found = std::count(fields.begin(), fields.end(), name);
    if (found != 1) {
      std::string all;
      for (const std::string& field : fields) (all += ' ') += in_quotes(field);
      throw text.corrupt("expected the fields x, y and z once each, found" + all);
    }
    const auto i = std::find(fields.begin(), fields.end(), name) - fields.begin();
    if (types[i] != "F" || (sizes[i] != "4" && sizes[i] != "8") || counts[i] != "1") {
      throw text.error(ErrorCode::kUnsupported, "expected the field " + std::string(name) +
                                                    " as one float (TYPE F, SIZE 4 or 8), found " +
                                                    in_quotes(types[i] + " " + sizes[i]));
    }
  }
}

PointLayout check_fields(const HeaderText& text, const std::map<std::string, Words>& entries) {
  const auto named = entries.find("FIELDS");
  if (named == entries.end()) throw text.corrupt("expected FIELDS in the header, found none");
  const Words& fields = named->second;
  if (fields.size() > kMaxFields) throw text.corrupt("expected at most 256 fields");
  const Words& sizes = values_of(text, entries, "SIZE", fields.size());
  const Words& types = values_of(text, entries, "TYPE", fields.size());
  const Words ones(fields.size(), "1");
  const Words& counts =
      entries.contains("COUNT") ? values_of(text, entries, "COUNT", fields.size()) : ones;
  PointLayout layout;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const std::uint64_t size = text.whole_number(sizes[i]);
    const std::uint64_t count = text.whole_number(counts[i]);
    const bool known_size = size == 1 || size == 2 || size == 4 || size == 8;
    const bool known_type = types[i] == "F" || types[i] == "U" || types[i] == "I";
    if (!known_size || !known_type || (types[i] == "F" && size < 4)) {
      throw text.corrupt("expected the field " + in_quotes(fields[i]) +
                         " of TYPE F, U or I and SIZE 1, 2, 4 or 8, found " +
                         in_quotes(types[i] + " " + sizes[i]));
    }
    if (count == 0 || count > kMaxCount) {
      throw text.corrupt("expected a COUNT of 1 to 4096, found " + std::to_string(count));
    }
    layout.bytes += size * count;
    layout.values += count;
  }
  check_coordinates(text, fields, sizes, types, counts);
  return layout;
}

std::uint64_t check_points(const HeaderText& text, const std::map<std::string, Words>& entries) {
  const auto number = [&](const char* key) {
    return text.whole_number(values_of(text, entries, key, 1)[0]);
  };
  const std::uint64_t width = number("WIDTH");
  const std::uint64_t height = number("HEIGHT");
  const std::uint64_t points = entries.contains("POINTS") ? number("POINTS") : width;
  check_point_count(text, points);
  if (height == 0 || points % height != 0 || points / height != width) {
    throw text.corrupt("expected POINTS to be WIDTH x HEIGHT, found " + std::to_string(points) +
                       ", " + std::to_string(width) + " and " + std::to_string(height));
  }
  return points;
}

void expect_bytes(const HeaderText& text, std::uint64_t expected, std::uint64_t found) {
  if (found >= expected) return;
  throw text.corrupt("expected " + std::to_string(expected) + " bytes of points after the header," +
                     " found " + std::to_string(found) + ": the file is cut off");
}

void check_compressed(HeaderText& text, std::uint64_t cloud_bytes) {
  const std::uint64_t packed = text.read_u32();
  const std::uint64_t unpacked = text.read_u32();
  expect_bytes(text, packed, text.bytes_left());
  if (unpacked != cloud_bytes || unpacked / kMaxGrowth > packed) {
    throw text.corrupt("expected " + std::to_string(cloud_bytes) +
                       " bytes of compressed points, found " + std::to_string(unpacked) + " in " +
                       std::to_string(packed));
  }
}

void check_ascii(HeaderText& text, std::uint64_t points, std::uint64_t values) {
  Words words;
  std::uint64_t row = 0;
  while (row < points && text.next(words)) {
    if (words.empty()) continue;
    check_row(text, words, values);
    ++row;
  }
  if (row < points) {
    throw text.corrupt("expected " + std::to_string(points) + " points, found " +
                       std::to_string(row) + ": the file is cut off");
  }
}

}  // namespace

void check_pcd(const std::filesystem::path& file) {
  HeaderText text(file);
  const std::map<std::string, Words> entries = read_entries(text);
  const PointLayout layout = check_fields(text, entries);
  const std::uint64_t points = check_points(text, entries);
  if (points * layout.bytes > kMaxCloudBytes) {
    throw text.error(ErrorCode::kTooLarge, "expected at most 1 GiB of points, found " +
                                               std::to_string(points * layout.bytes) + " bytes");
  }
  const std::string kind = values_of(text, entries, "DATA", 1)[0];
  if (kind == "binary") return expect_bytes(text, points * layout.bytes, text.bytes_left());
  if (kind == "binary_compressed") return check_compressed(text, points * layout.bytes);
  if (kind == "ascii") {
    // A digit and a blank a value: refused here, before the rows are read.
    expect_bytes(text, points * layout.values * 2 - 1, text.bytes_left());
    return check_ascii(text, points, layout.values);
  }
  throw text.error(ErrorCode::kUnsupported,
                   "expected DATA ascii, binary or binary_compressed, found " + in_quotes(kind));
}

}  // namespace cellmap::pcl_io
