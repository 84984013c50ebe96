#include <gtest/gtest.h>

#include "cellmap/archive/archive_reader.hpp"
#include "cellmap/archive/repair_archive.hpp"
#include "cellmap/archive/store_archive.hpp"
#include "cellmap/archive/verify_archive.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/store/read_cell.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "codec/samples.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

// Archives of maps that keep their CELLs coded.

namespace cellmap::test {
namespace {

class KeptCellsInArchives : public testing::Test {
 protected:
  KeptCellsInArchives() : store_(open_sqlite_store(folder_ / "test.db")) {
    store_->create_map("town", {LatticeKind::kFibonacci, 1000});
  }

  void add(std::uint32_t id, const CellForm& form) {
    KeptCell kept = keep_cell(std::make_shared<const Cell>(random_cell(id, 200, 1000)), form);
    NewCell cell;
    cell.id = {id};
    cell.cell = kept.cell;
    cell.encoded = kept.encoded;
    cell.coded = kept.coded;
    MapUpdate update;
    update.cells.push_back(cell);
    store_->commit("town", update);
  }

  ArchiveOptions usual() const { return default_archive_options(store_->map("town")); }
  Bytes archive(const ArchiveOptions& options) const {
    MemoryFile file;
    archive_map(*store_, "town", file, options);
    return file.bytes();
  }
  Bytes kept_bytes(const std::string& map, std::uint32_t id) const {
    return zstd_decompress(*store_->stored_cell(map, {id}).frame, kMaxCellBytes);
  }
  static ArchiveReader reader_of(const Bytes& bytes) {
    return ArchiveReader(std::make_unique<MemoryFile>(bytes));
  }

  TempFolder folder_;
  std::unique_ptr<Store> store_;
};

TEST_F(KeptCellsInArchives, CompactCellsAreCopiedIntoTheArchiveAndBack) {
  for (const std::uint32_t id : {1u, 2u, 3u}) add(id, compact_form(0.02));
  EXPECT_EQ(usual().encoding, ArchiveEncoding::kCompact);
  EXPECT_EQ(usual().bound_m, 0.02);
  const Bytes bytes = archive(usual());
  ArchiveReader reader = reader_of(bytes);
  for (const std::uint32_t id : {1u, 2u, 3u}) {
    EXPECT_EQ(reader.cell({id}).coded, kept_bytes("town", id));
    EXPECT_EQ(reader.cells()[id - 1].hash, store_->keeping("town")[id - 1].source);
  }
  EXPECT_EQ(restore_map(reader, *store_, "again").form, compact_form(0.02));
  for (const std::uint32_t id : {1u, 2u, 3u}) {
    EXPECT_EQ(kept_bytes("again", id), kept_bytes("town", id));
    EXPECT_EQ(store_->cell("again", {id}).hash, store_->cell("town", {id}).hash);
  }
  MemoryFile file(bytes);
  EXPECT_TRUE(verify_archive(file, {}).damage.empty());
}

TEST_F(KeptCellsInArchives, APackedCellIsCopiedIntoAPackedArchive) {
  add(1, {KeptEncoding::kPacked, 0});
  EXPECT_EQ(usual().encoding, ArchiveEncoding::kPacked);
  EXPECT_EQ(reader_of(archive(usual())).cell({1}).coded, kept_bytes("town", 1));
  const ArchiveCell raw = reader_of(archive({.encoding = ArchiveEncoding::kRaw})).cell({1});
  EXPECT_EQ(encode_cell(raw.cell).hash, store_->cell("town", {1}).hash);
}

TEST_F(KeptCellsInArchives, CompactCellsAreNeverCodedAgainNorPassedOffAsExact) {
  add(1, compact_form(0.02));
  for (const ArchiveOptions& options :
       {ArchiveOptions{.encoding = ArchiveEncoding::kRaw},
        ArchiveOptions{.encoding = ArchiveEncoding::kPacked},
        ArchiveOptions{.encoding = ArchiveEncoding::kCompact, .bound_m = 0.01}}) {
    expect_error(
        ErrorCode::kConflict, [&] { archive(options); }, "compact 20 mm");
  }
}

TEST_F(KeptCellsInArchives, SeveralBoundsAreArchivedWithinTheWidest) {
  add(1, compact_form(0.005));
  add(2, compact_form(0.03));
  add(3, {});
  EXPECT_EQ(usual().bound_m, 0.03);
  const Bytes bytes = archive(usual());
  ArchiveReader reader = reader_of(bytes);
  EXPECT_EQ(reader.cell({1}).coded, kept_bytes("town", 1));
  EXPECT_EQ(reader.cell({1}).bound_m, 0.005);
  EXPECT_EQ(reader.cell({2}).bound_m, 0.03);
  EXPECT_EQ(reader.cell({3}).bound_m, 0.03);
  MemoryFile file(bytes);
  EXPECT_TRUE(verify_archive(file, {}).damage.empty());
  MemoryFile repaired;
  EXPECT_EQ(repair_archive(file, repaired).cells, 3u);
  EXPECT_EQ(reader_of(repaired.bytes()).footer().bound_m, 0.03);
}

}  // namespace
}  // namespace cellmap::test
