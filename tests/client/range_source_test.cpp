#include "cellmap/client/range_source.hpp"

#include <gmock/gmock.h>

#include <atomic>
#include <mutex>
#include <nlohmann/json.hpp>
#include <sstream>

#include "cellmap/archive/archive_reader.hpp"
#include "cellmap/archive/update_archive.hpp"
#include "cellmap/client/archive.hpp"
#include "client/cli/command_line.hpp"
#include "client/fake_server.hpp"
#include "support/archive_sample.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

using test::ArchiveSample;
using test::expect_error;
using test::FakeServer;

/// A web server with one file, as plain as they come: Range, If-Match, and nothing of CELLmap's.
struct FileServer {
  std::mutex mutex;
  std::string body, etag;
  bool knows_ranges = true, knows_conditions = true;
  std::atomic<std::uint64_t> sent_bytes = 0;
  FakeServer http{[this](const httplib::Request& request, httplib::Response& response) {
    answer(request, response);
  }};

  FileServer(const Bytes& bytes, std::string tag) { replace(bytes, std::move(tag)); }

  void replace(const Bytes& bytes, std::string tag) {
    const std::lock_guard lock(mutex);
    body.assign(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    etag = std::move(tag);
  }

  void answer(const httplib::Request& request, httplib::Response& response) {
    const std::lock_guard lock(mutex);
    if (!etag.empty()) response.set_header("ETag", etag);
    const std::string condition = request.get_header_value("If-Match");
    if (knows_conditions && !condition.empty() && condition != etag) {
      response.status = 412;
      return;
    }
    if (!knows_ranges) {  // httplib answers ranges by itself
      const_cast<httplib::Request&>(request).ranges.clear();
    }
    response.set_content(body, "application/octet-stream");
    sent_bytes += request.has_header("Range") ? 0 : body.size();
  }

  std::unique_ptr<ByteSource> open() {
    return open_http_file(http.url() + "/maps/town.cellmap", test::options_for(http));
  }
};

TEST(HttpFile, ReadsPartsAndKnowsTheSize) {
  Bytes bytes(1000);
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = std::byte(i * 7);
  FileServer server(bytes, "\"one\"");
  const auto file = server.open();
  EXPECT_EQ(file->read(10, 20), Bytes(bytes.begin() + 10, bytes.begin() + 30));
  EXPECT_EQ(file->size(), 1000u);
  EXPECT_EQ(file->read(990, 100), Bytes(bytes.begin() + 990, bytes.end()));
  EXPECT_TRUE(file->read(1000, 5).empty());
  EXPECT_EQ(server.http.requests, 2);
}

TEST(HttpFile, AFileThatWasReplacedIsNoticedWhateverTheServerKnows) {
  for (const bool knows_conditions : {true, false}) {
    FileServer server(Bytes(1000), "\"one\"");
    server.knows_conditions = knows_conditions;
    const auto file = server.open();
    file->read(0, 10);
    server.replace(Bytes(1000, std::byte{1}), "\"two\"");
    expect_error(ErrorCode::kPreconditionFailed, [&] { file->read(0, 10); });
    file->restart();
    EXPECT_EQ(file->read(0, 1), Bytes{std::byte{1}});
  }
}

TEST(HttpFile, AServerWithoutRangesIsRefusedNotDownloaded) {
  FileServer server(Bytes(5'000'000), "\"one\"");
  server.knows_ranges = false;
  expect_error(
      ErrorCode::kUnsupported, [&] { server.open()->read(0, 10); }, "HTTP Range");
  const ClientOptions options;
  expect_error(
      ErrorCode::kInvalidArgument, [&] { open_http_file("http://host", options); }, "http://");
}

TEST(HttpFile, AnyCellIsOneRequestAfterTheFirstTwo) {
  const ArchiveSample sample(20);
  FileServer server(sample.bytes(), "\"one\"");
  ArchiveReader reader(server.open());
  reader.pose_graph();
  reader.cells();
  EXPECT_EQ(server.http.requests, 2);
  EXPECT_EQ(encode_cell(reader.cell(sample.ids[13]).cell).bytes,
            encode_cell(sample.cells[13]).bytes);
  EXPECT_EQ(server.http.requests, 3);
}

TEST(HttpFile, AReaderGoesOnWithTheNewFileAfterOne412) {
  const ArchiveSample sample(6);
  MemoryFile file(sample.bytes());
  FileServer server(file.bytes(), "\"one\"");
  ArchiveReader reader(server.open());
  EXPECT_EQ(reader.pose_graph().revision, 17u);
  PoseGraph graph = sample.contents.graph;
  graph.revision = 18;
  update_archive(file, graph);
  server.replace(file.bytes(), "\"two\"");
  const int before = server.http.requests;
  EXPECT_EQ(encode_cell(reader.cell(sample.ids[2]).cell).bytes, encode_cell(sample.cells[2]).bytes);
  EXPECT_EQ(server.http.requests, before + 3) << "412, the head anew, the CELL";
  EXPECT_EQ(reader.pose_graph().revision, 18u);
}

struct Outcome {
  int exit_code = 0;
  std::string out, err;
};
Outcome run(const std::vector<std::string>& arguments) {
  std::ostringstream out, err;
  const int code = cli::run_command_line(arguments, out, err);
  return {code, out.str(), err.str()};
}

TEST(ArchiveVerbs, ReadAnArchiveFromAFileAndFromAWebServer) {
  const test::TempFolder folder;
  const ArchiveSample sample(6);
  const Bytes bytes = sample.bytes();
  const std::string file =
      folder.write("town.cellmap", {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  FileServer server(bytes, "\"one\"");
  for (const std::string& place : {file, server.http.url() + "/town.cellmap"}) {
    const auto info = nlohmann::json::parse(run({"info", "--archive", place, "--json"}).out);
    EXPECT_EQ(info["name"], "town");
    EXPECT_EQ(info["cells"], 6);
    const auto cells =
        nlohmann::json::parse(run({"cells", "town", "--archive", place, "--json"}).out);
    ASSERT_EQ(cells["cells"].size(), 6u);
    EXPECT_EQ(cells["cells"][2]["hash"], to_hex(encode_cell(sample.cells[2]).hash));
    const std::string out = folder / "5.cell";
    const Outcome fetched = run({"fetch", "town", "5", "--archive", place, "--out", out});
    ASSERT_EQ(fetched.exit_code, 0) << fetched.err;
    const std::string poses = folder / "tum.txt";
    const Outcome exported = run({"export", "trajectory", "--map", "town", "--archive", place,
                                  "--session", "monday", "--stage", "odometry", "--out", poses});
    EXPECT_EQ(exported.exit_code, 0) << exported.err;
    EXPECT_EQ(run({"verify", place}).exit_code, 0);
    EXPECT_NE(run({"cells", "city", "--archive", place}).exit_code, 0);
  }
}

TEST(ArchiveVerbs, RestoreArchiveVerifyRepairAndCompare) {
  const test::TempFolder folder;
  const Bytes bytes = ArchiveSample(6).bytes();
  const std::string first =
      folder.write("first.cellmap", {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  const std::string store = folder / "map.db", second = folder / "second.cellmap";
  ASSERT_EQ(run({"restore", first, "--store", store}).exit_code, 0);
  ASSERT_EQ(run({"archive", "town", "--store", store, "--encoding", "compact", "--bound", "10mm",
                 "--out", second})
                .exit_code,
            0);
  const Outcome verified = run({"verify", second, "--source", store, "--json"});
  ASSERT_EQ(verified.exit_code, 0) << verified.err;
  const auto report = nlohmann::json::parse(verified.out);
  EXPECT_EQ(report["intact"], true);
  EXPECT_EQ(report["source"]["bound_m"], 0.01);
  EXPECT_LE(report["source"]["worst_m"], 0.01);
  const auto update = run({"archive", "town", "--store", store, "--out", second, "--update"});
  EXPECT_EQ(update.exit_code, 0) << update.err;
  const auto diff = nlohmann::json::parse(run({"info", "--diff", first, second, "--json"}).out);
  EXPECT_EQ(diff["alike"], 6);
  EXPECT_EQ(diff["moved"], 0);

  std::string damaged(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  damaged[kArchiveFirstReadBytes + 60] ^= 1;
  const std::string broken = folder.write("broken.cellmap", damaged);
  const Outcome found = run({"verify", broken});
  EXPECT_NE(found.exit_code, 0);
  EXPECT_THAT(found.out, testing::HasSubstr("CELL 1"));
  const std::string repaired = folder / "repaired.cellmap";
  const Outcome mended = run({"repair", broken, "--out", repaired});
  EXPECT_THAT(mended.out, testing::HasSubstr("5 of 6"));
  EXPECT_EQ(run({"verify", repaired}).exit_code, 0);
  EXPECT_NE(run({"repair", broken, "--out", repaired}).exit_code, 0) << "it is there already";
}

TEST(ArchiveVerbs, ACodedCellIsHeldAgainstItsSource) {
  const test::TempFolder folder;
  const Cell cell = random_cell(3, 200, 1000);
  const auto write = [&](const std::string& name, const Bytes& bytes) {
    return folder.write(name, {reinterpret_cast<const char*>(bytes.data()), bytes.size()}).string();
  };
  const std::string raw = write("1.cell", encode_cell(cell).bytes);
  const std::string other = write("2.cell", encode_cell(random_cell(4, 200, 1000)).bytes);
  const std::string coded = write("1.ccod", encode_compact_cell(cell, 0.03).bytes);
  const auto report = nlohmann::json::parse(run({"verify", coded, "--source", raw, "--json"}).out);
  EXPECT_EQ(report["source"]["bound_m"], 0.03);
  EXPECT_GT(report["source"]["worst_m"], 0.0);
  EXPECT_LE(report["source"]["worst_m"], 0.03);
  EXPECT_NE(run({"verify", coded, "--source", other}).exit_code, 0);
}

TEST(ArchiveClient, SendsAnArchiveAsItIsReadAndFetchesOneInParts) {
  const Bytes bytes = ArchiveSample(6).bytes();
  FileServer server(bytes, "\"one\"");
  MemoryFile fetched(Bytes(10));
  download_archive(test::options_for(server.http), "town", {}, fetched);
  EXPECT_EQ(fetched.bytes(), bytes);

  std::string received, type;
  FakeServer taker([&](const httplib::Request& request, httplib::Response& response) {
    received = request.body;
    type = request.get_header_value("Content-Type");
    test::answer_problem(response, 409, "already-exists", "taken");
  });
  MemoryFile archive(bytes);
  expect_error(
      ErrorCode::kAlreadyExists, [&] { upload_archive(test::options_for(taker), "town", archive); },
      "taken");
  EXPECT_EQ(type, "application/vnd.cellmap.archive");
  EXPECT_EQ(received.size(), bytes.size());
}

}  // namespace
}  // namespace cellmap
