#include <algorithm>
#include <array>
#include <utility>

#include "cellmap/pcl/cloud_header.hpp"
#include "cellmap/pcl/header_text.hpp"

namespace cellmap::pcl_io {
namespace {

using Words = std::vector<std::string>;

constexpr std::size_t kMaxPlyHeaderLines = 1000;
constexpr std::array<std::pair<std::string_view, std::uint64_t>, 16> kTypeBytes = {
    {{"char", 1},
     {"int8", 1},
     {"uchar", 1},
     {"uint8", 1},
     {"short", 2},
     {"int16", 2},
     {"ushort", 2},
     {"uint16", 2},
     {"int", 4},
     {"int32", 4},
     {"uint", 4},
     {"uint32", 4},
     {"float", 4},
     {"float32", 4},
     {"double", 8},
     {"float64", 8}}};

struct Property {
  std::string type, name;
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
  bool has_list = false;
};

struct PlyHeader {
  std::string format;
  std::vector<Element> elements;
};

std::uint64_t bytes_of(const HeaderText& text, const std::string& type) {
  for (const auto& [name, bytes] : kTypeBytes) {
    if (name == type) return bytes;
  }
  throw text.corrupt("expected a PLY type (char to double), found " + in_quotes(type));
}

void add_property(const HeaderText& text, PlyHeader& header, const Words& words) {
  if (header.elements.empty()) throw text.corrupt("expected an element before its properties");
  Element& element = header.elements.back();
  if (words.size() == 5 && words[1] == "list") {
    element.has_list = true;
  } else if (words.size() == 3) {
    bytes_of(text, words[1]);
    element.properties.push_back({words[1], words[2]});
  } else {
    throw text.corrupt("expected \"property TYPE NAME\", found " + std::to_string(words.size()) +
                       " words");
  }
}

void add_element(const HeaderText& text, PlyHeader& header, const Words& words) {
  if (words.size() != 3) throw text.corrupt("expected \"element NAME COUNT\"");
  for (const Element& element : header.elements) {
    if (element.name == words[1]) throw text.corrupt("found two elements " + in_quotes(words[1]));
  }
  header.elements.push_back({words[1], text.whole_number(words[2]), {}, false});
}

PlyHeader read_header(HeaderText& text) {
  PlyHeader header;
  Words words;
  if (!text.next(words) || words != Words{"ply"}) {
    throw text.corrupt("expected a PLY file (first line \"ply\"), found something else");
  }
  for (std::size_t line = 0; line < kMaxPlyHeaderLines && text.next(words); ++line) {
    if (words.empty()) throw text.corrupt("expected a header line, found an empty one");
    if (words[0] == "comment") continue;
    if (words[0] == "end_header") return header;
    if (words[0] == "format" && words.size() == 3 && header.format.empty()) {
      header.format = words[1];
    } else if (words[0] == "element") {
      add_element(text, header, words);
    } else if (words[0] == "property") {
      add_property(text, header, words);
    } else if (words[0] == "obj_info") {
      // PCL takes the size of a range grid from here and allocates it.
      if (words.size() > 1 && words[1].starts_with("num_")) {
        throw text.error(ErrorCode::kUnsupported, "PLY range grids are not read");
      }
    } else {
      throw text.corrupt("expected a PLY header line, found " + in_quotes(words[0]));
    }
  }
  throw text.corrupt("expected a PLY header that ends with end_header, found none");
}

void check_vertices(const HeaderText& text, const PlyHeader& header) {
  const auto vertex = std::find_if(header.elements.begin(), header.elements.end(),
                                   [](const Element& element) { return element.name == "vertex"; });
  if (vertex == header.elements.end()) {
    throw text.corrupt("expected an element \"vertex\", found none");
  }
  check_point_count(text, vertex->count);
  for (const char* name : {"x", "y", "z"}) {
    const auto is_named = [&](const Property& property) { return property.name == name; };
    const auto& properties = vertex->properties;
    if (std::count_if(properties.begin(), properties.end(), is_named) != 1) {
      std::string found;
      for (const Property& property : properties) (found += ' ') += in_quotes(property.name);
      throw text.corrupt("expected the vertex properties x, y and z once each, found" +
                         (found.empty() ? std::string(" none") : found));
    }
    const std::string type = std::find_if(properties.begin(), properties.end(), is_named)->type;
    if (!type.starts_with("float") && type != "double") {
      throw text.error(ErrorCode::kUnsupported,
                       "expected the vertex property " + std::string(name) +
                           " as float or double, found " + in_quotes(type));
    }
  }
}

/// The fewest bytes that can follow the header.
std::uint64_t least_bytes(HeaderText& text, const PlyHeader& header) {
  std::uint64_t bytes = 0;
  for (const Element& element : header.elements) {
    if (element.has_list && (element.count > 0 || element.name == "vertex")) {
      throw text.error(ErrorCode::kUnsupported,
                       "expected points only, found lists in the element " +
                           in_quotes(element.name) + ": a mesh is not a scan");
    }
    if (element.count > text.bytes_left()) {
      throw text.corrupt("expected " + std::to_string(element.count) + " times " +
                         in_quotes(element.name) + " after the header, found " +
                         std::to_string(text.bytes_left()) + " bytes: the file is cut off");
    }
    std::uint64_t element_bytes = 0;  // ASCII: a digit and a blank a value
    for (const Property& property : element.properties) {
      element_bytes += header.format == "ascii" ? 2 : bytes_of(text, property.type);
    }
    bytes += element.count * element_bytes;
  }
  return header.format == "ascii" ? bytes - 1 : bytes;
}

/// One line an element, in the order of the header.
void check_ascii(HeaderText& text, const PlyHeader& header) {
  Words words;
  for (const Element& element : header.elements) {
    for (std::uint64_t i = 0; i < element.count; ++i) {
      if (!text.next(words)) {
        throw text.corrupt("expected " + std::to_string(element.count) + " lines of " +
                           in_quotes(element.name) + ", found " + std::to_string(i) +
                           ": the file is cut off");
      }
      check_row(text, words, element.properties.size());
    }
  }
}

}  // namespace

void check_ply(const std::filesystem::path& file) {
  HeaderText text(file);
  const PlyHeader header = read_header(text);
  const std::array<std::string_view, 3> formats = {"ascii", "binary_little_endian",
                                                   "binary_big_endian"};
  if (std::find(formats.begin(), formats.end(), header.format) == formats.end()) {
    throw text.error(
        ErrorCode::kUnsupported,
        "expected the format ascii, binary_little_endian or binary_big_endian, found " +
            in_quotes(header.format));
  }
  check_vertices(text, header);
  const std::uint64_t expected = least_bytes(text, header);
  const std::uint64_t found = text.bytes_left();
  if (found < expected) {
    throw text.corrupt("expected " + std::to_string(expected) + " bytes after the header, found " +
                       std::to_string(found) + ": the file is cut off");
  }
  if (header.format == "ascii") check_ascii(text, header);
}

}  // namespace cellmap::pcl_io
