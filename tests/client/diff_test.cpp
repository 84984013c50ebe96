#include "cellmap/client/diff.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "cellmap/client/diff_json.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/exit_code.hpp"
#include "client/fake_server.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"
#include "support/two_days.hpp"

namespace cellmap {
namespace {

using client::Json;
using test::kParkedCar;

Eigen::Vector3d point_of(const Json& json) {
  return {json[0].get<double>(), json[1].get<double>(), json[2].get<double>()};
}

constexpr char kAnswer[] = R"({"revision":7,"sessions":["monday","tuesday"],"pairs":4,
  "regions":[{"change":"vanished","centroid":[1,2,3],"min":[0,1,2],"max":[2,3,4],"patches":31,
              "area_m2":5.5,"cells":[1,2]}],
  "cells":[{"id":1,"session":"monday","stayed":900,"vanished":2,"appeared":0,"never_seen":11,
            "changed":[17,18]}],
  "time_ms":12.5})";

TEST(ClientDiff, AsksForTwoSessionsAndAPlace) {
  std::string asked;
  test::FakeServer server([&](const httplib::Request& request, httplib::Response& response) {
    asked = request.target;
    test::answer_json(response, kAnswer);
  });
  DiffRequest request{{"monday", "tuesday"}, Eigen::Vector3d(1.5, -2, 0), 100, true};
  const MapDiff diff = diff_sessions(test::options_for(server), "town", request);
  EXPECT_EQ(asked,
            "/v1/maps/town/diff?sessions=monday%2Ctuesday&near=1.5%2C-2.0%2C0.0&radius=100.0"
            "&patches=true");
  EXPECT_EQ(diff.revision, 7u);
  ASSERT_EQ(diff.regions.size(), 1u);
  EXPECT_EQ(diff.regions[0].change, PatchChange::kVanished);
  EXPECT_EQ(diff.regions[0].box.max(), Eigen::Vector3d(2, 3, 4));
  EXPECT_THAT(diff.regions[0].cells, testing::ElementsAre(CellId{1}, CellId{2}));
  ASSERT_EQ(diff.cells.size(), 1u);
  EXPECT_EQ(diff.cells[0].never_seen, 11u);
  EXPECT_THAT(diff.cells[0].changed, testing::ElementsAre(17, 18));
  EXPECT_EQ(client::to_json(diff, true), client::parse_json(kAnswer));
}

TEST(ClientDiff, PassesOnWhyTwoSessionsCannotBeCompared) {
  test::FakeServer server([](const httplib::Request&, httplib::Response& response) {
    test::answer_problem(response, 409, "conflict", "Session 'b' is not in the map frame yet");
  });
  test::expect_error(
      ErrorCode::kConflict,
      [&] {
        diff_sessions(test::options_for(server), "town", {{"a", "b"}, {}, 0, false});
      },
      "not in the map frame");
}

TEST(ClientDiff, AnAnswerThatLacksAnythingIsCorrupt) {
  const Json whole = client::parse_json(kAnswer);
  const auto refused = [](const Json& json) {
    test::expect_error(
        ErrorCode::kCorruptData, [&] { client::map_diff_from_json(json); }, "");
  };
  for (const auto& [key, value] : whole.items()) {
    Json part = whole;
    part.erase(key);
    refused(part);
    part[key] = "text";
    refused(part);
  }
  for (const char* const list : {"regions", "cells"}) {
    for (const auto& [key, value] : whole[list][0].items()) {
      Json part = whole;
      if (key != "changed") {
        part[list][0].erase(key);
        refused(part);
      }
      part[list][0][key] = nullptr;
      refused(part);
    }
  }
}

