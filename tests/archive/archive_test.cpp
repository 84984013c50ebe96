#include <gmock/gmock.h>

#include <random>

#include "cellmap/archive/archive_precision.hpp"
#include "cellmap/archive/archive_reader.hpp"
#include "cellmap/archive/store_archive.hpp"
#include "cellmap/archive/update_archive.hpp"
#include "cellmap/codec/plane_displacement.hpp"
#include "cellmap/codec/pose_graph_codec.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "support/archive_sample.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

using test::ArchiveSample;
using test::expect_error;
using test::TempFolder;

/// Counts the reads of an archive, as requests to a web server.
class CountingSource : public MemoryFile {
 public:
  using MemoryFile::MemoryFile;
  Bytes read(std::uint64_t offset, std::size_t length) override {
    ++reads;
    read_bytes += length;
    return MemoryFile::read(offset, length);
  }
  int reads = 0;
  std::uint64_t read_bytes = 0;
};

ArchiveReader reader_of(const Bytes& bytes) {
  return ArchiveReader(std::make_unique<MemoryFile>(bytes));
}

void expect_near(const Pose& a, const Pose& b, double metres, double radians) {
  EXPECT_LE((a.translation() - b.translation()).norm(), metres);
  EXPECT_LE(Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle(), radians);
}

TEST(Archive, WhatWasPutInComesOutBitByBitWhereTheEncodingIsLossless) {
  const ArchiveSample sample(7);
  for (const auto encoding : {ArchiveEncoding::kRaw, ArchiveEncoding::kPacked}) {
    ArchiveReader reader = reader_of(sample.bytes({.encoding = encoding}));
    for (std::size_t k = 0; k < sample.cells.size(); ++k) {
      const ArchiveCell cell = reader.cell(sample.ids[k]);
      const EncodedCell expected = encode_cell(sample.cells[k]);
      EXPECT_EQ(encode_cell(cell.cell).bytes, expected.bytes);
      EXPECT_EQ(cell.raw_hash, expected.hash);
      EXPECT_EQ(reader.cells()[k].hash, expected.hash);
      EXPECT_EQ(reader.cells()[k].bytes, expected.bytes.size());
      EXPECT_EQ(cell.bound_m, 0);
    }
    EXPECT_EQ(encode_pose_graph(reader.pose_graph()), encode_pose_graph(sample.contents.graph));
    for (const auto& [id, stretch] : sample.contents.stretches) {
      const CellScans& found = reader.scans().at(id);
      EXPECT_EQ(found.raw_points, stretch.raw_points);
      EXPECT_EQ(found.voxel_points, stretch.voxel_points);
      EXPECT_EQ(found.T_odom_cell.matrix(), stretch.T_odom_cell.matrix());
      ASSERT_EQ(found.scans.size(), stretch.scans.size());
      for (std::size_t i = 0; i < found.scans.size(); ++i) {
        EXPECT_EQ(found.scans[i].stamp, stretch.scans[i].stamp);
        EXPECT_EQ(found.scans[i].T_cell_scan.matrix(), stretch.scans[i].T_cell_scan.matrix());
      }
    }
    EXPECT_EQ(reader.footer().sessions, sample.contents.sessions);
    EXPECT_EQ(reader.footer().map, "town");
    EXPECT_EQ(reader.footer().created, sample.contents.created);
    EXPECT_EQ(reader.footer().georeference->R_enu_map, sample.contents.georeference->R_enu_map);
  }
}

