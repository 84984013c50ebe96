#include "cellmap/pipeline/make_cells.hpp"

#include <condition_variable>
#include <future>
#include <mutex>
#include <optional>
#include <utility>

#include "cellmap/core/progress.hpp"

namespace cellmap {
namespace {

/// One finished CELL on its way from one thread to another.
class Handover {
 public:
  /// Waits for room. False where nobody takes any more.
  bool put(FinishedCell&& cell) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return closed_ || !cell_; });
    if (closed_) return false;
    cell_ = std::move(cell);
    changed_.notify_all();
    return true;
  }

  /// nullopt where it is closed and empty.
  std::optional<FinishedCell> take() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return closed_ || cell_; });
    changed_.notify_all();
    return std::exchange(cell_, std::nullopt);
  }

  void close() {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    changed_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<FinishedCell> cell_;
  bool closed_ = false;
};

void feed(ScanSource& source, FrontEnd& front_end, const CellSink& sink,
          const std::stop_token& stop, const HandOn& hand_on) {
  while (const auto scan = source.next()) {
    throw_if_stopped(stop);
    auto cell = front_end.add(*scan);
    if (cell && !hand_on(std::move(*cell))) return;
    if (sink.on_scan) sink.on_scan(*scan);
  }
}

}  // namespace

void feed_cells(const CellFeed& feed, bool ahead,
                const std::function<void(FinishedCell&&)>& on_cell,
                const std::function<void()>& interrupt) {
  if (!ahead) {
    return feed([&](FinishedCell&& cell) {
      on_cell(std::move(cell));
      return true;
    });
  }
  Handover handover;
  auto fed = std::async(std::launch::async, [&] {
    try {
      feed([&](FinishedCell&& cell) { return handover.put(std::move(cell)); });
    } catch (...) {
      handover.close();
      throw;
    }
    handover.close();
  });
  try {
    while (auto cell = handover.take()) on_cell(std::move(*cell));
  } catch (...) {
    handover.close();
    interrupt();
    fed.wait();
    throw;
  }
  fed.get();
}

void make_cells(ScanSource& source, FrontEnd& front_end, bool ahead, const CellSink& sink,
                const std::stop_token& stop) {
  feed_cells([&](const HandOn& hand_on) { feed(source, front_end, sink, stop, hand_on); }, ahead,
             sink.on_cell, [&] { source.interrupt(); });
}

bool make_part(ScanSource& source, FrontEnd front_end, const DriveStretch& part,
               const HandOn& hand_on, const std::stop_token& stop) {
  source.seek(part.first_scan);
  front_end.begin_at(part.sequence);
  for (std::uint64_t i = 0; i < part.scan_count; ++i) {
    throw_if_stopped(stop);
    const auto scan = source.next();
    if (!scan) break;
    auto cell = front_end.add(*scan);
    if (cell && !hand_on(std::move(*cell))) return false;
  }
  auto last = front_end.finish();
  return !last || hand_on(std::move(*last));
}

}  // namespace cellmap
