#include "cellmap/pipeline/make_cells.hpp"

#include <gtest/gtest.h>

#include <condition_variable>
#include <mutex>
#include <thread>

#include "cellmap/codec/cell_codec.hpp"
#include "support/expect_error.hpp"
#include "support/town_drive.hpp"

namespace cellmap {
namespace {

using test::TownDrive;

std::vector<ContentHash> hashes(bool ahead) {
  const auto source = TownDrive().open();
  FrontEnd front = test::quick_front_end();
  std::vector<ContentHash> found;
  make_cells(*source, front, ahead, {[&](FinishedCell&& cell) {
    EXPECT_EQ(cell.cell().sequence, found.size());
    found.push_back(encode_cell(cell.cell()).hash);
  }});
  return found;
}

/// Hands out the drive's scans up to `last`, then waits for an interruption, as for a silent robot.
class SilentAfter : public ScanSource {
 public:
  SilentAfter(std::unique_ptr<ScanSource> drive, std::size_t last)
      : drive_(std::move(drive)), last_(last) {}

  std::size_t size() const override { return drive_->size(); }
  std::optional<PosedScan> next() override {
    if (read_++ < last_) return drive_->next();
    std::unique_lock lock(mutex_);
    interruption_.wait(lock, [&] { return interrupted_; });
    throw Error(ErrorCode::kCancelled, "interrupted");
  }
  void seek(std::size_t index) override { drive_->seek(index); }
  void interrupt() override {
    const std::lock_guard lock(mutex_);
    interrupted_ = true;
    interruption_.notify_all();
  }
  const Trajectory& ground_truth() const override { return drive_->ground_truth(); }

 private:
  std::unique_ptr<ScanSource> drive_;
  std::size_t last_, read_ = 0;
  std::mutex mutex_;
  std::condition_variable interruption_;
  bool interrupted_ = false;
};

TEST(MakeCells, ReadingAheadGivesTheSameCells) {
  const auto in_turns = hashes(false);
  EXPECT_GT(in_turns.size(), 5U);
  EXPECT_EQ(hashes(true), in_turns);
}

TEST(MakeCells, TheSinkIsCalledOnTheCallingThreadOnly) {
  const auto source = TownDrive().open();
  FrontEnd front = test::quick_front_end();
  const auto caller = std::this_thread::get_id();
  make_cells(*source, front, true,
             {[&](FinishedCell&&) { EXPECT_EQ(std::this_thread::get_id(), caller); }});
}

TEST(MakeCells, AFailingSinkEndsAReaderThatWaitsForScans) {
  SilentAfter source(TownDrive().open(), 40);
  FrontEnd front = test::quick_front_end();
  const auto act = [&] {
    make_cells(source, front, true,
               {[](FinishedCell&&) { throw Error(ErrorCode::kConflict, "the map changed"); }});
  };
  test::expect_error(ErrorCode::kConflict, act, "the map changed");
}

TEST(MakeCells, WhatWasFinishedBeforeTheSourceFailedIsHandedOn) {
  for (const bool ahead : {false, true}) {
    SilentAfter source(TownDrive().open(), 40);
    source.interrupt();
    FrontEnd front = test::quick_front_end();
    std::uint32_t scans = 0;
    const auto act = [&] {
      make_cells(source, front, ahead,
                 {[&](FinishedCell&& cell) { scans += cell.cell().scan_count; }});
    };
    test::expect_error(ErrorCode::kCancelled, act, "interrupted");
    // The scans since the last whole CELL are at most those of 6 m.
    EXPECT_GT(scans, 0U);
    EXPECT_LE(scans, 40U);
  }
}

}  // namespace
}  // namespace cellmap
