#pragma once

#include <csignal>
#include <stop_token>
#include <thread>

namespace cellmap::cli {

/// While it lives, Ctrl-C (SIGINT) and SIGTERM request a stop instead of ending the process; a
/// second one ends it with code 130. Make it before other threads, in the main thread: it blocks
/// the signals and waits for them in a thread of its own.
class Interrupt {
 public:
  Interrupt();
  ~Interrupt();
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  std::stop_token token() const { return stop_.get_token(); }

 private:
  std::stop_source stop_;
  sigset_t before_{};
  std::jthread waiter_;
};

}  // namespace cellmap::cli
