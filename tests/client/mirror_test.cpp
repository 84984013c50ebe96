#include "cellmap/client/mirror.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "cellmap/client/files.hpp"
#include "cellmap/client/json.hpp"
#include "cellmap/client/pull.hpp"
#include "client/fake_map.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

using client::Json;
using test::FakeMap;

class Pull : public testing::Test {
 protected:
  PullReport pull() {
    Client client(test::options_for(map.server));
    return pull_map(client, "m", folder / "mirror");
  }
  std::filesystem::path cell_file(std::uint32_t id) const {
    return folder / "mirror" / "cells" / (to_hex(map.cells.at(CellId{id}).cell.hash) + ".cell");
  }

  FakeMap map;
  test::TempFolder folder;
};

TEST_F(Pull, MirrorsCellsPosesAndConstraints) {
  for (std::uint32_t id = 0; id < 70; ++id) map.add(id);  // more than one batch
  map.move(3, 12.5);
  const PullReport report = pull();
  EXPECT_EQ(report.fetched, 70u);
  EXPECT_EQ(report.to, map.revision);
  const Mirror mirror = read_mirror(folder / "mirror");
  EXPECT_EQ(mirror.revision, map.revision);
  EXPECT_EQ(mirror.cells.size(), 70u);
  EXPECT_EQ(mirror.pose_graph.nodes.at(CellId{3}).translation().x(), 12.5);
  EXPECT_EQ(mirror.pose_graph.constraints.size(), 69u);
  for (const auto& [id, entry] : map.cells) {
    std::ifstream stream(cell_file(id.value), std::ios::binary);
    const std::string text{std::istreambuf_iterator<char>(stream), {}};
    EXPECT_EQ(verified_hash(std::as_bytes(std::span(text))), entry.cell.hash);
  }
}

TEST_F(Pull, TheSecondOneFetchesOnlyWhatChanged) {
  for (std::uint32_t id = 0; id < 5; ++id) map.add(id);
  pull();
  map.batches.clear();
  EXPECT_EQ(pull().fetched, 0u);
  EXPECT_TRUE(map.batches.empty());

  map.add(5);
  map.move(1, 7);
  const PullReport report = pull();
  EXPECT_EQ(map.batches, (std::vector<std::vector<std::uint32_t>>{{5}}));
  EXPECT_EQ(report.moved, 1u);
  const Mirror mirror = read_mirror(folder / "mirror");
  EXPECT_EQ(mirror.cells.size(), 6u);
  EXPECT_EQ(mirror.pose_graph.nodes.at(CellId{1}).translation().x(), 7);
}

TEST_F(Pull, ALostFileIsFetchedAgain) {
  for (std::uint32_t id = 0; id < 3; ++id) map.add(id);
  pull();
  map.batches.clear();
  std::filesystem::remove(cell_file(1));
  EXPECT_EQ(pull().fetched, 1u);
  EXPECT_EQ(map.batches, (std::vector<std::vector<std::uint32_t>>{{1}}));
}

TEST_F(Pull, StartsOverWhereTheMapWasMadeAnew) {
  for (std::uint32_t id = 0; id < 3; ++id) map.add(id);
  pull();
  const auto old_file = cell_file(2);
  map.cells.clear();
  map.constraints.clear();
  map.revision = 0;
  map.created += 1'000'000'000;
  for (std::uint32_t id = 10; id < 14; ++id) map.add(id);
  const PullReport report = pull();
  EXPECT_TRUE(report.started_over);
  EXPECT_EQ(read_mirror(folder / "mirror").cells.size(), 4u);
  EXPECT_FALSE(std::filesystem::exists(old_file));
}

TEST_F(Pull, RefusesAFolderOfAnotherMap) {
  map.add(0);
  pull();
  FakeMap other;
  Client client(test::options_for(other.server));
  test::expect_error(
      ErrorCode::kConflict, [&] { pull_map(client, "m", folder / "mirror"); }, "another folder");
}

TEST_F(Pull, ABrokenOffOneLeavesTheMirrorAsItWas) {
  map.add(0);
  pull();
  map.add(1);
  map.cells.at(CellId{1}).cell.bytes.resize(50);  // what the server sends fails its hash
  EXPECT_THROW(pull(), Error);
  EXPECT_EQ(read_mirror(folder / "mirror").revision, 1u);
}

TEST_F(Pull, PosesKeepTheirLastBits) {
  map.add(0);
  map.cells.at(CellId{0}).record.T_map_cell = exp((Tangent() << 1, 2, 3, 0.1, 0.2, 0.3).finished());
  pull();
  const Mirror mirror = read_mirror(folder / "mirror");
  EXPECT_EQ(mirror.cells.at(CellId{0}).T_map_cell.matrix(),
            mirror.pose_graph.nodes.at(CellId{0}).matrix());
}

TEST_F(Pull, ASecondProcessIsKeptOut) {
  map.add(0);
  pull();
  Client client(test::options_for(map.server));
  PullOptions options;
  options.on_cell = [&](std::size_t, std::size_t) {
    test::expect_error(
        ErrorCode::kConflict, [&] { pull(); }, "another process");
  };
  map.add(1);
  EXPECT_EQ(pull_map(client, "m", folder / "mirror", options).fetched, 1u);
}

TEST_F(Pull, WhatADeadProcessLeftIsRemoved) {
  map.add(0);
  pull();
  const auto left = folder / "mirror" / "cells" / "abc.cell.tmp1-2";
  std::ofstream(left) << "half";
  pull();
  EXPECT_FALSE(std::filesystem::exists(left));
}

TEST_F(Pull, ADamagedCellIsNamedWithWhatToDo) {
  map.add(0);
  pull();
  const ContentHash hash = map.cells.at(CellId{0}).cell.hash;
  EXPECT_TRUE(read_mirrored_cell(folder / "mirror", hash));
  std::ofstream(cell_file(0), std::ios::in | std::ios::out).seekp(99) << "X";
  test::expect_error(
      ErrorCode::kCorruptData, [&] { read_mirrored_cell(folder / "mirror", hash); }, to_hex(hash),
      "pull again");
}

TEST_F(Pull, AStateOfAnotherVersionIsNotGuessedAt) {
  map.add(0);
  pull();
  const auto state = folder / "mirror" / "mirror.json";
  Json json = client::parse_json(client::as_text(*client::read_file(state, 1 << 20)));
  json["version"] = 3;
  client::write_file_atomically(state, client::dump(json));
  test::expect_error(
      ErrorCode::kUnsupported, [&] { read_mirror(folder / "mirror"); }, "version 2");
}

TEST(Mirror, AFolderWithoutOneSaysHowToMakeIt) {
  const test::TempFolder folder;
  test::expect_error(
      ErrorCode::kNotFound, [&] { read_mirror(folder.path()); }, "cellmap pull");
}

}  // namespace
}  // namespace cellmap
