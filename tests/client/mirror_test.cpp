#include "cellmap/client/mirror.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "cellmap/client/json.hpp"
#include "cellmap/codec/cell_batch.hpp"
#include "client/fake_server.hpp"
#include "codec/samples.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

using client::Json;
using test::answer_json;

/// A map that a test grows, behind the three routes that a pull uses.
struct FakeMap {
  struct Entry {
    EncodedCell cell;
    CellRecord record;
  };
  Stamp created = 1'795'319'109'125'000'000;
  Revision revision = 0;
  std::map<CellId, Entry> cells;
  std::vector<std::pair<Revision, Constraint>> constraints;
  std::vector<std::vector<std::uint32_t>> batches;  ///< ids of each batch that was asked for

  void add(std::uint32_t id) {
    ++revision;
    const Cell cell = random_cell(id, 40, 1000);
    Entry entry{encode_cell(cell), {}};
    entry.record.id = CellId{id};
    entry.record.hash = entry.cell.hash;
    entry.record.added = entry.record.moved = revision;
    entry.record.session = cell.session;
    cells[CellId{id}] = std::move(entry);
    if (!cells.contains(CellId{id - 1})) return;
    Constraint constraint;
    constraint.id = ConstraintId{id};
    constraint.from = CellId{id - 1};
    constraint.to = CellId{id};
    constraints.emplace_back(revision, constraint);
  }

  void move(std::uint32_t id, double x) {
    CellRecord& record = cells.at(CellId{id}).record;
    record.T_map_cell.translation().x() = x;
    record.moved = ++revision;
  }

  std::string summary() const {
    MapInfo info;
    info.name = "m";
    info.created = created;
    info.revision = revision;
    info.cells = cells.size();
    return client::dump(client::to_json(info));
  }

  std::string changes(Revision since) const {
    Json json = {{"since", since}, {"revision", revision}};
    json["added"] = json["moved"] = json["removed"] = json["removed_constraints"] = Json::array();
    json["added_constraints"] = Json::array();
    for (const auto& [id, entry] : cells) {
      const CellRecord& record = entry.record;
      if (record.added > since) {
        json["added"].push_back(client::to_json(record));
      } else if (record.moved > since) {
        json["moved"].push_back({{"id", id.value}, {"pose", client::to_json(record.T_map_cell)}});
      }
    }
    for (const auto& [added, constraint] : constraints) {
      if (added > since) json["added_constraints"].push_back(client::to_json(constraint));
    }
    return client::dump(json);
  }

  std::string batch(const std::string& request) {
    Bytes bytes;
    batches.emplace_back();
    const Json wanted = client::parse_json(request);
    for (const Json& id : wanted.at("ids")) {
      batches.back().push_back(id);
      append_to_batch(bytes, CellId{id}, cells.at(CellId{id}).cell.bytes);
    }
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  }

  test::FakeServer server{[this](const httplib::Request& request, httplib::Response& response) {
    if (request.path.ends_with("/changes")) {
      answer_json(response, changes(std::stoull(request.get_param_value("since"))));
    } else if (request.path.ends_with("/cells:batch")) {
      response.set_header("CELLmap-Revision", std::to_string(revision));
      response.set_content(batch(request.body), "application/vnd.cellmap.cells");
    } else {
      answer_json(response, summary());
    }
  }};
};

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

TEST(Mirror, AFolderWithoutOneSaysHowToMakeIt) {
  const test::TempFolder folder;
  test::expect_error(
      ErrorCode::kNotFound, [&] { read_mirror(folder.path()); }, "cellmap pull");
}

}  // namespace
}  // namespace cellmap
