#include "cellmap/client/client.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "cellmap/client/json.hpp"
#include "cellmap/client/upload.hpp"
#include "cellmap/codec/cell_batch.hpp"
#include "cellmap/codec/scan_batch.hpp"
#include "cellmap/codec/zstd.hpp"
#include "client/fake_server.hpp"
#include "codec/samples.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

using std::chrono::milliseconds;
using test::answer_json;
using test::answer_problem;
using test::FakeServer;
using test::options_for;

constexpr char kNoMaps[] = R"({"maps":[]})";

std::string text_of(const Bytes& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

Bytes bytes_of(const std::string& text) {
  const auto* first = reinterpret_cast<const std::byte*>(text.data());
  return {first, first + text.size()};
}

Job a_job(JobState state, std::uint64_t next_scan) {
  Job job;
  job.id = JobId{7};
  job.map = "m";
  job.kind = "ingest";
  job.session = "s";
  job.state = state;
  job.next_scan = next_scan;
  return job;
}

std::string json_of(const Job& job) { return client::dump(client::to_json(job)); }

TEST(Client, TriesAgainWhereAServerIsOverloadedAndWaitsAsItAsks) {
  int failures = 2;
  FakeServer server([&](const httplib::Request&, httplib::Response& response) {
    if (failures-- > 0) {
      answer_problem(response, 503, "unavailable", "busy");
      response.set_header("Retry-After", "2");
    } else {
      answer_json(response, kNoMaps);
    }
  });
  std::vector<milliseconds> waits;
  Client client(options_for(server, &waits));
  EXPECT_TRUE(client.maps().empty());
  EXPECT_EQ(server.requests, 3);
  EXPECT_EQ(waits, (std::vector{milliseconds(2000), milliseconds(2000)}));
}

TEST(Client, GivesUpAfterItsAttemptsWithTheServersWords) {
  FakeServer server([](const httplib::Request&, httplib::Response& response) {
    answer_problem(response, 503, "unavailable", "the queue is full");
  });
  ClientOptions options = options_for(server);
  options.retry.attempts = 3;
  Client client(options);
  test::expect_error(
      ErrorCode::kUnavailable, [&] { client.maps(); }, "the queue is full");
  EXPECT_EQ(server.requests, 3);
}

TEST(Client, AnAnswerThatIsARefusalIsNotTriedAgain) {
  FakeServer server([](const httplib::Request&, httplib::Response& response) {
    answer_problem(response, 404, "not-found", "There is no map 'x'.");
  });
  Client client(options_for(server));
  test::expect_error(
      ErrorCode::kNotFound, [&] { client.map("x"); }, "There is no map 'x'.");
  EXPECT_EQ(server.requests, 1);
}

TEST(Client, SendsAgainOverAGatewaysFailureOnlyWhatIsIdempotent) {
  FakeServer server([](const httplib::Request&, httplib::Response& response) {
    response.status = 502;
    response.set_content("<html>Bad gateway</html>", "text/html");
  });
  ClientOptions options = options_for(server);
  options.retry.attempts = 4;
  Client client(options);
  test::expect_error(
      ErrorCode::kUnavailable, [&] { client.maps(); }, "502");
  EXPECT_EQ(server.requests, 4);
  EXPECT_THROW(client.add_loop("m", CellId{1}, CellId{2}, Pose::Identity()), Error);
  EXPECT_EQ(server.requests, 5);
}

TEST(Client, SaysWhatToDoWhereNoServerListens) {
  std::string url;
  {
    FakeServer gone([](const httplib::Request&, httplib::Response&) {});
    url = gone.url();
  }
  ClientOptions options;
  options.url = url;
  options.retry.attempts = 2;
  options.retry.sleep = [](milliseconds) {};
  Client client(options);
  test::expect_error(
      ErrorCode::kUnavailable, [&] { client.maps(); }, url, "cellmap serve");
}

TEST(Client, EveryCodeOfAProblemBecomesTheSameError) {
  ErrorCode sent = ErrorCode::kInternal;
  FakeServer server([&](const httplib::Request&, httplib::Response& response) {
    answer_problem(response, 418, std::string(to_string(sent)), "detail of it");
  });
  ClientOptions options = options_for(server);
  options.retry.attempts = 1;
  Client client(options);
  for (int code = 0; code <= static_cast<int>(ErrorCode::kInternal); ++code) {
    sent = static_cast<ErrorCode>(code);
    test::expect_error(
        sent, [&] { client.map("m"); }, "detail of it");
  }
}

TEST(Client, JsonThatIsNotAsTheApiSaysIsCorruptData) {
  std::string body;
  FakeServer server(
      [&](const httplib::Request&, httplib::Response& response) { answer_json(response, body); });
  Client client(options_for(server));
  for (const char* wrong :
       {"", "[", "{}", R"({"maps":[{"name":"m"}]})", R"({"maps":[{"name":3}]})"}) {
    body = wrong;
    test::expect_error(ErrorCode::kCorruptData, [&] { client.maps(); });
  }
  body = std::string(100'000, '[');
  test::expect_error(
      ErrorCode::kCorruptData, [&] { client.maps(); }, "deep");
}

/// Serves one CELL with its ETag, compressed, and counts how often its bytes were sent.
struct CellServer {
  EncodedCell cell = encode_cell(random_cell(3, 200, 1000));
  int sent = 0;
  bool damaged = false;
  FakeServer server{[this](const httplib::Request& request, httplib::Response& response) {
    response.set_header("ETag", '"' + to_hex(cell.hash) + "-zstd\"");
    response.set_header("CELLmap-Pose", "1 2 3 0 0 0 1");
    response.set_header("CELLmap-Revision", "9");
    if (request.get_header_value("If-None-Match") == '"' + to_hex(cell.hash) + '"') {
      response.status = 304;
      return;
    }
    ++sent;
    Bytes bytes = cell.bytes;
    if (damaged) bytes[bytes.size() / 2] ^= std::byte{1};
    response.set_header("Content-Encoding", "zstd");
    response.set_content(text_of(zstd_compress(bytes)), "application/vnd.cellmap.cell");
  }};
};

TEST(Client, FetchesACellOnceAndThenAsksWithItsEtag) {
  const test::TempFolder folder;
  CellServer cells;
  ClientOptions options = options_for(cells.server);
  options.cache_directory = folder.path();
  Client client(options);
  const FetchedCell first = client.cell("m", CellId{5});
  EXPECT_FALSE(first.from_cache);
  EXPECT_EQ(first.encoded.bytes, cells.cell.bytes);
  EXPECT_EQ(first.T_map_cell.translation(), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(first.revision, 9u);
  const FetchedCell second = client.cell("m", CellId{5});
  EXPECT_TRUE(second.from_cache);
  EXPECT_EQ(second.encoded.bytes, cells.cell.bytes);
  EXPECT_EQ(second.T_map_cell.translation(), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(cells.sent, 1);
}

TEST(Client, FetchesAgainWhereTheCacheIsDamaged) {
  const test::TempFolder folder;
  CellServer cells;
  ClientOptions options = options_for(cells.server);
  options.cache_directory = folder.path();
  Client client(options);
  client.cell("m", CellId{5});
  const auto file = CellCache({folder.path()}).path_of(cells.cell.hash);
  std::filesystem::resize_file(file, 100);
  EXPECT_EQ(client.cell("m", CellId{5}).encoded.bytes, cells.cell.bytes);
  EXPECT_EQ(cells.sent, 2);
  EXPECT_TRUE(client.cell("m", CellId{5}).from_cache);
}

TEST(Client, BytesThatFailTheirHashAreNeverHandedOutNorCached) {
  const test::TempFolder folder;
  CellServer cells;
  cells.damaged = true;
  ClientOptions options = options_for(cells.server);
  options.cache_directory = folder.path();
  Client client(options);
  test::expect_error(ErrorCode::kCorruptData, [&] { client.cell("m", CellId{5}); });
  cells.damaged = false;
  EXPECT_FALSE(client.cell("m", CellId{5}).from_cache);
}

TEST(Client, FollowsAJobOverEventsUntilItEnds) {
  FakeServer server([](const httplib::Request& request, httplib::Response& response) {
    if (!request.path.ends_with("/events")) {
      return answer_json(response, json_of(a_job(JobState::kRunning, 0)));
    }
    Job done = a_job(JobState::kSucceeded, 0);
    done.scans_done = 12;
    const auto line = [](const Job& job) { return client::dump(client::to_json(job), false); };
    response.set_content("event: progress\ndata: " + line(a_job(JobState::kRunning, 0)) +
                             "\n\n: still here\n\nevent: end\ndata: " + line(done) + "\n\n",
                         "text/event-stream");
  });
  Client client(options_for(server));
  int seen = 0;
  const Job job = client.follow_job(JobId{7}, [&](const Job&) { ++seen; });
  EXPECT_EQ(job.state, JobState::kSucceeded);
  EXPECT_EQ(job.scans_done, 12u);
  EXPECT_EQ(seen, 3);
  EXPECT_EQ(server.requests, 2);
}

TEST(Client, FollowsAJobByAskingWhereEventsAreRefused) {
  int asked = 0;
  FakeServer server([&](const httplib::Request& request, httplib::Response& response) {
    if (request.path.ends_with("/events")) {
      return answer_problem(response, 503, "unavailable", "too many followers");
    }
    answer_json(response,
                json_of(a_job(++asked < 2 ? JobState::kRunning : JobState::kSucceeded, 0)));
  });
  Client client(options_for(server));
  EXPECT_EQ(client.follow_job(JobId{7}).state, JobState::kSucceeded);
}

/// A drive of numbered scans, each with one point whose x is its index.
class NumberedSource : public ScanSource {
 public:
  explicit NumberedSource(std::size_t size) : size_(size) {}
  std::size_t size() const override { return size_; }
  std::optional<PosedScan> next() override {
    if (next_ >= size_) return std::nullopt;
    PosedScan scan;
    scan.index = next_++;
    scan.points.push_back({static_cast<float>(scan.index), 0, 0});
    return scan;
  }
  void seek(std::size_t index) override { next_ = index; }
  const Trajectory& ground_truth() const override { return truth_; }

 private:
  std::size_t size_, next_ = 0;
  Trajectory truth_;
};

/// An upload job that wants scans in order, is sometimes full and jumps where told to.
struct UploadServer {
  std::uint64_t wanted = 3, room = 64;
  std::optional<std::uint64_t> jump_at_5_to;
  int full = 0, broken = 0, broken_starts = 0;
  bool complete = false, other_job_runs = false;
  JobState state = JobState::kRunning;
  std::vector<std::uint64_t> taken;
  std::vector<std::size_t> sizes;  // of requests
  FakeServer server{[this](const httplib::Request& request, httplib::Response& response) {
    const bool post = request.method == "POST";
    if (request.path == "/v1/maps/m/sessions/s/scans") {
      return post ? take(request, response) : answer_json(response, standing(0));
    }
    if (request.path == "/v1/maps/m/jobs" && request.method == "GET") {
      return answer_json(response, R"({"jobs":[)" + json_of(a_job(state, wanted)) + "]}");
    }
    if (request.path == "/v1/maps/m/jobs" && broken_starts > 0) {
      --broken_starts;
      return answer_problem(response, 502, "io", "the gateway lost the server");
    }
    if (request.path == "/v1/maps/m/jobs" && other_job_runs) {
      return answer_problem(response, 409, "conflict", "session s is being ingested");
    }
    if (request.path.ends_with("/complete") ||
        request.path.find("/complete?scans=") != std::string::npos) {
      complete = true;
      state = JobState::kSucceeded;
    }
    answer_json(response, json_of(a_job(state, wanted)), 202);
  }};

  std::string standing(std::uint64_t new_scans) const {
    return R"({"session":"s","state":"mapping","keep_from":0,"room":)" + std::to_string(room) +
           R"(,"next_scan":)" + std::to_string(wanted) + R"(,"taken":)" +
           std::to_string(new_scans) + R"(,"job":)" + json_of(a_job(state, wanted)) + "}";
  }

  void take(const httplib::Request& request, httplib::Response& response) {
    if (full > 0) {
      --full;
      answer_problem(response, 503, "unavailable", "full");
      response.set_header("Retry-After", "1");
      return;
    }
    if (broken > 0) {
      --broken;
      return answer_problem(response, 502, "io", "the gateway lost the server");
    }
    EXPECT_EQ(request.get_header_value("Content-Type"), "application/vnd.cellmap.scans");
    EXPECT_EQ(request.get_header_value("Content-Encoding"), "zstd");
    const auto scans = decode_scan_batch(zstd_decompress(bytes_of(request.body), 1 << 20));
    sizes.push_back(scans.size());
    if (scans.front().index == 5 && jump_at_5_to) {
      wanted = *jump_at_5_to;
      jump_at_5_to.reset();
    }
    if (scans.front().index > wanted) {
      response.status = 409;
      response.set_content(
          R"({"code":"conflict","detail":"another","next_scan":)" + std::to_string(wanted) + "}",
          "application/problem+json");
      return;
    }
    std::uint64_t new_scans = 0;
    for (const PosedScan& scan : scans) {
      EXPECT_EQ(scan.points.x.at(0), static_cast<float>(scan.index));
      if (scan.index != wanted || new_scans == room) continue;
      taken.push_back(wanted++);
      ++new_scans;
    }
    answer_json(response, standing(new_scans), 202);
  }
};

IngestRequest session_s() {
  IngestRequest request;
  request.session = "s";
  return request;
}

TEST(Upload, BeginsWhereTheJobWantsItAndCompletesIt) {
  UploadServer upload;
  Client client(options_for(upload.server));
  NumberedSource source(8);
  upload_drive(client, "m", session_s(), source);
  EXPECT_EQ(upload.taken, (std::vector<std::uint64_t>{3, 4, 5, 6, 7}));
  EXPECT_TRUE(upload.complete);
}

/// One scan a request.
UploadOptions singly() {
  UploadOptions options;
  options.scans_per_request = 1;
  return options;
}

TEST(Upload, SendsOneScanFirstAndThenSeveralARequest) {
  UploadServer upload;
  Client client(options_for(upload.server));
  NumberedSource source(24);
  upload_drive(client, "m", session_s(), source);
  EXPECT_EQ(upload.taken.size(), 21u);
  EXPECT_EQ(upload.sizes, (std::vector<std::size_t>{1, 8, 8, 4}));
}

TEST(Upload, SendsAgainWhatFoundNoRoom) {
  UploadServer upload;
  upload.room = 4;
  Client client(options_for(upload.server));
  NumberedSource source(16);
  upload_drive(client, "m", session_s(), source);
  EXPECT_EQ(upload.taken,
            (std::vector<std::uint64_t>{3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}));
}

TEST(Upload, GoesOnAfterALostConnection) {
  UploadServer upload;
  upload.broken = 12;  // more than the attempts of one request
  Client client(options_for(upload.server));
  NumberedSource source(5);
  upload_drive(client, "m", session_s(), source);
  EXPECT_EQ(upload.taken, (std::vector<std::uint64_t>{3, 4}));
}

TEST(Upload, GoesBackWhereTheJobWantsAnEarlierScan) {
  UploadServer upload;
  upload.jump_at_5_to = 1;
  Client client(options_for(upload.server));
  NumberedSource source(7);
  upload_drive(client, "m", session_s(), source, singly());
  EXPECT_EQ(upload.taken, (std::vector<std::uint64_t>{3, 4, 1, 2, 3, 4, 5, 6}));
}

TEST(Upload, WaitsOutAFullQueueHoweverLongItIsFull) {
  UploadServer upload;
  upload.full = 23;  // more than the attempts of one request
  std::vector<milliseconds> waits;
  Client client(options_for(upload.server, &waits));
  NumberedSource source(5);
  upload_drive(client, "m", session_s(), source);
  EXPECT_EQ(upload.taken, (std::vector<std::uint64_t>{3, 4}));
  for (const milliseconds wait : waits) EXPECT_EQ(wait, milliseconds(1000));
}

TEST(Upload, JoinsTheSessionsUnfinishedJob) {
  UploadServer upload;
  upload.other_job_runs = true;
  Client client(options_for(upload.server));
  NumberedSource source(5);
  upload_drive(client, "m", session_s(), source);
  EXPECT_EQ(upload.taken, (std::vector<std::uint64_t>{3, 4}));
}

TEST(Upload, AServerThatIsLostAtTheStartIsWaitedFor) {
  UploadServer upload;
  upload.broken_starts = 7;  // more than the client's own retries
  Client client(options_for(upload.server));
  NumberedSource source(5);
  upload_drive(client, "m", session_s(), source);
  EXPECT_EQ(upload.taken, (std::vector<std::uint64_t>{3, 4}));
}

TEST(Upload, AnAddressWhereNobodyIsIsToldAtOnce) {
  ClientOptions options;
  options.url = "http://127.0.0.1:1";
  options.retry.sleep = [](milliseconds) {};
  Client client(options);
  NumberedSource source(5);
  UploadOptions patient;
  patient.lost_patience = std::chrono::hours(1);
  test::expect_error(
      ErrorCode::kUnavailable, [&] { upload_drive(client, "m", session_s(), source, patient); },
      "nothing accepts connections");
}

TEST(Upload, AJobThatIsOverTakesNothing) {
  UploadServer upload;
  upload.state = JobState::kSucceeded;
  Client client(options_for(upload.server));
  NumberedSource source(5);
  EXPECT_EQ(upload_drive(client, "m", session_s(), source).state, JobState::kSucceeded);
  EXPECT_TRUE(upload.taken.empty());
}

TEST(ClientOptions, OutOfRangeIsRefused) {
  ClientOptions options;
  options.compression_level = 20;
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { Client{options}; }, "compression_level");
  ClientOptions silent;
  silent.read_timeout = milliseconds(0);
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { Client{silent}; }, "timeouts");
}

}  // namespace
}  // namespace cellmap
