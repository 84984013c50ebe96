#include "server/http/request_head.hpp"

#include <gtest/gtest.h>

#include <random>
#include <string>

namespace cellmap::server {
namespace {

HeadReading read(const std::string& bytes) { return read_request_head(bytes, {}); }

/// 0: more is needed, 200: in order, else the status of the refusal.
int status(const std::string& bytes) {
  const auto reading = read(bytes);
  EXPECT_FALSE(reading.head && reading.refusal);
  return reading.head ? 200 : reading.refusal ? reading.refusal->status : 0;
}

std::string with(const std::string& fields) {
  return "GET /v1/maps HTTP/1.1\r\nHost: x\r\n" + fields + "\r\n";
}

TEST(RequestHead, SaysWhatFollows) {
  const std::string bytes = "PUT /v1/maps/a HTTP/1.1\r\nHost: x\r\nContent-Length: 12\r\n\r\nbody";
  const auto head = read(bytes).head.value();
  EXPECT_EQ(head.method, "PUT");
  EXPECT_EQ(head.target, "/v1/maps/a");
  EXPECT_EQ(head.content_length, 12u);
  EXPECT_EQ(head.size, bytes.size() - 4);
  EXPECT_TRUE(read(with("Transfer-Encoding: Chunked\r\n")).head->chunked);
}

TEST(RequestHead, SaysWhetherTheConnectionIsKeptAndWhatTheFieldsAre) {
  EXPECT_TRUE(read(with("")).head->keep);
  EXPECT_FALSE(read(with("connection: TE, Close\r\n")).head->keep);
  const std::string old = "GET / HTTP/1.0\r\n";
  EXPECT_FALSE(read(old + "\r\n").head->keep);
  EXPECT_TRUE(read(old + "Connection: Keep-Alive\r\n\r\n").head->keep);
  EXPECT_FALSE(read(old + "Connection: keep-alive, close\r\n\r\n").head->keep);
  const std::string bytes = with("X-A: \t1%41 \r\nX-A:\r\n");
  using Field = std::pair<std::string_view, std::string_view>;
  const std::vector<Field> fields{{"Host", "x"}, {"X-A", "1%41"}, {"X-A", ""}};
  EXPECT_EQ(read(bytes).head->fields, fields);
}

TEST(RequestHead, AnUnfinishedHeadIsWaitedFor) {
  const std::string whole = with("X: y\r\n");
  for (std::size_t size = 0; size < whole.size(); ++size) {
    EXPECT_EQ(status(whole.substr(0, size)), 0) << size;
  }
  EXPECT_EQ(status(whole), 200);
}

TEST(RequestHead, WhatAProxyCouldReadOtherwiseIsRefused) {
  EXPECT_EQ(status(with("Content-Length: 1\r\nContent-Length: 1\r\n")), 400);
  EXPECT_EQ(status(with("Content-Length: 1\r\nTransfer-Encoding: chunked\r\n")), 400);
  EXPECT_EQ(status(with("Content-Length: +1\r\n")), 400);
  EXPECT_EQ(status(with("Content-Length: 1, 1\r\n")), 400);
  EXPECT_EQ(status(with("Content-Length: 99999999999999999999\r\n")), 400);
  EXPECT_EQ(status(with("Transfer-Encoding: gzip, chunked\r\n")), 501);
  EXPECT_EQ(status(with("Content-Length : 1\r\n")), 400);
  EXPECT_EQ(status(with("X: a\r\n folded\r\n")), 400);
  EXPECT_EQ(status(with("no colon\r\n")), 400);
  EXPECT_EQ(status(with(": no name\r\n")), 400);
  EXPECT_EQ(status(with("Host: y\r\n")), 400);
  EXPECT_EQ(status("GET / HTTP/1.1\r\n\r\n"), 400);
  EXPECT_EQ(status("GET / HTTP/1.0\r\n\r\n"), 200);
  EXPECT_EQ(status("GET / HTTP/1.1\nHost: x\n\n"), 400);
  EXPECT_EQ(status("GET / HTTP/1.1\r\nHost: x\nX: y\r\n\r\n"), 400);
}

TEST(RequestHead, ControlCharactersAreRefusedPercentEncodedOnesToo) {
  EXPECT_EQ(status(with(std::string("X: a\0b\r\n", 8))), 400);
  EXPECT_EQ(status(with("X: a%0D%0ASet-Cookie: b\r\n")), 400);
  EXPECT_EQ(status(with("X: a%20b %zz 100%\r\n")), 200);
  EXPECT_EQ(status("GET /a\tb HTTP/1.1\r\nHost: x\r\n\r\n"), 400);
}

TEST(RequestHead, SizesAndCountsAreBounded) {
  EXPECT_EQ(status("GET /" + std::string(9'000, 'a') + " HTTP/1.1\r\nHost: x\r\n\r\n"), 414);
  EXPECT_EQ(status("GET /" + std::string(20'000, 'a')), 414);
  EXPECT_EQ(status(with("X: " + std::string(20'000, 'a') + "\r\n")), 431);
  std::string fields;
  for (int i = 0; i < 99; ++i) fields += "X: y\r\n";
  EXPECT_EQ(status(with(fields)), 200);
  EXPECT_EQ(status(with(fields + "X: y\r\n")), 431);
}

TEST(RequestHead, WhatTheApiDoesNotReadIsRefusedBeforeItComes) {
  EXPECT_EQ(status(with("Content-Encoding: gzip\r\n")), 415);
  EXPECT_EQ(status(with("Content-Encoding: zstd\r\n")), 200);
  EXPECT_EQ(status(with("Content-Type: multipart/form-data; boundary=x\r\n")), 415);
  EXPECT_EQ(status("GET / HTTP/2.0\r\n\r\n"), 505);
  EXPECT_EQ(status("\x16\x03\x01 TLS\r\n\r\n"), 400);
}

TEST(RequestHead, AnyBytesGiveAnAnswer) {
  std::mt19937 random(7);
  const std::string whole = with("Content-Length: 12\r\nX: a%20b\r\n");
  for (int i = 0; i < 20'000; ++i) {
    std::string bytes = whole;
    for (int k = 0; k < 3; ++k) bytes[random() % bytes.size()] = static_cast<char>(random());
    const auto reading = read(bytes);
    EXPECT_FALSE(reading.head && reading.refusal);
    if (reading.head) {
      EXPECT_LE(reading.head->size, bytes.size());
    }
  }
}

}  // namespace
}  // namespace cellmap::server
