#include "server/log.hpp"

#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_color_sinks.h>

#include <chrono>

namespace cellmap::server {
namespace {

constexpr char kFieldsFollow = '\x1e';  // no message holds control characters of its own

std::string_view view(const spdlog::string_view_t& text) { return {text.data(), text.size()}; }

class TextFormatter : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& out) override {
    spdlog::details::log_msg shown = message;
    const auto text = view(message.payload);
    shown.payload = {text.data(), std::min(text.find(kFieldsFollow), text.size())};
    pattern_.format(shown, out);
  }
  std::unique_ptr<spdlog::formatter> clone() const override {
    return std::make_unique<TextFormatter>();
  }

 private:
  spdlog::pattern_formatter pattern_;
};

class JsonFormatter : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& out) override {
    using std::chrono::duration_cast, std::chrono::nanoseconds;
    const auto time = duration_cast<nanoseconds>(message.time.time_since_epoch()).count();
    const auto level = spdlog::level::to_string_view(message.level);
    auto text = view(message.payload);
    Json json{{"time", to_rfc3339(time)}, {"level", std::string(view(level))}};
    const auto fields = text.find(kFieldsFollow);
    const Json more =
        fields == text.npos ? Json() : Json::parse(text.substr(fields + 1), nullptr, false);
    text = text.substr(0, fields);
    const auto end = text.find("] ");
    if (text.starts_with('[') && end != text.npos) {
      json["request_id"] = std::string(text.substr(1, end - 1));
      text.remove_prefix(end + 2);
    }
    json["message"] = std::string(text);
    if (more.is_object()) json.update(more);  // a message from outside may hold anything
    const std::string line = dump(json) + "\n";
    out.append(line.data(), line.data() + line.size());
  }
  std::unique_ptr<spdlog::formatter> clone() const override {
    return std::make_unique<JsonFormatter>();
  }
};

}  // namespace

std::unique_ptr<spdlog::formatter> make_formatter(LogFormat format) {
  if (format == LogFormat::kJson) return std::make_unique<JsonFormatter>();
  return std::make_unique<TextFormatter>();
}

std::shared_ptr<spdlog::logger> make_log(const std::string& level, LogFormat format) {
  auto sink = std::make_shared<spdlog::sinks::stderr_color_sink_mt>();
  sink->set_formatter(make_formatter(format));
  auto log = std::make_shared<spdlog::logger>("cellmapd", std::move(sink));
  log->set_level(spdlog::level::from_str(level));
  return log;
}

std::string with_fields(std::string message, const Json& fields) {
  return std::move(message) + kFieldsFollow + dump(fields);
}

}  // namespace cellmap::server
