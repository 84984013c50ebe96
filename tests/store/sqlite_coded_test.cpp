#include <gtest/gtest.h>

#include <fstream>
#include <iterator>

#include "cellmap/codec/plane_displacement.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/store/convert_cells.hpp"
#include "cellmap/store/read_cell.hpp"
#include "cellmap/store/sqlite_connection.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "codec/samples.hpp"
#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

namespace fs = std::filesystem;

class SqliteCodedTest : public ::testing::Test {
 protected:
  /// A map "town" with one compact CELL of 200 planes.
  void make_store() {
    const auto store = open_sqlite_store(file_);
    store->create_map("town", {LatticeKind::kFibonacci, 1000}, compact_form(0.02));
    KeptCell kept =
        keep_cell(std::make_shared<const Cell>(random_cell(1, 200, 1000)), compact_form(0.02));
    NewCell cell;
    cell.id = {1};
    cell.cell = kept.cell;
    cell.encoded = kept.encoded;
    cell.coded = kept.coded;
    store->commit("town", adding({cell}));
  }

  template <typename... Values>
  void run_sql(const std::string& sql, const Values&... values) {
    SqliteConnection connection(file_, SqliteAccess::kReadWrite, 1000);
    Query(connection, sql, values...).run();
  }

  /// A version or a lattice that was flipped is one that is not known.
  template <typename Read>
  static void expect_damaged(const Read& read) {
    try {
      read();
      FAIL() << "what is damaged was read";
    } catch (const Error& error) {
      EXPECT_TRUE(error.code() == ErrorCode::kCorruptData ||
                  error.code() == ErrorCode::kUnsupported || error.code() == ErrorCode::kTooLarge)
          << error.what();
    }
  }

  TempFolder folder_;
  const fs::path file_ = folder_ / "test.cellmap";
};

TEST_F(SqliteCodedTest, AStoreOfVersion4IsReadAndConvertedWithItsHashesAndHistory) {
  {
    SqliteConnection connection(file_, SqliteAccess::kReadWrite, 1000);
    std::ifstream dump(fs::path(CELLMAP_SOURCE_DIR) / "tests/store/data/schema4.sql");
    const std::string sql(std::istreambuf_iterator<char>(dump), {});
    ASSERT_GT(sql.size(), 10'000u);
    connection.execute(sql.c_str());
  }
  const auto store = open_sqlite_store(file_);
  const MapInfo info = store->map("town");
  EXPECT_EQ(info.cells, 6u);
  EXPECT_EQ(info.form, CellForm{});
  EXPECT_EQ(info.kept, (std::map<CellForm, std::uint64_t>{{CellForm{}, 6}}));
  const CellRecord first = store->cell("town", {1});
  EXPECT_EQ(to_hex(first.hash), "7856776b11fc3d278559515f9a620529f60bcd606807f182251841a2e449830b");
  const Cell source = read_cell(*store, "town", {1});
  EXPECT_EQ(encode_cell(source).hash, first.hash);
  EXPECT_EQ(store->keeping("town")[0].source, first.hash);
  EXPECT_EQ(store->pose_graph("town", 3).nodes.size(), 3u);
  convert_cells(*store, "town", compact_form(0.02));
  EXPECT_LE(cell_displacement(source, read_cell(*store, "town", {1})).worst_m, 0.02);
  EXPECT_EQ(store->keeping("town")[0].source, first.hash);
  EXPECT_LT(store->map("town").stored_bytes, info.stored_bytes / 4);
  EXPECT_EQ(store->changes("town", info.revision).added.size(), 6u);
}

TEST_F(SqliteCodedTest, EveryFlippedBitOfAKeptCellIsReported) {
  make_store();
  Bytes frame = *open_sqlite_store(file_)->stored_cell("town", {1}).frame;
  for (std::size_t i = 0; i < frame.size(); i += 7) {
    Bytes damaged = frame;
    damaged[i] ^= std::byte{1} << (i % 8);
    run_sql("UPDATE blob SET frame = ?", damaged);
    const auto store = open_sqlite_store(file_);
    expect_error(
        ErrorCode::kCorruptData, [&] { read_cell(*store, "town", {1}); }, "damaged");
  }
}

TEST_F(SqliteCodedTest, BytesWhoseChecksumWasMadeToFitAreHeldToTheirOwnHashesAndTheCells) {
  make_store();
  const Bytes good =
      zstd_decompress(*open_sqlite_store(file_)->stored_cell("town", {1}).frame, kMaxCellBytes);
  const auto expect_refused = [&](const Bytes& bytes) {
    const Bytes frame = zstd_compress(bytes);
    const ContentHash sum = sha256(frame);
    const auto raw = std::as_bytes(std::span(sum.bytes));
    run_sql("UPDATE blob SET frame = ?, checksum = ?", frame, Bytes(raw.begin(), raw.end()));
    const auto store = open_sqlite_store(file_);
    expect_damaged([&] { read_cell(*store, "town", {1}); });
    expect_damaged([&] { store->compressed_cell("town", {1}); });
  };
  for (std::size_t i = 0; i < good.size(); i += 23) {
    Bytes damaged = good;
    damaged[i] ^= std::byte{0x10};
    // An alignment or an identifier may be what it was; a hash never is.
    if (damaged != good) expect_refused(damaged);
  }
  for (const std::size_t kept : {std::size_t{0}, std::size_t{7}, good.size() / 2}) {
    expect_refused(Bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(kept)));
  }
  // A CELL in order, but not this one.
  const Cell other = random_cell(2, 200, 1000);
  expect_refused(encode_cell(other).bytes);
  expect_refused(
      keep_cell(std::make_shared<const Cell>(other), compact_form(0.02)).coded->content.bytes);
}

TEST_F(SqliteCodedTest, AFormThatNoProgramWroteIsReported) {
  make_store();
  for (const char* damage :
       {"UPDATE cell SET encoding = 7", "UPDATE cell SET encoding = 3, bound_um = 5",
        "UPDATE cell SET encoding = 1, bound_um = 20000"}) {
    run_sql(damage);
    const auto store = open_sqlite_store(file_);
    expect_error(
        ErrorCode::kCorruptData, [&] { read_cell(*store, "town", {1}); }, "damaged");
    expect_error(ErrorCode::kCorruptData, [&] { store->map("town"); });
  }
}

}  // namespace
}  // namespace cellmap::test
