#pragma once

#include <stop_token>

#include "cellmap/core/error.hpp"
#include "cellmap/core/progress.hpp"

namespace cellmap::server {

/// How often a change that somebody waits for is begun anew.
inline constexpr int kMaxRedos = 20;

/// Calls `change`, which reads a map and commits with the revision that it read as the expected
/// one: anew as long as another server commits in between. Every time somebody else got ahead, so
/// the fleet does. Throws Error{kCancelled} when stopped.
template <typename Change>
auto redo_until_current(const std::stop_token& stop, const Change& change) {
  for (;;) {
    try {
      return change();
    } catch (const Error& error) {
      if (error.code() != ErrorCode::kPreconditionFailed) throw;
    }
    throw_if_stopped(stop);
  }
}

/// The same for a request: Error{kUnavailable} when it was overtaken for the kMaxRedos-th time.
template <typename Change>
auto redo_a_few_times(const Change& change) {
  for (int i = 1;; ++i) {
    try {
      return change();
    } catch (const Error& error) {
      if (error.code() != ErrorCode::kPreconditionFailed) throw;
      if (i == kMaxRedos) {
        throw Error(ErrorCode::kUnavailable,
                    "Other servers change the map all the time; try again later.");
      }
    }
  }
}

}  // namespace cellmap::server
