#include "cellmap/client/event_stream.hpp"

namespace cellmap::client {
namespace {
constexpr std::size_t kMaxEventBytes = 1u << 20;
}

void EventStreamParser::feed(std::string_view piece,
                             const std::function<void(const ServerEvent&)>& on_event) {
  while (!piece.empty()) {
    const auto end = piece.find('\n');
    const std::string_view part = piece.substr(0, end);
    if (line_.size() + event_.data.size() + part.size() > kMaxEventBytes) {
      too_long_ = true;
    } else {
      line_ += part;
    }
    if (end == std::string_view::npos) return;
    piece.remove_prefix(end + 1);
    if (line_.ends_with('\r')) line_.pop_back();
    take_line(line_, on_event);
    line_.clear();
  }
}

void EventStreamParser::take_line(std::string_view line,
                                  const std::function<void(const ServerEvent&)>& on_event) {
  if (line.empty()) {
    if (has_data_ && !too_long_) on_event(event_);
    event_ = {};
    has_data_ = too_long_ = false;
    return;
  }
  const auto colon = line.find(':');
  const std::string_view field = line.substr(0, colon);
  std::string_view value = colon == std::string_view::npos ? "" : line.substr(colon + 1);
  if (value.starts_with(' ')) value.remove_prefix(1);
  if (field == "event") event_.type = value;
  if (field == "data") {
    if (has_data_) event_.data += '\n';
    event_.data += value;
    has_data_ = true;
  }
}

}  // namespace cellmap::client