/// A store with the street of two days; the car is gone on Tuesday. Session "lost" is not aligned.
class DiffOfAStore : public testing::Test {
 protected:
  DiffOfAStore() {
    const auto store = open_sqlite_store(file());
    store->create_map("town", lattice_.spec());
    for (std::uint32_t i = 0; i < 2; ++i) {
      add(*store, i + 1, "monday", i, test::street_with({kParkedCar}), 6.0 * i);
      add(*store, i + 3, "tuesday", i, test::street(), 6.0 * i + 2);
    }
    add(*store, 9, "lost", 0, test::street(), 0);
  }

  std::string file() const { return (folder_.path() / "map.db").string(); }

  void add(Store& store, std::uint32_t id, const std::string& session, std::uint32_t sequence,
           const test::BoxScene& scene, double x) {
    const Pose T = test::level_pose(x, 0, 0);
    Cell cell = test::cell_seen(scene, T, lattice_, id);
    cell.session = session;
    cell.sequence = sequence;
    NewCell added;
    added.id = CellId{id};
    added.cell = std::make_shared<const Cell>(cell);
    added.encoded = encode_cell(cell);
    added.T_map_cell = T;
    added.unaligned = session == "lost";
    MapUpdate update;
    update.cells.push_back(std::move(added));
    store.commit("town", update);
  }

  int run(std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--store", file()});
    std::ostringstream out, err;
    const int code = cli::run_command_line(arguments, out, err);
    out_ = out.str();
    err_ = err.str();
    return code;
  }

  Lattice lattice_{{LatticeKind::kFibonacci, 6000}};
  test::TempFolder folder_;
  std::string out_, err_;
};

TEST_F(DiffOfAStore, ListsThePlacesThatChanged) {
  ASSERT_EQ(run({"diff", "town", "--sessions", "monday,tuesday"}), 0) << err_;
  EXPECT_THAT(out_, testing::StartsWith("vanished at "));
  EXPECT_THAT(out_, testing::HasSubstr("tuesday: 2 CELLs"));
  ASSERT_EQ(run({"diff", "town", "--sessions", "monday,tuesday", "--json"}), 0) << err_;
  const Json json = client::parse_json(out_);
  ASSERT_EQ(json["regions"].size(), 1u);
  const Json& at = json["regions"][0]["centroid"];
  EXPECT_TRUE(test::is_on(kParkedCar, point_of(at), 0.1)) << at;
}

TEST_F(DiffOfAStore, WritesChangedPatchesAsPoints) {
  const std::string ply = (folder_.path() / "changes.ply").string();
  ASSERT_EQ(run({"diff", "town", "--sessions", "monday,tuesday", "--ply", ply, "--json"}), 0)
      << err_;
  std::size_t changed = 0;
  const Json json = client::parse_json(out_);
  for (const Json& cell : json["cells"]) changed += cell["changed"].size();
  std::ifstream stream(ply);
  std::string line;
  std::size_t points = 0;
  while (std::getline(stream, line) && line != "end_header") {
    if (line.starts_with("element vertex ")) {
      EXPECT_EQ(std::stoul(line.substr(15)), changed);
    }
  }
  for (double x, y, z; stream >> x >> y >> z; ++points) {
    std::getline(stream, line);
    EXPECT_EQ(line, " 220 40 40");
    EXPECT_TRUE(test::is_on(kParkedCar, {x, y, z}, 0.2)) << x << ' ' << y << ' ' << z;
  }
  EXPECT_EQ(points, changed);
  EXPECT_GT(points, 10u);
}

TEST_F(DiffOfAStore, SaysWhatCannotBeCompared) {
  EXPECT_EQ(run({"diff", "town", "--sessions", "monday,lost"}),
            cli::exit_code(ErrorCode::kConflict));
  EXPECT_THAT(err_, testing::HasSubstr("cellmap loops add"));
  EXPECT_EQ(run({"diff", "town", "--sessions", "monday,friday"}),
            cli::exit_code(ErrorCode::kNotFound));
  EXPECT_EQ(run({"diff", "town", "--sessions", "monday,monday"}),
            cli::exit_code(ErrorCode::kInvalidArgument));
}

}  // namespace
}  // namespace cellmap
