#pragma once

#include <chrono>
#include <iosfwd>
#include <optional>
#include <string>

#include "cellmap/client/json.hpp"

namespace cellmap::cli {

/// Where a verb's words go: results to one stream (as text for people or as one JSON document),
/// progress and warnings to the other.
struct Console {
  std::ostream& out;
  std::ostream& err;
  bool json = false;      ///< --json
  bool progress = false;  ///< --progress, or the error stream is a terminal
  bool terminal = false;  ///< the error stream is one: a bar may redraw its line

  /// Prints the result: `document` with --json, else `text`.
  void print(const client::Json& document, const std::string& text) const;
};

/// One line of progress: a bar, counts and the time left. Redraws itself on a terminal, else writes
/// a line every few seconds; silent where progress was not asked for. Ends its line when destroyed.
class ProgressBar {
 public:
  ProgressBar(const Console& console, std::string label);
  ~ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  /// `total` 0: not known. `note` stands behind the counts. `eta_s`: where the caller knows better
  /// than this bar's own pace.
  void update(std::uint64_t done, std::uint64_t total, const std::string& note = "",
              std::optional<double> eta_s = {});

 private:
  using Clock = std::chrono::steady_clock;

  const Console& console_;
  std::string label_;
  Clock::time_point begun_;
  std::optional<Clock::time_point> drawn_;
  std::size_t width_ = 0;
};

/// The text of a progress line, for example "ingest [#####     ] 50 % 60/120, 12 CELLs, 0:08 left".
std::string progress_line(const std::string& label, std::uint64_t done, std::uint64_t total,
                          const std::string& note, std::optional<double> eta_s);

/// "1,234,567", and "12.3 MB" (powers of 1000).
std::string with_commas(std::uint64_t number);
std::string human_bytes(double bytes);
/// printf to a string.
[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...);

}  // namespace cellmap::cli
