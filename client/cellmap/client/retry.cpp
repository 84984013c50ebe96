#include "cellmap/client/retry.hpp"

#include <algorithm>
#include <charconv>
#include <thread>

namespace cellmap {

using std::chrono::milliseconds;

void RetryOptions::validate() const {
  if (attempts < 1 || attempts > 100) {
    throw Error(ErrorCode::kInvalidArgument,
                "retry attempts must be 1 to 100, not " + std::to_string(attempts));
  }
  if (first_delay.count() < 0 || max_delay < first_delay || max_retry_after.count() < 0) {
    throw Error(ErrorCode::kInvalidArgument,
                "retry delays must satisfy 0 <= first_delay <= max_delay and 0 <= max_retry_after");
  }
}

bool may_pass(ErrorCode code) {
  return code == ErrorCode::kUnavailable || code == ErrorCode::kRateLimited || is_io(code);
}

RetrySchedule::RetrySchedule(const RetryOptions& options)
    : options_(options),
      random_(options.jitter_seed != 0 ? options.jitter_seed : std::random_device()()) {}

std::optional<milliseconds> RetrySchedule::next_delay(std::optional<milliseconds> retry_after) {
  if (++failures_ >= options_.attempts) return std::nullopt;
  if (retry_after && *retry_after > options_.max_retry_after) return std::nullopt;
  milliseconds delay = options_.first_delay;
  for (int i = 1; i < failures_ && delay < options_.max_delay; ++i) delay *= 2;
  delay = std::min(delay, options_.max_delay);
  std::uniform_int_distribution<milliseconds::rep> draw(delay.count() / 2, delay.count());
  return std::max(milliseconds(draw(random_)), retry_after.value_or(milliseconds(0)));
}

void RetrySchedule::sleep(milliseconds delay) const {
  options_.sleep ? options_.sleep(delay) : std::this_thread::sleep_for(delay);
}

std::optional<milliseconds> parse_retry_after(std::string_view header) {
  constexpr long kDaySeconds = 86'400;
  long seconds = 0;
  const auto [end, error] = std::from_chars(header.data(), header.data() + header.size(), seconds);
  if (error != std::errc() || end != header.data() + header.size() || seconds < 0 ||
      seconds > kDaySeconds) {
    return std::nullopt;
  }
  return milliseconds(seconds * 1000);
}

}  // namespace cellmap
