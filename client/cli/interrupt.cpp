#include "client/cli/interrupt.hpp"

#include <unistd.h>

#include <ctime>

namespace cellmap::cli {
namespace {

void wait_for_signals(const std::stop_token& ended, sigset_t signals, std::stop_source stop) {
  constexpr std::timespec kLook{0, 50'000'000};
  while (!ended.stop_requested()) {
    if (::sigtimedwait(&signals, nullptr, &kLook) < 0) continue;
    if (!stop.request_stop()) ::_exit(130);
  }
}

}  // namespace

Interrupt::Interrupt() {
  sigset_t signals;
  ::sigemptyset(&signals);
  ::sigaddset(&signals, SIGINT);
  ::sigaddset(&signals, SIGTERM);
  ::pthread_sigmask(SIG_BLOCK, &signals, &before_);
  waiter_ = std::jthread(wait_for_signals, signals, stop_);
}

Interrupt::~Interrupt() {
  waiter_.request_stop();
  waiter_.join();
  ::pthread_sigmask(SIG_SETMASK, &before_, nullptr);
}

}  // namespace cellmap::cli
