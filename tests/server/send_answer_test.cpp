#include "server/http/send_answer.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <memory>

#include "cellmap/archive/byte_source.hpp"

namespace cellmap::server {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

/// What a client reads of an answer, and whether its connection is kept.
class SendAnswer : public ::testing::Test {
 protected:
  SendAnswer() { EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, sockets_), 0); }
  ~SendAnswer() override { ::close(sockets_[1]); }

  std::string sent(const Response& response, const AnswerForm& form = {}) {
    Connection connection(sockets_[0], limits_, stop_);
    kept_ = send_answer(connection, response, form, files_);
    connection.flush();
    connection.half_close();
    std::string all;
    char buffer[4096];
    for (ssize_t got; (got = ::recv(sockets_[1], buffer, sizeof(buffer), 0)) > 0;) {
      all.append(buffer, static_cast<std::size_t>(got));
    }
    return all;
  }

  /// A new connection for the next answer.
  void again() {
    ::close(sockets_[1]);
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, sockets_), 0);
  }

  int sockets_[2];
  const ConnectionLimits limits_;
  std::atomic<bool> stop_ = false;
  bool kept_ = false;
  BodyFiles files_;
};

Response text(std::string body) {
  Response response;
  response.headers.set("Content-Type", "text/plain");
  response.body = std::move(body);
  return response;
}

Bytes numbered(std::size_t size) {
  Bytes bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::byte>(i * 7 + i / 256);
  return bytes;
}

/// A stream of two pieces, with a moment between them in which there is nothing.
Response stream() {
  Response response;
  response.body = [count = 0](std::string& piece) mutable {
    const std::string pieces[] = {"twelve bytes", "", "end"};
    piece = pieces[count];
    return ++count < 3;
  };
  return response;
}

TEST_F(SendAnswer, ABodyGoesWithItsLength) {
  EXPECT_EQ(sent(text("hello")),
            "HTTP/1.1 200 OK\r\nContent-Type: text/plain\r\nContent-Length: 5\r\n\r\nhello");
  EXPECT_TRUE(kept_);
}

TEST_F(SendAnswer, HeadIsToldOfTheBodyOnly) {
  EXPECT_THAT(sent(text("hello"), {.is_head = true}), EndsWith("Content-Length: 5\r\n\r\n"));
}

TEST_F(SendAnswer, HeadDoesNotBeginAStream) {
  Response response;
  response.body = [](std::string&) -> bool { throw std::logic_error("was begun"); };
  EXPECT_THAT(sent(response, {.is_head = true}), EndsWith("Transfer-Encoding: chunked\r\n\r\n"));
  EXPECT_TRUE(kept_);
}

TEST_F(SendAnswer, WhatHasNoBodySaysNoLength) {
  for (const int status : {204, 304}) {
    SCOPED_TRACE(status);
    Response response;
    response.status = status;
    response.headers.set("ETag", "\"a\"");
    EXPECT_THAT(answer_head(response, {}, 0),
                ::testing::AllOf(HasSubstr("ETag: \"a\"\r\n"), Not(HasSubstr("Content-"))));
  }
}

TEST_F(SendAnswer, AStreamGoesInChunksThatEnd) {
  const std::string answer = sent(stream());
  EXPECT_THAT(answer, HasSubstr("Transfer-Encoding: chunked\r\n"));
  EXPECT_THAT(answer, EndsWith("\r\n\r\nc\r\ntwelve bytes\r\n3\r\nend\r\n0\r\n\r\n"));
  EXPECT_TRUE(kept_);
}

TEST_F(SendAnswer, AStreamToAnOldClientEndsWithItsConnection) {
  const std::string answer = sent(stream(), {.is_http_1_0 = true, .keep = true});
  EXPECT_THAT(answer, Not(HasSubstr("Transfer-Encoding")));
  EXPECT_THAT(answer, HasSubstr("Connection: close\r\n"));
  EXPECT_THAT(answer, EndsWith("\r\n\r\ntwelve bytesend"));
  EXPECT_FALSE(kept_);
}

TEST_F(SendAnswer, AnOldClientThatAsksForItIsToldThatItsConnectionIsKept) {
  EXPECT_THAT(sent(text("x"), {.is_http_1_0 = true, .keep = true}),
              HasSubstr("Connection: keep-alive\r\n"));
  EXPECT_TRUE(kept_);
}

TEST_F(SendAnswer, AStreamEndsWhenTheServerStops) {
  stop_ = true;
  EXPECT_THAT(sent(stream()), EndsWith("\r\n\r\n0\r\n\r\n"));
}

