#include <SQLiteCpp/SQLiteCpp.h>
#include <spdlog/sinks/ostream_sink.h>

#include <random>
#include <set>
#include <sstream>

#include "server/api/place_servers.hpp"
#include "server/guarded_fixture.hpp"
#include "server/http_fixture.hpp"

// Servers over one store that search for places together, over loopback.

namespace cellmap::server::test {
namespace {

using ::testing::HasSubstr;

/// Below those that the kernel gives to connections that go out, so that none takes it before a
/// server listens there.
int free_port() {
  std::random_device random;
  for (;;) {
    const int port = std::uniform_int_distribution(10'000, 31'999)(random);
    const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    const int failed = ::bind(socket, reinterpret_cast<sockaddr*>(&address), sizeof(address));
    ::close(socket);
    if (failed == 0) return port;
  }
}

/// Takes connections, and answers each with these bytes, whatever is asked; without any it hangs.
class Impostor {
 public:
  explicit Impostor(std::string answer = "") : answer_(std::move(answer)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    ::bind(socket_, reinterpret_cast<sockaddr*>(&address), size);
    ::listen(socket_, 16);
    ::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size);
    url_ = "http://127.0.0.1:" + std::to_string(ntohs(address.sin_port));
    thread_ = std::thread([this] { take(); });
  }
  ~Impostor() {
    ::shutdown(socket_, SHUT_RDWR);
    thread_.join();
    for (const int one : taken_) ::close(one);
    ::close(socket_);
  }
  const std::string& url() const { return url_; }

 private:
  void take() {
    for (int one; (one = ::accept(socket_, nullptr, nullptr)) >= 0;) {
      taken_.push_back(one);
      if (answer_.empty()) continue;
      char buffer[1 << 16];
      ::recv(one, buffer, sizeof(buffer), 0);
      ::send(one, answer_.data(), answer_.size(), MSG_NOSIGNAL);
      ::shutdown(one, SHUT_WR);
    }
  }