TEST(Archive, ACompactArchiveKeepsPlanesWithinItsBoundAndScansOnTheGrid) {
  const ArchiveSample sample(4, 300);
  ArchiveReader reader =
      reader_of(sample.bytes({.encoding = ArchiveEncoding::kCompact, .bound_m = 0.02}));
  EXPECT_EQ(reader.footer().bound_m, 0.02);
  for (std::size_t k = 0; k < sample.cells.size(); ++k) {
    const ArchiveCell cell = reader.cell(sample.ids[k]);
    EXPECT_EQ(cell.raw_hash, encode_cell(sample.cells[k]).hash);
    EXPECT_EQ(cell.bound_m, 0.02);
    EXPECT_LE(cell_displacement(sample.cells[k], cell.cell).worst_m, 0.02);
    const auto& scans = reader.scans().at(cell.id).scans;
    const auto& expected = sample.contents.stretches.at(cell.id).scans;
    for (std::size_t i = 0; i < scans.size(); ++i) {
      EXPECT_EQ(scans[i].stamp, expected[i].stamp);
      expect_near(scans[i].T_cell_scan, expected[i].T_cell_scan, 1.1e-4, 8.3e-7);
    }
  }
}

/// What rounds may take no more than the last of the digits that are written of it.
void expect_rounded(const PoseGraph& found, const PoseGraph& graph) {
  EXPECT_EQ(found.revision, graph.revision);
  EXPECT_EQ(found.unaligned, graph.unaligned);
  ASSERT_EQ(found.nodes.size(), graph.nodes.size());
  for (const auto& [id, pose] : graph.nodes) expect_near(found.nodes.at(id), pose, 1.4e-5, 1e-8);
  ASSERT_EQ(found.constraints.size(), graph.constraints.size());
  for (std::size_t k = 0; k < graph.constraints.size(); ++k) {
    const Constraint &a = found.constraints[k], &b = graph.constraints[k];
    validate(a);
    EXPECT_EQ(a.id, b.id);
    EXPECT_EQ(a.from, b.from);
    EXPECT_EQ(a.to, b.to);
    expect_near(a.T_from_to, b.T_from_to, 1.4e-5, 1e-8);
    const double largest = b.information.cwiseAbs().maxCoeff();
    EXPECT_LE((a.information - b.information).cwiseAbs().maxCoeff(), largest * 0x1p-23);
    EXPECT_NEAR(a.weight, b.weight, 1e-7);
    EXPECT_NEAR(a.scores.inlier_ratio_hit, b.scores.inlier_ratio_hit, 1e-7);
  }
}

/// Numbers with as many digits as real ones have.
PoseGraph with_all_digits(PoseGraph graph) {
  std::mt19937 rng(3);
  std::normal_distribution<double> normal(0, 1);
  const auto random = [&] {
    Tangent xi;
    for (int i = 0; i < 6; ++i) xi[i] = normal(rng);
    return xi;
  };
  for (auto& [id, pose] : graph.nodes) pose = exp(random()) * pose;
  for (Constraint& constraint : graph.constraints) {
    constraint.T_from_to = exp(random());
    Matrix6d root;
    for (int i = 0; i < 6; ++i) root.col(i) = random() * (i < 3 ? 20 : 500);
    constraint.information = root * root.transpose();
    constraint.information =
        0.5 * (constraint.information + constraint.information.transpose()).eval();
    constraint.scores.inlier_ratio_hit = 0.123456789;
    constraint.weight = 1.0 / 3;
  }
  return graph;
}

TEST(Archive, ACompactArchiveKeepsOfAPoseGraphTheDigitsThatSaySomething) {
  ArchiveSample sample(9);
  sample.contents.graph = with_all_digits(sample.contents.graph);
  const Bytes exact = sample.bytes(),
              compact = sample.bytes({.encoding = ArchiveEncoding::kCompact, .bound_m = 0.02});
  EXPECT_EQ(encode_pose_graph(reader_of(exact).pose_graph()),
            encode_pose_graph(sample.contents.graph));
  const PoseGraph found = reader_of(compact).pose_graph();
  expect_rounded(found, sample.contents.graph);
  EXPECT_EQ(encode_pose_graph(to_archive_precision(found)), encode_pose_graph(found));
  const auto bytes = [](const PoseGraph& graph) { return zstd_compress(encode_pose_graph(graph)); };
  EXPECT_LT(bytes(found).size(), 2 * bytes(sample.contents.graph).size() / 3);
}

