#include "cellmap/store/object_store.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <thread>
#include <vector>

#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

using std::chrono::milliseconds;

Bytes random_bytes(std::size_t count) {
  std::mt19937_64 random(count);
  Bytes bytes(count);
  for (std::byte& byte : bytes) byte = static_cast<std::byte>(random());
  return bytes;
}

/// Of the stand-in (support/object_store.sh), which checks signatures.
ObjectStoreOptions options_at(const std::string& endpoint, const std::string& prefix = "") {
  ObjectStoreOptions options;
  options.place = "s3://cells" + (prefix.empty() ? "" : "/" + prefix);
  options.endpoint = endpoint;
  options.access_key = options.secret_key = "S3RVER";
  return options;
}

class ObjectsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const char* const folder = std::getenv("CELLMAP_TEST_OBJECTS");
    std::ifstream file(std::filesystem::path(folder ? folder : "") / "address");
    if (!(file >> endpoint_)) GTEST_SKIP() << "NO OBJECT STORE RUNS FOR THIS TEST (Node.js, npm)";
    // A prefix of its own for every test.
    prefix_ = "t" + std::to_string(std::random_device()()) + "/cells";
  }
  std::unique_ptr<ObjectStore> open() const {
    return open_object_store(options_at(endpoint_, prefix_));
  }

  std::string endpoint_, prefix_;
};

