#include "client/cli/command_line.hpp"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "client/cli/exit_code.hpp"
#include "client/cli/map_text.hpp"
#include "client/fake_server.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::cli {
namespace {

using testing::HasSubstr;

struct Outcome {
  int exit_code = 0;
  std::string out, err;
};

Outcome run(const std::vector<std::string>& arguments) {
  std::ostringstream out, err;
  const int code = run_command_line(arguments, out, err);
  return {code, out.str(), err.str()};
}

TEST(ExitCodes, AreDistinctNeitherSuccessNorUsageAndDocumented) {
  std::set<int> codes;
  const std::string help = exit_code_help();
  for (int i = 0; i <= static_cast<int>(ErrorCode::kDiskFull); ++i) {
    const auto code = static_cast<ErrorCode>(i);
    EXPECT_TRUE(codes.insert(exit_code(code)).second) << to_string(code);
    EXPECT_NE(exit_code(code), kSuccess);
    EXPECT_NE(exit_code(code), kUsageError);
    EXPECT_THAT(help, HasSubstr(std::to_string(exit_code(code))));
    EXPECT_THAT(help, HasSubstr(std::string(to_string(code)) + ":"));
  }
}

TEST(CommandLine, VersionAndHelpAreSuccess) {
  EXPECT_THAT(run({"--version"}).out, HasSubstr("cellmap 0."));
  const Outcome help = run({"--help"});
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_THAT(help.out, HasSubstr("Exit codes"));
}

TEST(CommandLine, EveryVerbHasHelpWithExamplesAndJson) {
  const std::vector<std::vector<std::string>> verbs = {{"simulate"},
                                                       {"build"},
                                                       {"import"},
                                                       {"serve"},
                                                       {"ingest"},
                                                       {"maps"},
                                                       {"maps", "create"},
                                                       {"maps", "delete"},
                                                       {"info"},
                                                       {"cells"},
                                                       {"fetch"},
                                                       {"pull"},
                                                       {"loops", "list"},
                                                       {"loops", "add"},
                                                       {"loops", "detect"},
                                                       {"loops", "delete"},
                                                       {"jobs", "list"},
                                                       {"jobs", "show"},
                                                       {"jobs", "follow"},
                                                       {"jobs", "cancel"},
                                                       {"relocalise"},
                                                       {"evaluate", "trajectory"},
                                                       {"evaluate", "relocalisation"},
                                                       {"evaluate", "diff"},
                                                       {"diff"},
                                                       {"archive"},
                                                       {"restore"},
                                                       {"verify"},
                                                       {"repair"},
                                                       {"export", "cloud"},
                                                       {"export", "trajectory"},
                                                       {"export", "graph"}};
  for (auto verb : verbs) {
    verb.push_back("--help");
    const Outcome outcome = run(verb);
    EXPECT_EQ(outcome.exit_code, 0) << verb.front();
    EXPECT_THAT(outcome.out, HasSubstr("Examples:\n  cellmap " + verb.front()));
    EXPECT_THAT(outcome.out, HasSubstr("--json"));
  }
}

struct Wrong {
  std::vector<std::string> arguments;
  int exit_code;
  std::string says;
};

class WrongArguments : public testing::TestWithParam<Wrong> {};

TEST_P(WrongArguments, SayWhatToDoAndHaveTheirExitCode) {
  const Outcome outcome = run(GetParam().arguments);
  EXPECT_EQ(outcome.exit_code, GetParam().exit_code) << outcome.err;
  EXPECT_THAT(outcome.out + outcome.err, HasSubstr(GetParam().says));
}

const int kInvalid = exit_code(ErrorCode::kInvalidArgument);

INSTANTIATE_TEST_SUITE_P(
    CommandLine, WrongArguments,
    testing::Values(
        Wrong{{}, kUsageError, "subcommand"}, Wrong{{"frobnicate"}, kUsageError, "frobnicate"},
        Wrong{{"info"}, kUsageError, "MAP"}, Wrong{{"loops"}, kUsageError, "subcommand"},
        Wrong{{"info", "m", "--no-such-flag"}, kUsageError, "--no-such-flag"},
        Wrong{{"simulate", "--scans", "many", "--out", "x"}, kUsageError, "--scans"},
        Wrong{{"ingest", "d", "--map", "m", "--fit", "guess"}, kUsageError, "trimmed"},
        Wrong{{"build", "d", "--map", "m", "--loop-acceptance", "all"}, kUsageError, "scores"},
        Wrong{{"ingest", "d", "--map", "m", "--cells", "--no-loops"},
              kUsageError,
              "--no-loops: has no effect with --cells"},
        Wrong{{"ingest", "d", "--map", "m", "--loop-acceptance", "paper", "--cells"},
              kUsageError,
              "--loop-acceptance: has no effect with --cells"},
        Wrong{{"ingest", "d", "--map", "m", "--no-bidirectional", "--cells"},
              kUsageError,
              "send the scans"},
        Wrong{{"info", "m"},
              kInvalid,
              "--server http://HOST:PORT, --store FILE, --mirror DIR or --archive FILE"},
        Wrong{{"fetch", "m", "1"}, kInvalid, "CELLMAP_SERVER"},
        Wrong{{"info", "m", "--server", "ftp://x"}, kInvalid, "http://HOST:PORT"},
        Wrong{{"info", "m", "--store", "/no/such.db"},
              exit_code(ErrorCode::kNotFound),
              "cellmap build"},
        Wrong{{"cells", "m", "--server", "h:1", "--near", "1,2"}, kInvalid, "--radius"},
        Wrong{{"cells", "m", "--server", "h:1", "--near", "1,2", "--radius", "3"},
              kInvalid,
              "the 3 numbers \"x,y,z\""},
        Wrong{{"cells", "m", "--server", "h:1", "--bbox", "0,0,0,1,1,nan"}, kInvalid, "--bbox"},
        Wrong{{"loops", "add", "m", "--from", "1", "--to", "2", "--pose", "1 2 3"},
              kInvalid,
              "x y z qx qy qz qw"},
        Wrong{{"loops", "add", "m", "--from", "1", "--to", "2", "--pose", "0 0 0 0 0 0 5"},
              kInvalid,
              "--pose"},
        Wrong{{"loops", "add", "m", "--from", "1", "--to", "2", "--pose", "0 0 0 0 0 0 1",
               "--sigma-m", "1"},
              kInvalid,
              "--sigma-deg"},
        Wrong{{"relocalise", "scan.txt", "--map", "m", "--server", "h:1"},
              exit_code(ErrorCode::kUnsupported),
              ".bin (KITTI)"},
        Wrong{{"relocalise", "s.bin", "--map", "m", "--server", "h:1", "--radius", "3"},
              kUsageError,
              "--prior"},
        Wrong{{"diff", "m", "--server", "h:1", "--sessions", "a"}, kInvalid, "monday,tuesday"},
        Wrong{{"diff", "m", "--server", "h:1", "--sessions", "a,b", "--radius", "3"},
              kInvalid,
              "--near"},
        Wrong{{"export", "cloud", "--server", "h:1", "--map", "m", "--out", "x.obj"},
              kInvalid,
              ".ply or .pcd"}));

TEST(CommandLine, WithJsonAnErrorIsADocumentToo) {
  const Outcome outcome = run({"info", "m", "--json"});
  EXPECT_EQ(client::parse_json(outcome.out).at("error").at("code"), "invalid-argument");
  EXPECT_THAT(outcome.err, HasSubstr("--store FILE"));
}

TEST(CommandLine, TheServersProblemIsTheExitCodeAndTheMessage) {
  test::FakeServer server([](const httplib::Request&, httplib::Response& response) {
    test::answer_problem(response, 404, "not-found", "There is no map 'm'.");
  });
  const Outcome outcome = run({"info", "m", "--server", server.url()});
  EXPECT_EQ(outcome.exit_code, exit_code(ErrorCode::kNotFound));
  EXPECT_EQ(outcome.err, "cellmap: There is no map 'm'.\n");
}

TEST(CommandLine, EvaluatesATrajectoryAgainstItselfAsPerfect) {
  const test::TempFolder folder;
  std::string rows;
  for (int i = 0; i < 150; ++i) rows += "1 0 0 " + std::to_string(i) + " 0 1 0 0 0 0 1 0\n";
  const std::string file = folder.write("poses.txt", rows).string();
  const Outcome outcome =
      run({"evaluate", "trajectory", "--estimate", file, "--truth", file, "--json"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  const auto json = client::parse_json(outcome.out);
  EXPECT_NEAR(json.at("t_rel_percent").get<double>(), 0, 1e-9);
  EXPECT_NEAR(json.at("r_rel_deg_per_100m").get<double>(), 0, 1e-6);
  EXPECT_NEAR(json.at("ape_rmse_m").get<double>(), 0, 1e-9);
  EXPECT_EQ(json.at("poses"), 150);
}

TEST(Progress, ALineHasItsBarCountsAndTimeLeft) {
  EXPECT_EQ(progress_line("ingest", 60, 120, "12 CELLs", 68.4),
            "ingest [###############               ]  50 % 60/120, 12 CELLs, 1:08 left");
  EXPECT_EQ(progress_line("pull", 3, 0, "", {}), "pull 3");
}

TEST(MapText, ComparesBytesPerPoint) {
  MapInfo map;
  map.name = "m";
  map.cells = 4;
  map.planes = 20'000;
  map.stored_bytes = 400'000;
  map.encoded_bytes = 500'000;
  map.raw_points = 1'000'000;
  map.voxel_points = 50'000;
  const std::string text = map_text(map);
  EXPECT_THAT(text, HasSubstr("400.0 kB, 100.0 kB a CELL"));
  EXPECT_THAT(text, HasSubstr("1,000,000 points, 16.0 MB: 40 times"));
  EXPECT_THAT(text, HasSubstr("50,000 points, 600.0 kB: 1.5 times"));
}

}  // namespace
}  // namespace cellmap::cli
