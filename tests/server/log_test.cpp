#include "server/log.hpp"

#include <gmock/gmock.h>
#include <spdlog/sinks/ostream_sink.h>

#include <sstream>

namespace cellmap::server {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

std::string logged(LogFormat format, const std::string& message) {
  std::ostringstream out;
  auto sink = std::make_shared<spdlog::sinks::ostream_sink_mt>(out);
  sink->set_formatter(make_formatter(format));
  spdlog::logger("test", sink).warn(message);
  return out.str();
}

TEST(Log, ALineOfJsonSaysWhoseRequestAndItsFields) {
  const auto line =
      logged(LogFormat::kJson, with_fields("[id-7] GET \"/x\"\n200", {{"code", 200}}));
  const Json json = Json::parse(line);
  EXPECT_EQ(json.at("request_id"), "id-7");
  EXPECT_EQ(json.at("level"), "warning");
  EXPECT_EQ(json.at("message"), "GET \"/x\"\n200");
  EXPECT_EQ(json.at("code"), 200);
  EXPECT_EQ(json.at("time").get<std::string>().size(), 24u);
  EXPECT_EQ(line.find('\n'), line.size() - 1);
}

TEST(Log, AnyTextIsALineOfJson) {
  for (const std::string& text :
       {std::string("plain"), std::string("[no end"), std::string(""), std::string("\xff\xfe"),
        std::string("a\0b", 3), std::string("a\x1e{no fields")}) {
    const Json json = Json::parse(logged(LogFormat::kJson, text));
    EXPECT_FALSE(json.contains("request_id"));
  }
}

TEST(Log, PeopleSeeTheMessageOnly) {
  const auto line = logged(LogFormat::kText, with_fields("[id] done", {{"code", 200}}));
  EXPECT_THAT(line, HasSubstr("[warning] [id] done"));
  EXPECT_THAT(line, Not(HasSubstr("code")));
}

}  // namespace
}  // namespace cellmap::server
