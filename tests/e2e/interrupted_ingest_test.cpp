#include <gmock/gmock.h>

#include <thread>

#include "e2e/cellmapd_process.hpp"
#include "e2e/drive.hpp"

namespace cellmap::test {
namespace {

using testing::HasSubstr;

constexpr int kScans = 90;

/// Ctrl-C in the middle of a drive, while CELLs are sent and while scans are: the same command
/// again makes the same map.
class InterruptedIngest : public testing::TestWithParam<bool> {
 protected:
  static void SetUpTestSuite() {
    work_ = std::make_unique<TempFolder>();
    auto simulate = simulate_arguments((*work_ / "drive").string(), kScans);
    simulate.insert(simulate.end(), {"--odometry", "truth"});
    cellmap_json(*work_, simulate);
    server_ = std::make_unique<CellmapdProcess>(*work_ / "map.db");
  }
  static void TearDownTestSuite() {
    server_.reset();
    work_.reset();
  }

  static std::vector<std::string> ingest(const std::string& map) {
    std::vector<std::string> arguments = {
        "ingest", (*work_ / "drive").string(), "--server", server_->url(), "--map", map};
    if (GetParam()) arguments.push_back("--cells");
    return arguments;
  }

  /// Hash and pose of each CELL.
  static nlohmann::json content(const std::string& map) {
    nlohmann::json content;
    const auto page = cellmap_json(*work_, {"cells", map, "--server", server_->url()});
    for (const auto& cell : page["cells"]) {
      content.push_back({cell["sequence"], cell["hash"], cell["pose"]});
    }
    return content;
  }

  /// Returns when the map has this many CELLs.
  static void wait_for_cells(const std::string& map, std::uint64_t cells) {
    Client client = server_->client();
    for (;; std::this_thread::sleep_for(std::chrono::milliseconds(2))) {
      try {
        if (client.map(map).cells >= cells) return;
      } catch (const Error& error) {
        ASSERT_EQ(error.code(), ErrorCode::kNotFound) << error.what();  // not made yet
      }
    }
  }

  static inline std::unique_ptr<TempFolder> work_;
  static inline std::unique_ptr<CellmapdProcess> server_;
};

TEST_P(InterruptedIngest, SaysHowToGoOnAndTheMapIsTheSameThen) {
  const std::string map = GetParam() ? "of-cells" : "of-scans";
  std::vector<std::string> command = ingest(map);
  command.insert(command.begin(), CELLMAP_PROGRAM);
  command.push_back("--json");
  Process sending(command, *work_ / "sending.log");
  wait_for_cells(map, 3);
  ::kill(sending.pid(), SIGINT);
  const Ended interrupted = sending.wait();
  ASSERT_EQ(interrupted.exit_code, 130) << "it ended before the signal came: " << interrupted.out;
  const auto error = nlohmann::json::parse(interrupted.out)["error"];
  EXPECT_EQ(error["code"], "cancelled");
  EXPECT_THAT(error["message"].get<std::string>(), HasSubstr("run the same command again"));

  const auto before = content(map);
  EXPECT_GE(before.size(), 3u);
  cellmap_json(*work_, ingest(map));
  cellmap_json(*work_, ingest(map + "-undisturbed"));
  const auto undisturbed = content(map + "-undisturbed");
  EXPECT_LT(before.size(), undisturbed.size()) << "the signal came too late to prove anything";
  EXPECT_EQ(content(map), undisturbed);
}

INSTANTIATE_TEST_SUITE_P(OfCellsAndOfScans, InterruptedIngest, testing::Bool(),
                         [](const auto& info) { return info.param ? "Cells" : "Scans"; });

}  // namespace
}  // namespace cellmap::test
