// Files of every format version with JSON twins, made without the library (tests/conformance).

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/codec/cell_json.hpp"
#include "cellmap/codec/changes_codec.hpp"
#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/codec/plane_displacement.hpp"
#include "cellmap/codec/pose_graph_codec.hpp"
#include "cellmap/codec/scan_codec.hpp"
#include "cellmap/geometry/lattice.hpp"

namespace cellmap {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

const fs::path kFolder = fs::path(CELLMAP_SOURCE_DIR) / "tests" / "conformance";

Bytes read_bytes(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(stream), {}};
  EXPECT_FALSE(text.empty()) << file;
  const auto* begin = reinterpret_cast<const std::byte*>(text.data());
  return Bytes(begin, begin + text.size());
}

/// All files of all versions with a suffix, for example v1/street.cell and
/// v1/street.canonical.cell.
std::vector<fs::path> files_with_suffix(const std::string& suffix) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(kFolder)) {
    if (entry.path().extension() == suffix) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

bool is_canonical(const fs::path& file) { return file.stem().extension() == ".canonical"; }

Json twin_of(fs::path file) {
  file.replace_extension();
  if (file.extension() == ".canonical") file.replace_extension();
  std::ifstream stream(file.string() + ".json");
  return Json::parse(stream);
}

fs::path canonical_of(const fs::path& file) {
  return file.parent_path() / (file.stem().string() + ".canonical" + file.extension().string());
}

Eigen::Matrix4d pose_in(const Json& json) {
  const char* const names[] = {"r00", "r01", "r02", "tx",  "r10", "r11",
                               "r12", "ty",  "r20", "r21", "r22", "tz"};
  Eigen::Matrix4d M = Eigen::Matrix4d::Identity();
  for (int k = 0; k < 12; ++k) M(k / 4, k % 4) = json.at(names[k]).get<double>();
  return M;
}

float float_in(const Json& json) {
  if (!json.is_string()) return json.get<float>();
  const float infinity = std::numeric_limits<float>::infinity();
  if (json == "inf") return infinity;
  if (json == "-inf") return -infinity;
  return std::numeric_limits<float>::quiet_NaN();
}

/// Absent numbers are 0, as the format says.
template <typename Number>
Number number_in(const Json& json, const char* name) {
  return json.value(name, Number{0});
}

void expect_statistics(const CellStatistics& statistics, const Json& twin) {
  const Json json = twin.value("statistics", Json::object());
  EXPECT_EQ(statistics.points, number_in<std::uint64_t>(json, "points"));
  EXPECT_EQ(statistics.points_in_planes, number_in<std::uint64_t>(json, "points_in_planes"));
  EXPECT_EQ(statistics.patches_hit, number_in<std::uint32_t>(json, "patches_hit"));
  EXPECT_EQ(statistics.rejected_few_points, number_in<std::uint32_t>(json, "rejected_few_points"));
  EXPECT_EQ(statistics.rejected_gap, number_in<std::uint32_t>(json, "rejected_gap"));
  EXPECT_EQ(statistics.rejected_planarity, number_in<std::uint32_t>(json, "rejected_planarity"));
  EXPECT_EQ(statistics.rejected_grazing, number_in<std::uint32_t>(json, "rejected_grazing"));
}

void expect_cell(const Cell& cell, const Json& twin) {
  EXPECT_EQ(twin.at("lattice").at("kind"),
            cell.lattice.kind == LatticeKind::kFibonacciBands ? "FibonacciBands" : "Fibonacci");
  EXPECT_EQ(cell.lattice.size, twin.at("lattice").at("size"));
  EXPECT_EQ(cell.indices, twin.at("indices").get<std::vector<std::uint32_t>>());
  ASSERT_EQ(cell.planes.size(), twin.at("planes").size());
  for (std::size_t k = 0; k < cell.planes.size(); ++k) {
    const Json& plane = twin["planes"][k];
    const Plane expected = {plane.at("distance"), plane.at("nx"), plane.at("ny"), plane.at("nz")};
    EXPECT_EQ(cell.planes[k], expected);
  }
  EXPECT_EQ(cell.session, twin.at("session"));
  EXPECT_EQ(cell.sequence, number_in<std::uint32_t>(twin, "sequence"));
  EXPECT_EQ(cell.T_odom_cell.matrix(), pose_in(twin.at("t_odom_cell")));
  EXPECT_EQ(cell.first_stamp, number_in<std::int64_t>(twin, "first_stamp_ns"));
  EXPECT_EQ(cell.last_stamp, number_in<std::int64_t>(twin, "last_stamp_ns"));
  EXPECT_EQ(cell.first_scan, number_in<std::uint32_t>(twin, "first_scan"));
  EXPECT_EQ(cell.scan_count, number_in<std::uint32_t>(twin, "scan_count"));
  expect_statistics(cell.statistics, twin);
}

/// The digest of four little-endian words.
ContentHash hash_in(const Json& json) {
  ContentHash hash;
  for (int i = 0; i < 32; ++i) {
    const std::uint64_t word = json.at("word" + std::to_string(i / 8));
    hash.bytes[i] = static_cast<std::uint8_t>(word >> 8 * (i % 8));
  }
  return hash;
}

TEST(Conformance, CellsSayWhatTheirTwinsSay) {
  const auto files = files_with_suffix(".cell");
  ASSERT_GE(files.size(), 6u);
  for (const fs::path& file : files) {
    SCOPED_TRACE(file);
    const Bytes bytes = read_bytes(file);
    const Json twin = twin_of(file);
    expect_cell(decode_cell(bytes), twin);
    if (!is_canonical(file)) {
      EXPECT_EQ(verified_hash(bytes), hash_in(twin.at("content_hash")));
    }
  }
}

TEST(Conformance, CellsAreEncodedToTheBytesThatTheFormatPrescribes) {
  for (const fs::path& file : files_with_suffix(".cell")) {
    if (is_canonical(file)) continue;
    SCOPED_TRACE(file);
    const EncodedCell encoded = encode_cell(decode_cell(read_bytes(file)));
    EXPECT_EQ(encoded.bytes, read_bytes(canonical_of(file)));
    EXPECT_EQ(encoded.hash, verified_hash(read_bytes(canonical_of(file))));
  }
}

TEST(Conformance, TheJsonFormAgreesWithTheTwin) {
  for (const fs::path& file : files_with_suffix(".cell")) {
    SCOPED_TRACE(file);
    const Json twin = twin_of(file);
    const Bytes bytes = read_bytes(file);
    const Json json = Json::parse(cell_to_json(decode_cell(bytes), verified_hash(bytes)));
    EXPECT_EQ(json.at("indices"), twin.at("indices"));
    ASSERT_EQ(json.at("planes").size(), twin.at("planes").size());
    for (std::size_t k = 0; k < twin["planes"].size(); ++k) {
      EXPECT_EQ(json["planes"][k][0].get<float>(), twin["planes"][k]["distance"].get<float>());
      EXPECT_EQ(json["planes"][k][3].get<float>(), twin["planes"][k]["nz"].get<float>());
    }
    EXPECT_EQ(json.at("first_stamp"), number_in<std::int64_t>(twin, "first_stamp_ns"));
  }
}

Plane plane_in(const Json& json) {
  return {json.at("distance"), json.at("nx"), json.at("ny"), json.at("nz")};
}

/// A decoded CELL against the part of its twin that says what is decoded.
void expect_coded_cell(const DecodedCell& decoded, const Json& twin, const char* indices) {
  Json header = twin;
  header["indices"] = twin.at("decoded").at(indices);
  header["planes"] = Json::array();
  const Json& all = twin["decoded"].at("indices");
  for (const Json& index : header["indices"]) {
    const auto at = std::find(all.begin(), all.end(), index) - all.begin();
    header["planes"].push_back(twin["decoded"].at("planes").at(static_cast<std::size_t>(at)));
  }
  expect_cell(decoded.cell, header);
  EXPECT_EQ(decoded.raw_hash, hash_in(twin.at("raw_hash")));
  EXPECT_EQ(decoded.encoding == CellEncoding::kPacked, twin.at("encoding") == "Packed");
  EXPECT_EQ(decoded.bound_m, twin.at("bound_um").get<double>() * 1e-6);
  EXPECT_EQ(decoded.all_planes, twin.at("plane_count"));
}

TEST(Conformance, CodedCellsBecomeTheirTwinsToTheBit) {
  const auto files = files_with_suffix(".ccod");
  ASSERT_GE(files.size(), 14u);
  for (const fs::path& file : files) {
    SCOPED_TRACE(file);
    const Bytes bytes = read_bytes(file);
    const Json twin = twin_of(file);
    expect_coded_cell(decode_coded_cell(bytes), twin, "indices");
    const std::span prefix(bytes.data(), coarse_cell_bytes(bytes));
    expect_coded_cell(decode_coarse_cell(prefix, bytes.size()), twin, "coarse_indices");
  }
}

TEST(Conformance, CodedCellsAreOfTheirSourceWithinTheBound) {
  for (const fs::path& file : files_with_suffix(".ccod")) {
    if (!is_canonical(file)) continue;
    SCOPED_TRACE(file);
    const Json twin = twin_of(file);
    const DecodedCell decoded = decode_coded_cell(read_bytes(file));
    Cell source = decoded.cell;
    for (std::size_t k = 0; k < source.planes.size(); ++k) {
      source.planes[k] = plane_in(twin["decoded"].at("source").at(k));
    }
    EXPECT_EQ(encode_cell(source).hash, decoded.raw_hash);
    EXPECT_LE(cell_displacement(source, decoded.cell).worst_m, decoded.bound_m);
    if (decoded.encoding == CellEncoding::kPacked) {
      // There is one way to pack without a zstd frame; the library takes the smaller.
      const Bytes packed = encode_packed_cell(source).bytes, expected = read_bytes(file);
      EXPECT_LE(packed.size(), expected.size());
      if (packed.size() == expected.size()) {
        EXPECT_EQ(packed, expected);
      }
    }
  }
}

void expect_constraint(const Constraint& constraint, const Json& twin) {
  const char* const kinds[] = {"", "Odometry", "Bidirectional", "Loop"};
  const char* const origins[] = {"", "Mapper", "Detection", "User"};
  EXPECT_EQ(constraint.id.value, twin.at("id"));
  EXPECT_EQ(constraint.from.value, twin.at("from"));
  EXPECT_EQ(constraint.to.value, twin.at("to"));
  EXPECT_EQ(kinds[static_cast<int>(constraint.kind)], twin.at("kind"));
  EXPECT_EQ(origins[static_cast<int>(constraint.origin)], twin.at("origin"));
  EXPECT_EQ(constraint.T_from_to.matrix(), pose_in(twin.at("t_from_to")));
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) {
      const int low = std::min(row, column), high = std::max(row, column);
      const char name[] = {'m', static_cast<char>('0' + low), static_cast<char>('0' + high), 0};
      EXPECT_EQ(constraint.information(row, column), twin.at("information").at(name));
    }
  }
  const Json scores = twin.value("scores", Json::object());
  EXPECT_EQ(constraint.scores.points, number_in<std::uint32_t>(scores, "points"));
  EXPECT_EQ(constraint.scores.hits, number_in<std::uint32_t>(scores, "hits"));
  EXPECT_EQ(constraint.scores.inlier_ratio_all, number_in<double>(scores, "inlier_ratio_all"));
  EXPECT_EQ(constraint.scores.inlier_ratio_hit, number_in<double>(scores, "inlier_ratio_hit"));
  EXPECT_EQ(constraint.scores.share_in_front, number_in<double>(scores, "share_in_front"));
  EXPECT_EQ(constraint.scores.share_beyond, number_in<double>(scores, "share_beyond"));
  EXPECT_EQ(constraint.scores.median_residual_m, number_in<double>(scores, "median_residual_m"));
  EXPECT_EQ(constraint.weight, twin.value("weight", 1.0));
  EXPECT_EQ(constraint.pinned, twin.value("pinned", false));
}

