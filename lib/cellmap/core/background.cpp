#include "cellmap/core/background.hpp"

#include <sys/resource.h>

#include <chrono>
#include <exception>
#include <memory>
#include <thread>

namespace cellmap {
namespace {

/// Others get three times as much: requests then hardly notice, and nobody starves.
constexpr int kLess = 5;
/// What a request that takes as long hardly notices.
constexpr std::chrono::microseconds kPiece(250);

}  // namespace

void run_in_background(const std::function<void(const GiveWay& give_way)>& work) {
  std::exception_ptr failure;
  // Its own thread: without privileges nobody can raise a priority again.
  std::thread([&] {
    setpriority(PRIO_PROCESS, 0, getpriority(PRIO_PROCESS, 0) + kLess);  // of this thread
    const auto yield = std::make_shared<TimedYield>(kPiece);
    try {
      work(GiveWay([yield] { (*yield)(); }));
    } catch (...) {
      failure = std::current_exception();
    }
  }).join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace cellmap