TEST(ArchiveUpdate, OfACompactArchiveNamesOnlyWhatMoved) {
  ArchiveSample sample(9);
  sample.contents.graph = with_all_digits(sample.contents.graph);
  MemoryFile file(sample.bytes({.encoding = ArchiveEncoding::kCompact, .bound_m = 0.02}));
  PoseGraph graph = sample.contents.graph;
  ++graph.revision;
  graph.nodes.begin()->second.translation().y() += 0.1;
  EXPECT_LT(update_archive(file, graph), 1'500u);
  const PoseGraph found = reader_of(file.bytes()).pose_graph();
  expect_near(found.nodes.begin()->second, graph.nodes.begin()->second, 1.3e-4, 8.5e-7);
  graph.nodes.begin()->second = found.nodes.begin()->second;
  expect_rounded(found, graph);
}

TEST(Archive, AnyCellIsOneReadAfterTheFirstTwo) {
  const ArchiveSample sample(9);
  auto source = std::make_unique<CountingSource>(sample.bytes());
  CountingSource& counts = *source;
  ArchiveReader reader(std::move(source));
  EXPECT_EQ(counts.reads, 1);
  EXPECT_LE(counts.read_bytes, kArchiveFirstReadBytes);
  reader.pose_graph();
  reader.cells();
  EXPECT_EQ(counts.reads, 2);
  for (const CellId id : sample.ids) {
    const int before = counts.reads;
    reader.cell(id);
    EXPECT_EQ(counts.reads, before + 1);
  }
  const int before = counts.reads;
  std::vector<CellId> seen;
  reader.for_each_cell(sample.ids, [&](const ArchiveCell& cell) { seen.push_back(cell.id); });
  EXPECT_EQ(seen, sample.ids);
  EXPECT_EQ(counts.reads, before + 1) << "neighbours are read at once";
  expect_error(
      ErrorCode::kNotFound, [&] { reader.cell(CellId{2}); }, "CELL 2");
}

TEST(Archive, MoreCellsThanFitIntoTheRootAreFoundThroughLeaves) {
  constexpr std::uint32_t kCells = 12'000;
  std::mt19937 rng(4);
  std::vector<std::uint32_t> ids;  // without a pattern, so that they take room
  for (std::uint32_t id = 0; ids.size() < kCells; id += 1 + rng() % 2000) ids.push_back(id);
  const auto id_of = [&](std::uint32_t k) { return CellId{ids[k]}; };
  MemoryFile file;
  Cell cell = random_cell(1, 0, 1000);
  cell.session = "s";
  ArchiveWriter writer(file, cell.lattice, {.encoding = ArchiveEncoding::kRaw});
  ArchiveContents contents;
  contents.sessions = {{"s", "", "", "", 0}};
  for (std::uint32_t k = 0; k < kCells; ++k) {
    const CellId id = id_of(k);
    cell.sequence = k;
    cell.first_scan = k * 77;
    contents.graph.nodes[id] = Pose(Eigen::Translation3d(k, 0, 0));
    writer.add(id, cell);
  }
  writer.finish(contents);
  auto source = std::make_unique<CountingSource>(file.bytes());
  CountingSource& counts = *source;
  ArchiveReader reader(std::move(source));
  ASSERT_TRUE(reader.head().has_leaves);
  EXPECT_EQ(reader.entries().size(), kCells);
  for (const std::uint32_t k : {0u, 4095u, 4096u, 9'345u, kCells - 1}) {
    const int before = counts.reads;
    EXPECT_EQ(reader.cell(id_of(k)).cell.sequence, k);
    EXPECT_LE(counts.reads, before + 2);
  }
  EXPECT_EQ(reader.pose_graph().nodes.size(), kCells);
  EXPECT_FALSE(reader.find(CellId{ids.back() + 1}));
}

TEST(Archive, AMapWithoutCellsIsOne) {
  ArchiveReader reader = reader_of(ArchiveSample(0).bytes());
  EXPECT_TRUE(reader.cells().empty());
  EXPECT_TRUE(reader.pose_graph().nodes.empty());
  EXPECT_EQ(map_info(reader).cells, 0u);
}

TEST(Archive, WhatDoesNotBelongTogetherIsRefused) {
  const ArchiveSample sample(3);
  MemoryFile file;
  ArchiveWriter writer(file, sample.cells[0].lattice, {});
  writer.add(CellId{5}, sample.cells[0]);
  expect_error(
      ErrorCode::kInvalidArgument, [&] { writer.add(CellId{5}, sample.cells[1]); }, "increase");
  Cell other = sample.cells[1];
  other.lattice.size = 2000;
  expect_error(
      ErrorCode::kInvalidArgument, [&] { writer.add(CellId{6}, other); }, "lattice");
  expect_error(
      ErrorCode::kInvalidArgument, [&] { writer.finish(sample.contents); }, "belongs to no CELL");
  expect_error(ErrorCode::kInvalidArgument, [&] {
    ArchiveWriter(file, other.lattice, {.encoding = ArchiveEncoding::kCompact, .bound_m = 2});
  });
}

TEST(Archive, AStoreComesBackAsItWas) {
  const TempFolder folder;
  const auto store = open_sqlite_store(folder / "maps.db");
  const ArchiveSample sample(9);
  ArchiveReader archive = reader_of(sample.bytes());
  restore_map(archive, *store, "first");
  MemoryFile file;
  archive_map(*store, "first", file, {});
  ArchiveReader again = reader_of(file.bytes());
  const MapInfo info = restore_map(again, *store, "second");
  EXPECT_EQ(info.cells, sample.cells.size());
  EXPECT_EQ(info.scans, 27u);
  EXPECT_EQ(info.georeference->latitude_deg, 49.0);
  EXPECT_EQ(map_info(again).raw_points, info.raw_points);
  EXPECT_EQ(map_info(again).encoded_bytes, info.encoded_bytes);
  PoseGraph first = store->pose_graph("first"), second = store->pose_graph("second");
  for (PoseGraph* graph : {&first, &second}) graph->revision = sample.contents.graph.revision;
  EXPECT_EQ(encode_pose_graph(first), encode_pose_graph(second));
  EXPECT_EQ(second.unaligned, sample.contents.graph.unaligned);
  for (std::size_t k = 0; k < sample.ids.size(); ++k) {
    EXPECT_EQ(store->cell("second", sample.ids[k]).hash, encode_cell(sample.cells[k]).hash);
    EXPECT_EQ(second.nodes.at(sample.ids[k]).matrix(),
              sample.contents.graph.nodes.at(sample.ids[k]).matrix());
  }
  EXPECT_EQ(store->scans("second", "monday").size(), 6u);
  EXPECT_EQ(second.constraints.size(), 8u);
  EXPECT_EQ(second.constraints[3].pinned, true);
  EXPECT_EQ(second.constraints[2].weight, 1.0 / 3);
  expect_error(ErrorCode::kAlreadyExists, [&] { restore_map(again, *store, "first"); });
}

TEST(Archive, ARestoreThatFailsLeavesNoMap) {
  const TempFolder folder;
  const auto store = open_sqlite_store(folder / "maps.db");
  const ArchiveSample sample(3);
  Bytes bytes = sample.bytes();
  bytes[reader_of(bytes).find(sample.ids[2])->offset + 100] ^= std::byte{1};
  ArchiveReader archive = reader_of(bytes);
  expect_error(
      ErrorCode::kCorruptData, [&] { restore_map(archive, *store, "town"); }, "CELL 5");
  EXPECT_TRUE(store->maps().empty());
}

TEST(ArchiveUpdate, PosesAndConstraintsAreThoseOfTheNewRevision) {
  const ArchiveSample sample(9);
  MemoryFile file(sample.bytes());
  PoseGraph graph = sample.contents.graph;
  for (int round = 0; round < 5; ++round) {
    ++graph.revision;
    for (auto& [id, pose] : graph.nodes) pose.translation().y() += 0.1;
    graph.constraints.erase(graph.constraints.begin());
    Constraint added = graph.constraints.back();
    added.id.value += 1;
    graph.constraints.push_back(added);
    graph.constraints[0].weight = 0.25;
    graph.unaligned.erase(graph.unaligned.begin(), graph.unaligned.end());
    update_archive(file, graph);
    ArchiveReader reader = reader_of(file.bytes());
    const PoseGraph& found = reader.pose_graph();
    EXPECT_EQ(found.revision, graph.revision);
    EXPECT_EQ(found.unaligned, graph.unaligned);
    for (const auto& [id, pose] : graph.nodes)
      expect_near(found.nodes.at(id), pose, 1.1e-4, 8.3e-7);
    PoseGraph rest = found;
    rest.nodes = graph.nodes;
    EXPECT_EQ(encode_pose_graph(rest), encode_pose_graph(graph)) << "all but poses is exact";
    EXPECT_LE(reader.footer().sections.size(), 5u) << "what was superseded is one section";
    EXPECT_EQ(encode_cell(reader.cell(sample.ids[4]).cell).bytes,
              encode_cell(sample.cells[4]).bytes);
  }
}

TEST(ArchiveUpdate, AGraphOfAnotherMapIsRefused) {
  const ArchiveSample sample(4);
  const Bytes bytes = sample.bytes();
  MemoryFile file(bytes);
  PoseGraph earlier = sample.contents.graph, other = earlier, fewer = earlier;
  --earlier.revision;
  other.constraints[1].T_from_to.translation().x() += 1;
  fewer.nodes.erase(fewer.nodes.begin());
  for (const PoseGraph& graph : {earlier, other, fewer}) {
    expect_error(
        ErrorCode::kConflict, [&] { update_archive(file, graph); }, "anew");
  }
  EXPECT_EQ(file.bytes(), bytes);
}

/// Stops after some of the writes of an update, one of them in the middle.
class CutFile : public MemoryFile {
 public:
  CutFile(Bytes bytes, std::size_t budget) : MemoryFile(std::move(bytes)), budget_(budget) {}
  void write(std::uint64_t offset, std::span<const std::byte> bytes) override {
    const std::size_t part = std::min(budget_, bytes.size());
    MemoryFile::write(offset, bytes.first(part));
    budget_ -= part;
    if (part < bytes.size()) throw Error(ErrorCode::kIo, "cut");
  }
  std::size_t left() const { return budget_; }

 private:
  std::size_t budget_;
};

TEST(ArchiveUpdate, WhereverItIsCutOffTheOldOrTheNewStateIsReadable) {
  const ArchiveSample sample(5, 10);
  PoseGraph graph = sample.contents.graph;
  MemoryFile once(sample.bytes());
  graph.revision = 18;
  update_archive(once, graph);
  for (const Bytes& start : {sample.bytes(), once.bytes()}) {
    graph.revision = 19;
    graph.nodes.begin()->second.translation().x() += 5;
    bool finished = false;
    const Revision before = reader_of(start).footer().revision;
    for (std::size_t budget = 0; !finished; ++budget) {
      CutFile file(start, budget);
      try {
        update_archive(file, graph);
        finished = true;
      } catch (const Error& error) {
        ASSERT_EQ(to_string(error.code()), to_string(ErrorCode::kIo));
      }
      ArchiveReader reader = reader_of(file.bytes());
      EXPECT_EQ(reader.pose_graph().revision, finished ? 19 : before) << "after " << budget;
      MemoryFile again(file.bytes());  // and the next update finds nothing in its way
      update_archive(again, graph);
      EXPECT_EQ(reader_of(again.bytes()).footer().revision, 19u);
    }
  }
}

}  // namespace
}  // namespace cellmap