TEST(Conformance, PoseGraphsSayWhatTheirTwinsSay) {
  const auto files = files_with_suffix(".cpgr");
  ASSERT_GE(files.size(), 4u);
  for (const fs::path& file : files) {
    SCOPED_TRACE(file);
    const PoseGraph graph = decode_pose_graph(read_bytes(file));
    const Json twin = twin_of(file);
    EXPECT_EQ(graph.revision, twin.at("revision"));
    ASSERT_EQ(graph.nodes.size(), twin.at("nodes").size());
    for (const Json& node : twin["nodes"]) {
      const CellId cell{node.at("cell").get<std::uint32_t>()};
      EXPECT_EQ(graph.nodes.at(cell).matrix(), pose_in(node.at("t_map_cell")));
    }
    ASSERT_EQ(graph.constraints.size(), twin.at("constraints").size());
    for (std::size_t i = 0; i < graph.constraints.size(); ++i) {
      expect_constraint(graph.constraints[i], twin["constraints"][i]);
    }
    if (!is_canonical(file)) {
      EXPECT_EQ(encode_pose_graph(graph), read_bytes(canonical_of(file)));
    }
  }
}

void expect_added(const CellRecord& cell, const Json& twin) {
  EXPECT_EQ(cell.id.value, twin.at("cell"));
  EXPECT_EQ(cell.hash, hash_in(twin.at("hash")));
  EXPECT_EQ(cell.added, twin.at("added"));
  EXPECT_EQ(cell.moved, twin.at("moved"));
  EXPECT_EQ(cell.T_map_cell.matrix(), pose_in(twin.at("t_map_cell")));
  EXPECT_EQ(cell.session, twin.at("session"));
  EXPECT_EQ(cell.sequence, twin.at("sequence"));
  EXPECT_EQ(cell.planes, twin.at("planes"));
  EXPECT_EQ(cell.encoded_bytes, twin.at("encoded_bytes"));
}

