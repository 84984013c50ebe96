#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/store/read_cell.hpp"
#include "cellmap/store/sql_schema.hpp"
#include "cellmap/store/sqlite_connection.hpp"
#include "cellmap/store/sqlite_schema.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::test {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> texts(SqliteConnection& connection, const std::string& sql) {
  std::vector<std::string> rows;
  for (Query query(connection, sql); query.next();) rows.push_back(query.text(0));
  return rows;
}

std::string joined(const std::vector<std::string>& words) {
  std::string all;
  for (const std::string& word : words) all += (all.empty() ? "" : ", ") + word;
  return all;
}

/// A store of an earlier version: its tables by the published steps of the schema, its rows those
/// of the recorded store (a build of version 4 wrote it), as far as the version has tables and
/// columns for them.
void make_store(const fs::path& file, int version, const fs::path& recorded) {
  SqliteConnection connection(file, SqliteAccess::kReadWrite, 1000);
  for (int step = 0; step < version; ++step) connection.execute(sql_schema_steps()[step]);
  connection.execute(("PRAGMA application_id = " + std::to_string(kSqliteApplicationId) +
                      "; PRAGMA user_version = " + std::to_string(version) + "; ATTACH '" +
                      recorded.string() + "' AS recorded; PRAGMA foreign_keys = OFF")
                         .c_str());
  const std::string names = "SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name";
  for (const std::string& table : texts(connection, names)) {
    const auto columns = texts(connection, "SELECT name FROM pragma_table_info('" + table +
                                               "') INTERSECT SELECT name "
                                               "FROM pragma_table_info('" +
                                               table + "', 'recorded')");
    if (columns.empty()) continue;
    const std::string list = joined(columns);
    connection.execute(
        ("INSERT INTO main." + table + " (" + list + ") SELECT " + list + " FROM recorded." + table)
            .c_str());
  }
  connection.execute("DETACH recorded");
}

class SqliteUpgradeTest : public ::testing::TestWithParam<int> {
 protected:
  SqliteUpgradeTest() {
    std::ifstream dump(fs::path(CELLMAP_SOURCE_DIR) / "tests/store/data/schema4.sql");
    const std::string sql(std::istreambuf_iterator<char>(dump), {});
    SqliteConnection(recorded_, SqliteAccess::kReadWrite, 1000).execute(sql.c_str());
  }

  TempFolder folder_;
  const fs::path recorded_ = folder_ / "recorded.cellmap", file_ = folder_ / "store.cellmap";
};

TEST_P(SqliteUpgradeTest, AnEarlierStoreIsReadWrittenAndReadAgain) {
  make_store(file_, GetParam(), recorded_);
  const auto expect_all = [&](const Store& store) {
    const MapInfo info = store.map("town");
    EXPECT_EQ(info.cells, 6u);
    EXPECT_EQ(info.revision, 6u);
    const PoseGraph graph = store.pose_graph("town");
    EXPECT_EQ(graph.nodes.size(), 6u);
    EXPECT_EQ(graph.constraints.size(), 5u);
    EXPECT_NEAR(graph.nodes.at({5}).translation().x(), 17.63578, 1e-5);
    for (const auto& [id, T_map_cell] : graph.nodes) {
      EXPECT_EQ(encode_cell(read_cell(store, "town", id)).hash, store.cell("town", id).hash);
    }
  };
  {
    const auto store = open_sqlite_store(file_);
    expect_all(*store);
    EXPECT_EQ(store->pose_graph("town", 3).nodes.size(), 3u);
    store->create_map("new", {LatticeKind::kFibonacci, 1000}, {});
  }
  {
    SqliteConnection connection(file_, SqliteAccess::kReadOnly, 1000);
    EXPECT_EQ(connection.integer("PRAGMA user_version"), sqlite_schema_version());
    EXPECT_TRUE(texts(connection, "PRAGMA foreign_key_check").empty());
  }
  const auto again = open_sqlite_store(file_);
  expect_all(*again);
  EXPECT_EQ(again->map("new").cells, 0u);
}

INSTANTIATE_TEST_SUITE_P(FromVersion, SqliteUpgradeTest,
                         ::testing::Range(1, static_cast<int>(sqlite_schema_version())),
                         [](const auto& version) {
                           return "Version" + std::to_string(version.param);
                         });

}  // namespace
}  // namespace cellmap::test
