#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/command_line.hpp"
#include "client/cli/map_reader.hpp"
#include "client/cli/map_text.hpp"

namespace cellmap::cli {
namespace {

struct Options {
  Place place;
  std::string map;
};

void list(const Options& options, const Console& console) {
  client::Json json = client::Json::array();
  std::string text;
  for (const Session& session : connect(options.place).sessions(options.map)) {
    json.push_back(client::to_json(session));
    text += format("%-24s %-16s %-12s %6s CELLs  %s\n", session.name.c_str(),
                   session.robot.empty() ? "-" : session.robot.c_str(),
                   session.sensor.empty() ? "-" : session.sensor.c_str(),
                   with_commas(session.cells).c_str(),
                   session.aligned ? "in the map frame" : "not aligned yet");
  }
  console.print({{"sessions", json}}, text.empty() ? "No sessions.\n" : text);
}

}  // namespace

void add_sessions(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<Options>();
  CLI::App* verb = verbs.add(app, "sessions", "The drives in a map, and which are in its frame",
                             "  cellmap sessions town --server http://127.0.0.1:8080\n",
                             [options](const Console& console) { list(*options, console); });
  verb->add_option("MAP", options->map, "Name of the map")->required();
  add_place_options(*verb, options->place, false);
}

}  // namespace cellmap::cli
