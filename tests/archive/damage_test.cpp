#include <gmock/gmock.h>

#include <set>

#include "cellmap/archive/archive_reader.hpp"
#include "cellmap/archive/repair_archive.hpp"
#include "cellmap/archive/update_archive.hpp"
#include "cellmap/archive/verify_archive.hpp"
#include "cellmap/codec/pose_graph_codec.hpp"
#include "support/archive_sample.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

using test::ArchiveSample;
using test::expect_error;

ArchiveReport verified(const Bytes& bytes) {
  MemoryFile file(bytes);
  return verify_archive(file);
}

/// Everything that a reader can be asked for; throws Error alone, whatever the bytes are.
void read_all(const Bytes& bytes) {
  try {
    ArchiveReader reader(std::make_unique<MemoryFile>(bytes));
    reader.pose_graph();
    reader.scans();
    for (const ArchiveEntry& entry : reader.entries()) reader.cell(entry.cell);
  } catch (const Error& error) {
    const bool expected = error.code() == ErrorCode::kCorruptData ||
                          error.code() == ErrorCode::kUnsupported ||
                          error.code() == ErrorCode::kTooLarge;
    EXPECT_TRUE(expected) << error.what();
  }
}

/// An archive with an update in it, and where its records are.
struct Victim {
  ArchiveSample sample;
  Bytes bytes;
  std::vector<ArchiveEntry> entries;

  explicit Victim(std::uint32_t cells, std::uint32_t planes, ArchiveEncoding encoding)
      : sample(cells, planes) {
    MemoryFile file(sample.bytes({.encoding = encoding}));
    PoseGraph graph = sample.contents.graph;
    ++graph.revision;
    for (auto& [id, pose] : graph.nodes) pose.translation().z() += 0.5;
    update_archive(file, graph);
    ++graph.revision;
    update_archive(file, graph);
    bytes = file.bytes();
    entries = ArchiveReader(std::make_unique<MemoryFile>(bytes)).entries();
  }

  /// Repairs damaged bytes and expects the CELLs of which every byte is there.
  void expect_recovered(const Bytes& damaged, const std::set<CellId>& intact) const {
    MemoryFile in(damaged), out;
    if (intact.empty()) {  // there may be nothing at all
      try {
        repair_archive(in, out);
      } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::kCorruptData) << error.what();
        return;
      }
    } else {
      repair_archive(in, out);
    }
    EXPECT_THAT(verified(out.bytes()).damage, testing::IsEmpty());
    ArchiveReader before(std::make_unique<MemoryFile>(bytes));
    ArchiveReader after(std::make_unique<MemoryFile>(out.bytes()));
    for (const CellId id : intact) {
      ASSERT_EQ(after.record(id), before.record(id)) << "CELL " << id.value;
    }
  }
};

TEST(ArchiveDamage, AnIntactArchiveHasNone) {
  for (const auto encoding :
       {ArchiveEncoding::kRaw, ArchiveEncoding::kPacked, ArchiveEncoding::kCompact}) {
    const ArchiveReport report = verified(Victim(4, 20, encoding).bytes);
    EXPECT_THAT(report.damage, testing::IsEmpty());
    EXPECT_EQ(report.cells, 4u);
    EXPECT_EQ(report.planes, 80u);
  }
}

/// Offsets of a file: all of them but in the long run of zeros behind the root directory.
std::vector<std::size_t> offsets_of(const Bytes& bytes, std::size_t step) {
  std::vector<std::size_t> offsets;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const bool padding = i >= kArchiveRootOffset + 256 && i < kArchiveFirstReadBytes;
    if (i % (padding ? 97 * step : step) == 0) offsets.push_back(i);
  }
  return offsets;
}

TEST(ArchiveDamage, AnyFlippedBitIsReportedAndWhatItDoesNotHitIsRecovered) {
  const Victim victim(3, 4, ArchiveEncoding::kPacked);
  std::mt19937 rng(1);
  std::size_t count = 0;
  for (const std::size_t offset : offsets_of(victim.bytes, 1)) {
    Bytes damaged = victim.bytes;
    damaged[offset] ^= std::byte{static_cast<unsigned char>(1u << (rng() % 8))};
    ASSERT_THAT(verified(damaged).damage, testing::Not(testing::IsEmpty())) << offset;
    read_all(damaged);
    if (++count % 5 != 0) continue;
    std::set<CellId> intact;
    for (const ArchiveEntry& entry : victim.entries) {
      const bool hit = offset >= entry.offset && offset < entry.offset + entry.bytes;
      if (!hit) intact.insert(entry.cell);
    }
    victim.expect_recovered(damaged, intact);
  }
}

