#include "cellmap/client/event_stream.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace cellmap::client {
namespace {

std::vector<ServerEvent> parse(const std::string& stream, std::size_t piece) {
  std::vector<ServerEvent> events;
  EventStreamParser parser;
  for (std::size_t i = 0; i < stream.size(); i += piece) {
    parser.feed(stream.substr(i, piece), [&](const ServerEvent& e) { events.push_back(e); });
  }
  return events;
}

TEST(EventStream, EventsAreTheSameInPiecesOfAnySize) {
  const std::string stream =
      ": a comment\r\nevent: progress\r\ndata: {\"a\":1}\r\n\r\n"
      "id: 4\ndata:first\ndata: second\n\n"
      "event: end\ndata: x\n\n";
  for (std::size_t piece = 1; piece <= stream.size(); ++piece) {
    const auto events = parse(stream, piece);
    ASSERT_EQ(events.size(), 3u) << piece;
    EXPECT_EQ(events[0].type, "progress");
    EXPECT_EQ(events[0].data, "{\"a\":1}");
    EXPECT_EQ(events[1].type, "message");
    EXPECT_EQ(events[1].data, "first\nsecond");
    EXPECT_EQ(events[2].type, "end");
  }
}

TEST(EventStream, AnEventWithoutDataOrWithoutItsEmptyLineIsNone) {
  EXPECT_TRUE(parse("event: end\n\n", 5).empty());
  EXPECT_TRUE(parse("data: unfinished\n", 5).empty());
}

TEST(EventStream, AnEventAboveTheLimitIsDroppedAndTheNextOneIsRead) {
  const auto events = parse("data: " + std::string(2 << 20, 'x') + "\n\ndata: small\n\n", 4096);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].data, "small");
}

}  // namespace
}  // namespace cellmap::client
