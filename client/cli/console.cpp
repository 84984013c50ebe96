#include "client/cli/console.hpp"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <ostream>

namespace cellmap::cli {

void Console::print(const client::Json& document, const std::string& text) const {
  out << (json ? client::dump(document) : text);
  out << (json || !text.ends_with('\n') ? "\n" : "") << std::flush;
}

ProgressBar::ProgressBar(const Console& console, std::string label)
    : console_(console), label_(std::move(label)), begun_(Clock::now()) {}

ProgressBar::~ProgressBar() {
  if (drawn_ && console_.terminal) console_.err << '\n' << std::flush;
}

void ProgressBar::update(std::uint64_t done, std::uint64_t total, const std::string& note,
                         std::optional<double> eta_s) {
  if (!console_.progress) return;
  const auto now = Clock::now();
  const auto pause = console_.terminal ? std::chrono::milliseconds(100) : std::chrono::seconds(2);
  if (drawn_ && done != total && now - *drawn_ < pause) return;
  drawn_ = now;
  const double elapsed_s = std::chrono::duration<double>(now - begun_).count();
  if (!eta_s && done > 0 && total > done) {
    eta_s = elapsed_s / static_cast<double>(done) * static_cast<double>(total - done);
  }
  std::string line = progress_line(label_, done, total, note, eta_s);
  const std::size_t length = line.size();
  line.resize(std::max(length, width_), ' ');
  width_ = length;
  console_.err << (console_.terminal ? "\r" : "") << line << (console_.terminal ? "" : "\n")
               << std::flush;
}

std::string progress_line(const std::string& label, std::uint64_t done, std::uint64_t total,
                          const std::string& note, std::optional<double> eta_s) {
  constexpr std::uint64_t kWidth = 30;
  std::string line = label + " ";
  if (total > 0) {
    const std::uint64_t filled = kWidth * std::min(done, total) / total;
    line += "[" + std::string(filled, '#') + std::string(kWidth - filled, ' ') + "] " +
            format("%3.0f %% ", 100.0 * static_cast<double>(std::min(done, total)) / double(total));
  }
  line += std::to_string(done) + (total > 0 ? "/" + std::to_string(total) : "");
  if (!note.empty()) line += ", " + note;
  if (eta_s && std::isfinite(*eta_s)) {
    const long seconds = std::lround(*eta_s);
    line += format(", %ld:%02ld left", seconds / 60, seconds % 60);
  }
  return line;
}

std::string with_commas(std::uint64_t number) {
  const std::string digits = std::to_string(number);
  std::string text;
  for (std::size_t i = 0; i < digits.size(); ++i) {
    if (i > 0 && (digits.size() - i) % 3 == 0) text += ',';
    text += digits[i];
  }
  return text;
}

std::string human_bytes(double bytes) {
  constexpr const char* kUnits[] = {"B", "kB", "MB", "GB", "TB"};
  int unit = 0;
  while (bytes >= 999.95 && unit < 4) {
    bytes /= 1000;
    ++unit;
  }
  return format(unit == 0 ? "%.0f %s" : "%.1f %s", bytes, kUnits[unit]);
}

std::string format(const char* pattern, ...) {
  std::va_list arguments, again;
  va_start(arguments, pattern);
  va_copy(again, arguments);
  std::string text(static_cast<std::size_t>(std::vsnprintf(nullptr, 0, pattern, arguments)), '\0');
  std::vsnprintf(text.data(), text.size() + 1, pattern, again);
  va_end(again);
  va_end(arguments);
  return text;
}

}  // namespace cellmap::cli