TEST(ArchiveDamage, AFileCutOffAnywhereIsReportedAndItsWholeCellsAreRecovered) {
  const Victim victim(3, 4, ArchiveEncoding::kPacked);
  for (const std::size_t length : offsets_of(victim.bytes, 3)) {
    const Bytes damaged(victim.bytes.begin(),
                        victim.bytes.begin() + static_cast<std::ptrdiff_t>(length));
    ASSERT_THAT(verified(damaged).damage, testing::Not(testing::IsEmpty())) << length;
    expect_error(ErrorCode::kCorruptData,
                 [&] { ArchiveReader(std::make_unique<MemoryFile>(damaged)); });
    std::set<CellId> intact;
    for (const ArchiveEntry& entry : victim.entries) {
      if (entry.offset + entry.bytes <= length) intact.insert(entry.cell);
    }
    victim.expect_recovered(damaged, intact);
  }
}

TEST(ArchiveDamage, OfALargerFileToo) {
  for (const auto encoding : {ArchiveEncoding::kRaw, ArchiveEncoding::kCompact}) {
    const Victim victim(40, 60, encoding);
    std::mt19937 rng(2);
    for (int i = 0; i < 60; ++i) {
      Bytes damaged = victim.bytes;
      std::set<std::size_t> hits;
      for (int k = 0; k < 5; ++k) hits.insert(rng() % damaged.size());
      for (const std::size_t hit : hits) damaged[hit] ^= std::byte{0xff};
      ASSERT_THAT(verified(damaged).damage, testing::Not(testing::IsEmpty()));
      read_all(damaged);
      std::set<CellId> intact;
      for (const ArchiveEntry& entry : victim.entries) {
        const auto hit = hits.lower_bound(entry.offset);
        if (hit == hits.end() || *hit >= entry.offset + entry.bytes) intact.insert(entry.cell);
      }
      victim.expect_recovered(damaged, intact);
    }
  }
}

TEST(ArchiveDamage, NoiseIsNoArchive) {
  std::mt19937 rng(3);
  for (const std::size_t size : {0u, 1u, 7u, 64u, 2000u, 16384u, 40'000u}) {
    Bytes noise(size);
    for (std::byte& byte : noise) byte = std::byte{static_cast<unsigned char>(rng())};
    EXPECT_THAT(verified(noise).damage, testing::Not(testing::IsEmpty()));
    MemoryFile in(noise), out;
    expect_error(
        ErrorCode::kCorruptData, [&] { repair_archive(in, out); }, "nothing");
  }
}

TEST(ArchiveRepair, AnUnfinishedArchiveKeepsItsCells) {
  const ArchiveSample sample(3);
  MemoryFile file, out;
  ArchiveWriter writer(file, sample.cells[0].lattice, {});
  for (std::size_t k = 0; k < sample.cells.size(); ++k) writer.add(sample.ids[k], sample.cells[k]);
  expect_error(
      ErrorCode::kCorruptData, [&] { ArchiveReader(std::make_unique<MemoryFile>(file.bytes())); },
      "finished");
  const RepairReport report = repair_archive(file, out);
  EXPECT_EQ(report.cells, 3u);
  ArchiveReader reader(std::make_unique<MemoryFile>(out.bytes()));
  for (std::size_t k = 0; k < sample.cells.size(); ++k) {
    EXPECT_EQ(reader.pose_graph().nodes.at(sample.ids[k]).matrix(),
              sample.cells[k].T_odom_cell.matrix())
        << "where odometry had it";
  }
  EXPECT_THAT(reader.pose_graph().unaligned, testing::ElementsAre(sample.ids[2]))
      << "sessions but the first are not in its frame";
}

TEST(ArchiveRepair, WhatIsLostOfALostCellGoesWithIt) {
  const Victim victim(5, 10, ArchiveEncoding::kCompact);
  Bytes damaged = victim.bytes;
  damaged[victim.entries[2].offset + 50] ^= std::byte{1};
  MemoryFile in(damaged), out;
  const RepairReport report = repair_archive(in, out);
  EXPECT_EQ(report.cells, 4u);
  EXPECT_EQ(report.cells_before, 5u);
  ArchiveReader reader(std::make_unique<MemoryFile>(out.bytes()));
  EXPECT_EQ(reader.pose_graph().constraints.size(), 2u) << "of four, two ended at the lost CELL";
  EXPECT_FALSE(reader.scans().contains(victim.entries[2].cell));
  EXPECT_EQ(reader.pose_graph().revision, 19u);
  EXPECT_EQ(reader.footer().bound_m, 0.02);
  EXPECT_EQ(reader.footer().sections.size(), 3u) << "nothing superseded is left";
}

}  // namespace
}  // namespace cellmap