template <typename Ids>
void expect_ids(const Ids& ids, const Json& twin) {
  ASSERT_EQ(ids.size(), twin.size());
  for (std::size_t i = 0; i < ids.size(); ++i) EXPECT_EQ(ids[i].value, twin[i]);
}

TEST(Conformance, ChangesSayWhatTheirTwinsSay) {
  const auto files = files_with_suffix(".cchg");
  ASSERT_GE(files.size(), 8u);
  for (const fs::path& file : files) {
    SCOPED_TRACE(file);
    const MapChanges changes = decode_changes(read_bytes(file));
    const Json twin = twin_of(file);
    EXPECT_EQ(changes.since, twin.at("since"));
    EXPECT_EQ(changes.revision, twin.at("revision"));
    ASSERT_EQ(changes.added.size(), twin.at("added").size());
    for (std::size_t i = 0; i < changes.added.size(); ++i) {
      expect_added(changes.added[i], twin["added"][i]);
    }
    const Json decoded = twin.at("decoded");
    ASSERT_EQ(changes.moved.size(), decoded.at("moved").size());
    for (const Json& moved : decoded["moved"]) {
      const CellId cell{moved.at("cell").get<std::uint32_t>()};
      EXPECT_EQ(changes.moved.at(cell).matrix(), pose_in(moved.at("t_map_cell")));
    }
    expect_ids(changes.removed, decoded.value("removed", Json::array()));
    ASSERT_EQ(changes.added_constraints.size(), twin.at("added_constraints").size());
    for (std::size_t i = 0; i < changes.added_constraints.size(); ++i) {
      expect_constraint(changes.added_constraints[i], twin["added_constraints"][i]);
    }
    expect_ids(changes.removed_constraints, decoded.value("removed_constraints", Json::array()));
    expect_ids(std::vector(changes.unaligned.begin(), changes.unaligned.end()),
               decoded.value("unaligned", Json::array()));
    const Json judged = decoded.value("judged", Json::array());
    ASSERT_EQ(changes.judged.size(), judged.size());
    for (const Json& row : judged) {
      const Judgement found = changes.judged.at(ConstraintId{row.at("id").get<std::uint32_t>()});
      EXPECT_EQ(found.weight, row.at("weight"));
      EXPECT_EQ(found.pinned, row.at("pinned"));
    }
    if (!is_canonical(file) && file.stem() != "beyond-half-a-turn") {
      EXPECT_EQ(encode_changes(changes), read_bytes(canonical_of(file)));
    }
  }
}

