#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "client/cli/command_line.hpp"

namespace cellmap::cli {
namespace {

client::Json evaluated(const std::string& threads) {
  std::ostringstream out, err;
  const int code =
      run_command_line({"evaluate", "diff", "--length", "40", "--lidar", "vlp16", "--lattice-size",
                        "8000", "--only", "same_lane", "--threads", threads, "--json"},
                       out, err);
  EXPECT_EQ(code, 0) << err.str();
  client::Json json = client::parse_json(out.str());
  json["scenarios"]["same_lane"].erase("pair_ms");
  return json;
}

TEST(EvaluateDiff, ScoresChangesAgainstTheSimulatorsTruthTheSameWayOnAnyNumberOfThreads) {
  const client::Json json = evaluated("1");
  EXPECT_EQ(json["simulated"], true);
  for (const char* const kind : {"vanished", "appeared"}) {
    const client::Json& score = json["scenarios"]["same_lane"][kind];
    EXPECT_GT(score["in_sight"], 20) << kind;
    EXPECT_GT(score["precision"], 0.8) << kind << ' ' << score;
    EXPECT_GT(score["recall"], 0.1) << kind << ' ' << score;
    std::size_t claimed = 0;
    for (const client::Json& bin : score["by_range"]) claimed += bin["claimed"].get<std::size_t>();
    EXPECT_EQ(claimed, score["claimed"]);
  }
  EXPECT_EQ(json, evaluated("2"));
}

}  // namespace
}  // namespace cellmap::cli
