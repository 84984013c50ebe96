#include "server/jobs/upload_source.hpp"

#include <gtest/gtest.h>

#include <future>
#include <set>

#include "support/expect_error.hpp"

namespace cellmap::server {
namespace {

using Put = UploadSource::Put;

PosedScan scan_of(std::size_t index, std::size_t points = 1) {
  PosedScan scan;
  scan.index = index;
  for (std::size_t i = 0; i < points; ++i) scan.points.push_back({1, 2, 3});
  return scan;
}

/// Room for two scans, or for ten points; waits "for ever".
UploadOptions small_queue() {
  UploadOptions options;
  options.max_scans = 2;
  options.max_points = 10;
  options.room_timeout = std::chrono::minutes(5);
  return options;
}

TEST(UploadSource, AScanWaitsForTheRoomThatTheJobMakes) {
  UploadSource source(0, 0, {}, small_queue());
  ASSERT_EQ(source.put(scan_of(0)), Put::kTaken);
  ASSERT_EQ(source.put(scan_of(1)), Put::kTaken);
  auto third = std::async(std::launch::async, [&] { return source.put(scan_of(2)); });
  EXPECT_EQ(source.next()->index, 0u);
  EXPECT_EQ(third.get(), Put::kTaken);
  EXPECT_EQ(source.next()->index, 1u);
  EXPECT_EQ(source.next()->index, 2u);
}

TEST(UploadSource, AnInterruptedReaderStopsWaiting) {
  UploadSource source(0, 0, {}, small_queue());
  auto read = std::async(std::launch::async, [&] { return source.next(); });
  source.interrupt();
  cellmap::test::expect_error(ErrorCode::kCancelled, [&] { read.get(); });
}

TEST(UploadSource, AScanThatFindsNoRoomInTimeIsRefused) {
  UploadOptions hurried = small_queue();
  hurried.room_timeout = std::chrono::milliseconds(1);
  UploadSource source(0, 0, {}, hurried);
  EXPECT_EQ(source.put(scan_of(0, 8)), Put::kTaken);
  EXPECT_EQ(source.put(scan_of(1, 3)), Put::kFull);
  EXPECT_EQ(source.next_scan(), 1u);
}

TEST(UploadSource, AScanLargerThanTheQueueIsTakenAlone) {
  UploadSource source(0, 0, {}, small_queue());
  EXPECT_EQ(source.put(scan_of(0, 11)), Put::kTaken);
}

TEST(UploadSource, OfTwoThatWaitWithTheSameScanOneIsTaken) {
  UploadSource source(0, 0, {}, small_queue());
  source.put(scan_of(0));
  source.put(scan_of(1));
  const auto put_2 = [&] { return source.put(scan_of(2)); };
  auto one = std::async(std::launch::async, put_2), other = std::async(std::launch::async, put_2);
  source.next();
  const std::multiset<Put> answers{one.get(), other.get()};
  EXPECT_EQ(answers, (std::multiset<Put>{Put::kTaken, Put::kHadAlready}));
}

TEST(UploadSource, AStopEndsTheWait) {
  std::stop_source stop;
  UploadSource source(0, 0, stop.get_token(), small_queue());
  source.put(scan_of(0));
  source.put(scan_of(1));
  auto third = std::async(std::launch::async, [&] { return source.put(scan_of(2)); });
  stop.request_stop();
  EXPECT_EQ(third.get(), Put::kFull);
  cellmap::test::expect_error(ErrorCode::kCancelled, [&] { source.next(); });
}

TEST(UploadSource, CompletionEndsTheWait) {
  UploadSource source(0, 0, {}, small_queue());
  source.put(scan_of(0));
  source.put(scan_of(1));
  auto third = std::async(std::launch::async, [&] { return source.put(scan_of(2)); });
  source.complete();
  EXPECT_EQ(third.get(), Put::kEnded);
}

}  // namespace
}  // namespace cellmap::server
