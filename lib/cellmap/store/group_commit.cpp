#include "cellmap/store/group_commit.hpp"

#include <algorithm>

namespace cellmap {

void GroupCommit::run(std::function<void()> work) {
  Write write{std::move(work), nullptr, false};
  std::unique_lock lock(mutex_);
  queue_.push_back(&write);
  changed_.notify_all();
  changed_.wait(lock, [&] { return write.done || queue_.front() == &write; });
  if (!write.done) {
    const std::vector<Write*> batch = next_batch(lock);
    lock.unlock();
    execute_(batch);
    lock.lock();
    writers_ = queue_.size();
    queue_.erase(queue_.begin(), queue_.begin() + static_cast<std::ptrdiff_t>(batch.size()));
    for (Write* const finished : batch) finished->done = true;
    changed_.notify_all();
  }
  lock.unlock();
  if (write.failure) std::rethrow_exception(write.failure);
}

std::size_t GroupCommit::waiting() {
  const std::lock_guard lock(mutex_);
  return queue_.size();
}

std::vector<GroupCommit::Write*> GroupCommit::next_batch(std::unique_lock<std::mutex>& lock) {
  // Those that wrote or waited during the last batch are probably on their way back. A lone writer
  // never waits.
  const std::size_t expected = std::min(writers_, max_batch_);
  changed_.wait_for(lock, max_wait_, [&] { return queue_.size() >= expected; });
  const auto count = static_cast<std::ptrdiff_t>(std::min(queue_.size(), max_batch_));
  return {queue_.begin(), queue_.begin() + count};
}

}  // namespace cellmap