TEST_F(ObjectsTest, WhatIsPutIsReadBackByWhoeverAsksAndMayBeReplaced) {
  const auto objects = open(), others = open();
  for (const std::size_t count : {0u, 1u, 20'000u, 3'000'000u}) {
    objects->put("ab/cell", random_bytes(count));
    const auto read = others->get("ab/cell", count);
    ASSERT_TRUE(read) << count;
    EXPECT_EQ(*read, random_bytes(count)) << count;
  }
}

TEST_F(ObjectsTest, WhatIsNotThereIsNoErrorNorIsRemovingIt) {
  const auto objects = open();
  EXPECT_FALSE(objects->get("nothing", 100));
  EXPECT_NO_THROW(objects->remove("nothing"));
  objects->put("a", random_bytes(10));
  objects->remove("a");
  EXPECT_FALSE(objects->get("a", 100));
}

TEST_F(ObjectsTest, OneThatIsLongerThanItMayBeIsDamaged) {
  const auto objects = open();
  objects->put("a", random_bytes(100'000));
  expect_error(ErrorCode::kCorruptData, [&] { objects->get("a", 99'999); });
  EXPECT_EQ(objects->get("a", 100'000)->size(), 100'000u);
}

TEST_F(ObjectsTest, AListingHasAllOfItsPrefixAndNothingElseInOrder) {
  const auto objects = open();
  open_object_store(options_at(endpoint_, prefix_ + "2"))->put("other", random_bytes(1));
  std::map<std::string, std::uint64_t> expected;
  for (std::size_t i = 0; i < 1003; ++i) {  // a page of the service has 1000
    const std::string name = "a-" + std::to_string(i);
    objects->put(name, random_bytes(i % 7));
    expected[name] = i % 7;
  }
  std::vector<std::pair<std::string, std::uint64_t>> listed;
  objects->list(
      [&](const StoredObject& object) { listed.emplace_back(object.name, object.bytes); });
  EXPECT_EQ(listed,
            (std::vector<std::pair<std::string, std::uint64_t>>(expected.begin(), expected.end())));
}

TEST_F(ObjectsTest, ManyThreadsAskAtTheSameTime) {
  const auto objects = open();
  std::vector<std::jthread> threads;
  for (std::size_t i = 1; i <= 8; ++i) {
    threads.emplace_back([&, i] {
      const std::string name = "thread-" + std::to_string(i);
      for (std::size_t turn = 1; turn <= 20; ++turn) {
        objects->put(name, random_bytes(100 * i + turn));
        EXPECT_EQ(objects->get(name, 10'000), random_bytes(100 * i + turn));
      }
    });
  }
}

TEST_F(ObjectsTest, KeysThatAreWrongAndABucketThatIsNotThereAreToldWithoutASecret) {
  ObjectStoreOptions wrong = options_at(endpoint_);
  wrong.secret_key = "not-this-one";
  ObjectStoreOptions elsewhere = options_at(endpoint_);
  elsewhere.place = "s3://no-such-bucket";
  for (const ObjectStoreOptions& options : {wrong, elsewhere}) {
    const auto objects = open_object_store(options);
    const std::vector<std::function<void()>> acts = {
        [&] { objects->put("a", random_bytes(10)); }, [&] { objects->get("a", 10); },
        [&] { objects->list([](const StoredObject&) {}); }};
    for (const auto& act : acts) {
      try {
        act();
        ADD_FAILURE() << options.place << " was taken";
      } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::kIo) << error.what();
        EXPECT_EQ(std::string(error.what()).find("not-this-one"), std::string::npos);
        EXPECT_NE(std::string(error.what()).find("AWS_SECRET_ACCESS_KEY"), std::string::npos);
      }
    }
  }
}

/// Answers every request with the same bytes, or with none.
class CannedServer {
 public:
  explicit CannedServer(std::string answer) : answer_(std::move(answer)) {
    socket_ = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    ::bind(socket_, reinterpret_cast<sockaddr*>(&address), size);
    ::listen(socket_, 8);
    ::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
    if (!answer_.empty()) thread_ = std::jthread([this] { serve(); });
  }
  ~CannedServer() {
    ::shutdown(socket_, SHUT_RDWR);
    if (thread_.joinable()) thread_.join();
    ::close(socket_);
  }
  std::string endpoint() const { return "http://127.0.0.1:" + std::to_string(port_); }

 private:
  void serve() {
    for (int client = 0; (client = ::accept(socket_, nullptr, nullptr)) >= 0;) {
      std::vector<char> request(1 << 16);
      (void)!::read(client, request.data(), request.size());
      (void)!::write(client, answer_.data(), answer_.size());
      ::shutdown(client, SHUT_WR);
      while (::read(client, request.data(), request.size()) > 0) {
      }
      ::close(client);
    }
  }

  const std::string answer_;
  int socket_ = -1;
  std::uint16_t port_ = 0;
  std::jthread thread_;
};

ErrorCode code_of_get(const std::string& answer) {
  const CannedServer server(answer);
  try {
    (void)open_object_store(options_at(server.endpoint()))->get("a", 1000);
  } catch (const Error& error) {
    return error.code();
  }
  return ErrorCode::kNotFound;  // none was thrown
}

TEST(ObjectStoreErrors, ToldBusinessPassesRefusalDoesNotAndHalfAnAnswerIsDamage) {
  const std::string busy =
      "HTTP/1.1 503 Slow\r\nContent-Length: 28\r\n\r\n<Code>SlowDown</Code>.......";
  EXPECT_EQ(code_of_get(busy), ErrorCode::kUnavailable);
  EXPECT_EQ(code_of_get("HTTP/1.1 500 No\r\nContent-Length: 0\r\n\r\n"), ErrorCode::kUnavailable);
  EXPECT_EQ(code_of_get("HTTP/1.1 403 No\r\nContent-Length: 0\r\n\r\n"), ErrorCode::kIo);
  EXPECT_EQ(code_of_get("HTTP/1.1 418 Tea\r\nContent-Length: 0\r\n\r\n"), ErrorCode::kInternal);
  EXPECT_EQ(code_of_get("HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\nabc"),
            ErrorCode::kCorruptData);
  EXPECT_EQ(
      code_of_get("HTTP/1.1 302 Go\r\nLocation: file:///etc/passwd\r\nContent-Length: 0\r\n\r\n"),
      ErrorCode::kInternal);
}

TEST(ObjectStoreErrors, WhoDoesNotAnswerIsWaitedForOnceAndNotForLong) {
  const CannedServer silent("");
  ObjectStoreOptions options = options_at(silent.endpoint());
  options.timeout = milliseconds(300);
  const auto objects = open_object_store(options);
  const auto time = [&] {
    const auto begun = std::chrono::steady_clock::now();
    expect_error(ErrorCode::kUnavailable, [&] { objects->get("a", 10); });
    return std::chrono::steady_clock::now() - begun;
  };
  const auto first = time();
  EXPECT_GE(first, milliseconds(290));
  EXPECT_LT(first, milliseconds(5000));
  EXPECT_LT(time(), milliseconds(250)) << "the second one need not find out by waiting";
}

TEST(ObjectStoreErrors, NobodyThereIsUnavailable) {
  const auto objects = open_object_store(options_at("http://127.0.0.1:1"));
  expect_error(
      ErrorCode::kUnavailable, [&] { objects->put("a", random_bytes(1)); }, "try again");
}

TEST(ObjectStoreOptions, WhatCannotBeAreRefusedBeforeAnythingIsAsked) {
  const auto refused = [](const std::function<void(ObjectStoreOptions&)>& spoil) {
    ObjectStoreOptions options = options_at("https://s3.example.org");
    EXPECT_NO_THROW(options.validate());
    spoil(options);
    expect_error(ErrorCode::kInvalidArgument, [&] { open_object_store(options); });
  };
  for (const char* const place : {"", "cells", "s3://", "s3://ab", "s3://Cells",
                                  "s3://cells/../a b", "s3://cells@evil/x", "http://cells"}) {
    refused([&](auto& options) { options.place = place; });
  }
  refused([](auto& options) { options.endpoint = "s3.example.org"; });
  refused([](auto& options) { options.endpoint = "file:///etc"; });
  refused([](auto& options) { options.region = "eu:s3"; });
  refused([](auto& options) { options.access_key.clear(); });
  refused([](auto& options) { options.session_token = "a\r\nb: c"; });
  const auto objects = open_object_store(options_at("http://127.0.0.1:1"));
  expect_error(ErrorCode::kInvalidArgument, [&] { objects->get("a b", 1); });
  expect_error(ErrorCode::kInvalidArgument, [&] { objects->get("", 1); });
}

}  // namespace
}  // namespace cellmap::test
