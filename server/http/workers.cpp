#include "server/http/workers.hpp"

namespace cellmap::server {

bool Workers::put(Work work) {
  const std::lock_guard lock(mutex_);
  const bool can_grow = threads_.size() < max_threads_;
  if (idle_ <= waiting_.size()) {
    if (!can_grow && waiting_.size() - idle_ >= max_waiting_) return false;
    if (can_grow) threads_.emplace_back([this] { this->work(); });
  }
  waiting_.push_back(std::move(work));
  ready_.notify_one();
  return true;
}

void Workers::finish() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
    ready_.notify_all();
  }
  for (auto& thread : threads_) thread.join();
  threads_.clear();
}

void Workers::work() {
  for (;;) {
    Work work;
    {
      std::unique_lock lock(mutex_);
      ++idle_;
      ready_.wait(lock, [&] { return ending_ || !waiting_.empty(); });
      --idle_;
      if (waiting_.empty()) return;
      work = std::move(waiting_.front());
      waiting_.pop_front();
    }
    work();
  }
}

}  // namespace cellmap::server