TEST_F(SendAnswer, APartOfAFileGoesWithItsLength) {
  Response response;
  response.body = FileBody{std::make_shared<MemoryFile>(Bytes(10, std::byte{'x'})), 2, 8};
  EXPECT_THAT(sent(response), EndsWith("Content-Length: 8\r\n\r\nxxxxxxxx"));
  EXPECT_TRUE(kept_);
}

TEST_F(SendAnswer, ABodyThatIsSentAgainIsTheSame) {
  const auto bytes = std::make_shared<const Bytes>(numbered(60'000));
  const std::string all(reinterpret_cast<const char*>(bytes->data()), bytes->size());
  Response response;
  for (int time = 0; time < 3; ++time) {
    response.body = SharedBytes{bytes, 0, bytes->size()};
    EXPECT_THAT(sent(response), EndsWith("Content-Length: 60000\r\n\r\n" + all)) << time;
    again();
    response.body = SharedBytes{bytes, 20'000, 300};
    EXPECT_THAT(sent(response), EndsWith("\r\n\r\n" + all.substr(20'000, 300))) << time;
    EXPECT_TRUE(kept_);
    again();
  }
}

TEST_F(SendAnswer, WhatTheSocketDoesNotTakeOfAFileWaits) {
  const auto bytes = std::make_shared<const Bytes>(numbered(200'000));
  files_.find(bytes);
  const int small = 4096;
  ::setsockopt(sockets_[0], SOL_SOCKET, SO_SNDBUF, &small, sizeof(small));
  ::fcntl(sockets_[0], F_SETFL, O_NONBLOCK);
  Connection connection(sockets_[0], limits_, stop_);
  Response response;
  response.body = SharedBytes{bytes, 0, bytes->size()};
  EXPECT_TRUE(send_answer(connection, response, {}, files_));
  EXPECT_GT(connection.pending(), 100'000u);
  std::string all;
  std::array<char, 4096> buffer;
  while (connection.pending() > 0) {
    const ssize_t got = ::recv(sockets_[1], buffer.data(), buffer.size(), 0);
    all.append(buffer.data(), static_cast<std::size_t>(got));
    ASSERT_TRUE(connection.send_pending());
  }
  connection.half_close();
  for (ssize_t got; (got = ::recv(sockets_[1], buffer.data(), buffer.size(), 0)) > 0;) {
    all.append(buffer.data(), static_cast<std::size_t>(got));
  }
  EXPECT_THAT(all, EndsWith(std::string(reinterpret_cast<const char*>(bytes->data()), 200'000)));
}

TEST(BodyFiles, AreOfBodiesThatAreSentTwice) {
  BodyFiles files;
  const auto bytes = std::make_shared<const Bytes>(numbered(BodyFiles::kLeastBytes));
  EXPECT_FALSE(files.find(bytes));
  const auto file = files.find(bytes);
  ASSERT_TRUE(file);
  EXPECT_EQ(files.find(bytes), file);
  Bytes read(bytes->size() + 1);
  EXPECT_EQ(::pread(file->value(), read.data(), read.size(), 0), std::ssize(*bytes));
  read.pop_back();
  EXPECT_EQ(read, *bytes);
}

TEST(BodyFiles, AreNotOfOtherBytesAtTheSameAddress) {
  BodyFiles files;
  Bytes place = numbered(BodyFiles::kLeastBytes);
  const auto shared = [&] { return std::shared_ptr<const Bytes>(&place, [](const Bytes*) {}); };
  files.find(shared());
  EXPECT_FALSE(files.find(shared()));
}

TEST(BodyFiles, AreOfNeitherShortNorLongBodies) {
  BodyFiles files;
  for (const std::size_t size : {BodyFiles::kLeastBytes - 1, BodyFiles::kMostBytes + 1}) {
    const auto bytes = std::make_shared<const Bytes>(numbered(size));
    files.find(bytes);
    EXPECT_FALSE(files.find(bytes)) << size;
  }
}

TEST_F(SendAnswer, AFileThatEndsEarlyEndsTheConnection) {
  Response response;
  response.body = FileBody{std::make_shared<MemoryFile>(Bytes(10, std::byte{'x'})), 2, 9};
  EXPECT_THAT(sent(response), EndsWith("Content-Length: 9\r\n\r\nxxxxxxxx"));
  EXPECT_FALSE(kept_);
}

}  // namespace
}  // namespace cellmap::server