void expect_coordinates(const std::vector<float>& values, const Json& twin) {
  ASSERT_EQ(values.size(), twin.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const float expected = float_in(twin[i]);
    if (std::isnan(expected)) {
      EXPECT_TRUE(std::isnan(values[i]));
    } else {
      EXPECT_EQ(values[i], expected);
    }
  }
}

TEST(Conformance, ScansSayWhatTheirTwinsSay) {
  const auto files = files_with_suffix(".cscn");
  ASSERT_GE(files.size(), 4u);
  for (const fs::path& file : files) {
    SCOPED_TRACE(file);
    const PosedScan scan = decode_scan(read_bytes(file));
    const Json twin = twin_of(file);
    EXPECT_EQ(scan.index, twin.at("index"));
    EXPECT_EQ(scan.stamp, twin.at("stamp_ns"));
    EXPECT_EQ(scan.T_odom_sensor.matrix(), pose_in(twin.at("t_odom_sensor")));
    expect_coordinates(scan.points.x, twin.at("x"));
    expect_coordinates(scan.points.y, twin.at("y"));
    expect_coordinates(scan.points.z, twin.at("z"));
    if (!is_canonical(file)) {
      EXPECT_EQ(encode_scan(scan), read_bytes(canonical_of(file)));
    }
  }
}

TEST(Conformance, LatticeDirectionsHaveTheBitsThatTheFormatPrescribes) {
  std::ifstream stream(kFolder / "v1" / "lattice-directions.json");
  std::ifstream band_stream(kFolder / "v1" / "band-directions.json");
  Json rows = Json::parse(stream);
  ASSERT_GE(rows.size(), 40u);
  const Json band_rows = Json::parse(band_stream);
  ASSERT_GE(band_rows.size(), 20u);
  rows.insert(rows.end(), band_rows.begin(), band_rows.end());
  LatticeCache lattices;
  for (const Json& row : rows) {
    const std::string kind = row.at("kind");
    const auto shared = lattices.get({lattice_kind_from(kind), row.at("size")});
    const Lattice& lattice = *shared;
    EXPECT_EQ(lattice.size(), row.value("count", lattice.spec().size));
    const Eigen::Vector3d direction = lattice.direction(row.at("index"));
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_EQ(direction[axis], row.at("direction")[axis]) << row;
  }
}

}  // namespace
}  // namespace cellmap