  const std::string answer_;
  int socket_ = ::socket(AF_INET, SOCK_STREAM, 0);
  std::string url_;
  std::vector<int> taken_;
  std::thread thread_;
};

/// One of several servers over a store.
class OneServer {
 public:
  OneServer(Store& store, ApiOptions options, int port)
      : log_(std::make_shared<spdlog::logger>(
            "test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text_))),
        api_(store, std::move(options), log_),
        http_(api_, log_, http_options(port)),
        thread_([this] { http_.run(); }) {}
  ~OneServer() {
    api_.stop();
    http_.stop();
    thread_.join();
  }
  Api& api() { return api_; }
  std::string log() const { return text_.str(); }
  std::string metrics() {
    const Response response = api_.handle({"GET", "/metrics", {}, {}, "test"});
    return std::string(body_view(response));
  }

 private:
  static HttpServerOptions http_options(int port) {
    HttpServerOptions options;
    options.listen = {"127.0.0.1:" + std::to_string(port)};
    return options;
  }
  std::ostringstream text_;
  std::shared_ptr<spdlog::logger> log_;
  Api api_;
  HttpServer http_;
  std::thread thread_;
};

/// A street in twelve regions: copies of it far from each other.
class SharedSearchTest : public ApiTest {
 protected:
  static constexpr int kCopies = 12;

  SharedSearchTest() {
    make_map();
    MapUpdate update;
    for (std::uint32_t i = 0; i < 2 * kCopies; ++i) {
      const auto session = "drive-" + std::to_string(i / 2);
      EXPECT_EQ(put_cell(i + 1, street_cell(i, 8 * (i % 2), session)).status, 201);
      update.poses[{i + 1}] = level_pose(300.0 * (i / 2) + 8 * (i % 2), 0, 0);
    }
    store_->commit("town", update);
  }

  /// Servers under these addresses, and names of others that are somebody else's.
  void start_servers(
      std::size_t count, std::vector<std::string> others = {},
      std::function<void(ApiOptions&)> change = [](ApiOptions&) {}) {
    std::vector<int> ports;
    std::vector<std::string> urls;
    do {
      ports.clear();
      urls = others;
      for (std::size_t i = 0; i < count; ++i) {
        ports.push_back(free_port());
        urls.push_back("http://127.0.0.1:" + std::to_string(ports.back()));
      }
    } while (!have_regions(urls));
    for (std::size_t i = 0; i < count; ++i) {
      ApiOptions all = options();
      all.jobs.carries_out = false;
      all.place_servers = {urls, urls[others.size() + i]};
      all.place_servers.alone = 0;
      all.place_servers.timeout = std::chrono::seconds(30);
      change(all);
      servers_.push_back(std::make_unique<OneServer>(*store_, std::move(all), ports[i]));
    }
  }

  /// Whether each has one, which of twelve regions and three servers one in forty lists denies.
  bool have_regions(const std::vector<std::string>& urls) const {
    const RegionOwners owners(urls, "town");
    std::set<std::size_t> with_regions;
    const PlaceRegions regions(store_->pose_graph("town"));
    for (const auto& region : regions.all()) with_regions.insert(owners.owner_of(region.key));
    return with_regions.size() == urls.size();
  }

  static Json ask(Api& api, std::size_t scan, std::vector<Headed> headers = {},
                  const std::string& query = "") {
    Request request{"POST",
                    "/v1/maps/town/relocalise" + query,
                    {},
                    kitti_bytes(street_scan(scan).points),
                    "request-7"};
    headers.push_back({"Content-Type", "application/octet-stream"});
    for (const auto& [name, value] : headers) request.headers.set(name, value);
    const Response response = api.handle(request);
    EXPECT_EQ(response.status, 200) << body_view(response);
    Json json = Json::parse(body_view(response));
    json.erase("time_ms");
    return json;
  }
  /// Of the one server that there usually is.
  Json expected(std::size_t scan, const std::string& query = "") {
    return ask(*api_, scan, {}, query);
  }

  /// Of a counter or gauge in metrics; 0 where it is not there.
  static double value(const std::string& metrics, const std::string& name) {
    const auto at = metrics.find("\n" + name);
    if (at == std::string::npos) return 0;
    const auto line = metrics.substr(at + 1, metrics.find('\n', at + 1) - at - 1);
    return std::stod(line.substr(line.rfind(' ') + 1));
  }
  static double searches(const std::string& metrics, const std::string& outcome) {
    double sum = 0;
    std::istringstream lines(metrics);
    for (std::string line; std::getline(lines, line);) {
      const bool is_one = line.starts_with("cellmap_place_searches_total") &&
                          line.find("outcome=\"" + outcome + "\"") != std::string::npos;
      if (is_one) sum += std::stod(line.substr(line.rfind(' ') + 1));
    }
    return sum;
  }

  std::vector<std::unique_ptr<OneServer>> servers_;
};

TEST_F(SharedSearchTest, EveryServerGivesTheAnswerOfOneAndKeepsItsShareOnly) {
  start_servers(3);
  for (const std::size_t scan : {1u, 7u}) {
    for (const std::string query : {"", "?prior=601,0,0,0,0,0,1&radius=5"}) {
      const Json one = expected(scan, query);
      EXPECT_FALSE(one["alternatives"].empty() && !one["found"]);
      for (const auto& server : servers_) EXPECT_EQ(ask(server->api(), scan, {}, query), one);
    }
  }
  constexpr double kWhole = 2 * kCopies * (sizeof(DescribedPlace) + sizeof(CellId));
  double sum = 0;
  for (const auto& server : servers_) {
    const std::string metrics = server->metrics();
    EXPECT_GE(searches(metrics, "answered"), 4);
    EXPECT_EQ(searches(metrics, "failed"), 0);
    EXPECT_EQ(value(metrics, "cellmap_place_regions_taken_over_total"), 0);
    EXPECT_LT(value(metrics, "cellmap_place_bytes"), kWhole);
    sum += value(metrics, "cellmap_place_bytes");
    EXPECT_EQ(server->log(), "");
  }
  EXPECT_EQ(sum, kWhole);
}

TEST_F(SharedSearchTest, FewCellsAreSearchedByTheServerThatIsAsked) {
  start_servers(2, {}, [](ApiOptions& options) { options.place_servers.alone = 2 * kCopies; });
  EXPECT_EQ(ask(servers_[0]->api(), 1), expected(1));
  EXPECT_EQ(searches(servers_[0]->metrics(), "answered"), 0);
}

TEST_F(SharedSearchTest, WhatADeadServerHasIsSearchedHereAndItIsLeftAloneForAWhile) {
  start_servers(3);
  const Json one = expected(3);
  servers_.erase(servers_.begin() + 1);
  for (int time = 0; time < 3; ++time) {
    for (const auto& server : servers_) EXPECT_EQ(ask(server->api(), 3), one);
  }
  for (const auto& server : servers_) {
    const std::string metrics = server->metrics();
    EXPECT_EQ(searches(metrics, "failed"), 1);
    EXPECT_EQ(searches(metrics, "left_alone"), 2);
    EXPECT_EQ(searches(metrics, "answered"), 3);
    EXPECT_GT(value(metrics, "cellmap_place_regions_taken_over_total"), 0);
    EXPECT_THAT(server->log(), HasSubstr("searches the regions of http://127.0.0.1:"));
  }
}

TEST_F(SharedSearchTest, AServerThatComesBackIsAskedAgain) {
  const std::string gone = "http://127.0.0.1:" + std::to_string(free_port());
  start_servers(1, {gone}, [](ApiOptions& options) {
    options.place_servers.pause = std::chrono::milliseconds(1);
  });
  const Json one = expected(3);
  EXPECT_EQ(ask(servers_[0]->api(), 3), one);
  std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_EQ(ask(servers_[0]->api(), 3), one);
  EXPECT_EQ(searches(servers_[0]->metrics(), "failed"), 2);
  const std::string log = servers_[0]->log();
  EXPECT_EQ(log.find("searches the regions"), log.rfind("searches the regions")) << "said once";
}

TEST_F(SharedSearchTest, AServerThatHangsIsNotWaitedForBeyondTheDeadline) {
  const Impostor hangs;
  start_servers(1, {hangs.url()}, [](ApiOptions& options) {
    options.place_servers.timeout = std::chrono::milliseconds(150);
  });
  EXPECT_EQ(ask(servers_[0]->api(), 3), expected(3));
  EXPECT_EQ(searches(servers_[0]->metrics(), "failed"), 1);
  EXPECT_THAT(servers_[0]->log(), HasSubstr("no answer in time"));
}

TEST_F(SharedSearchTest, NonsenseIsNotBelieved) {
  const auto answer = [](const std::string& body, const std::string& status = "200 OK") {
    return "HTTP/1.1 " + status + "\r\nContent-Length: " + std::to_string(body.size()) +
           "\r\nConnection: close\r\n\r\n" + body;
  };
  const auto with_places = [&](ComparedPlaces places) {
    const Bytes bytes = encode_place_answer({{}, std::move(places)}, {30, false});
    return answer(to_text(bytes));
  };
  ComparedPlaces elsewhere;
  elsewhere.push_back({CellId{9999}, 0.9f, 0.9f,
                       std::make_unique<DescribedPlace>(describe_place(street_scan(0).points))});
  const Json one = expected(3);
  for (const std::string& nonsense :
       {answer("junk"), with_places({}), with_places(std::move(elsewhere)), std::string("junk"),
        answer("{}", "404 Not Found"), answer(std::string(5 << 20, '\0'))}) {
    const Impostor impostor(nonsense);
    servers_.clear();
    start_servers(1, {impostor.url()});
    EXPECT_EQ(ask(servers_[0]->api(), 3), one) << nonsense.substr(0, 40);
    EXPECT_EQ(searches(servers_[0]->metrics(), "failed"), 1) << nonsense.substr(0, 40);
  }
}

/// One turn each: if they waited for each other's, none would ever end.
TEST_F(SharedSearchTest, ServersThatAskEachOtherDoNotWaitInACircle) {
  start_servers(2, {}, [](ApiOptions& options) {
    options.relocalisations = options.place_searches = 1;
    options.relocalisation_wait = std::chrono::minutes(2);
  });
  const Json one = expected(3);
  std::vector<std::jthread> clients;
  for (int i = 0; i < 8; ++i) {
    clients.emplace_back([&, i] { EXPECT_EQ(ask(servers_[i % 2]->api(), 3), one); });
  }
  clients.clear();
  for (const auto& server : servers_) EXPECT_EQ(searches(server->metrics(), "failed"), 0);
}

/// The answer is right, and who is asked for what is another's says so.
TEST_F(SharedSearchTest, ServersThatDisagreeOnWhoHasWhatSaySo) {
  start_servers(2, {}, [n = 0](ApiOptions& options) mutable {
    if (n++ == 1) options.place_servers.self = options.place_servers.servers[0];
  });
  EXPECT_EQ(ask(servers_[0]->api(), 3), expected(3));
  EXPECT_THAT(servers_[1]->log(), HasSubstr("the servers have different --place-servers"));
}

TEST_F(SharedSearchTest, WhatCannotBeKeptIsSaidOnceAndTheAnswerIsRight) {
  const Json one = expected(3);
  SQLite::Database db((folder_.path() / "store.db").string(), SQLite::OPEN_READWRITE);
  db.exec("DELETE FROM cell_description");
  db.exec(
      "CREATE TRIGGER full BEFORE INSERT ON cell_description BEGIN "
      "SELECT RAISE(ABORT, 'no room'); END");
  start_servers(1);
  EXPECT_EQ(ask(servers_[0]->api(), 3), one);
  const std::string log = servers_[0]->log();
  EXPECT_THAT(log, HasSubstr("cannot keep what it described of town"));
  EXPECT_EQ(log.find("cannot keep"), log.rfind("cannot keep"));
}

}  // namespace
}  // namespace cellmap::server::test
