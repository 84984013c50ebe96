#pragma once

#include <functional>
#include <string>
#include <string_view>

namespace cellmap::client {

/// One server-sent event (WHATWG HTML, section 9.2).
struct ServerEvent {
  std::string type = "message";
  std::string data;  ///< data lines joined by line feeds
};

/// Cuts a byte stream into server-sent events, whatever pieces it arrives in. Lines end in LF or
/// CRLF. Comments, ids and unknown fields are ignored. An event above 1 MiB is dropped as a whole.
class EventStreamParser {
 public:
  /// Feeds the next piece; calls `on_event` for each event that it completes.
  void feed(std::string_view piece, const std::function<void(const ServerEvent&)>& on_event);

 private:
  void take_line(std::string_view line, const std::function<void(const ServerEvent&)>& on_event);

  std::string line_;
  ServerEvent event_;
  bool has_data_ = false;
  bool too_long_ = false;
};

}  // namespace cellmap::client
