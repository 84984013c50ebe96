#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/command_line.hpp"
#include "client/cli/map_reader.hpp"
#include "client/cli/map_text.hpp"

namespace cellmap::cli {
namespace {

struct SessionsArguments {
  Place place;
  std::string map, deleted;
};

void list_sessions(const SessionsArguments& options, const Console& console) {
  if (!options.deleted.empty()) connect(options.place).delete_session(options.map, options.deleted);
  client::Json json = client::Json::array();
  std::string text;
  for (const Session& session : connect(options.place).sessions(options.map)) {
    json.push_back(client::to_json(session));
    text += session_line(session);
  }
  console.print({{"sessions", json}}, text.empty() ? "No sessions.\n" : text);
}

}  // namespace

void add_sessions(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<SessionsArguments>();
  CLI::App* verb =
      verbs.add(app, "sessions", "The drives in a map, and which are in its frame; delete one",
                "  cellmap sessions town --server http://127.0.0.1:8080\n",
                [options](const Console& console) { list_sessions(*options, console); });
  verb->add_option("MAP", options->map, "Name of the map")->required();
  verb->add_option("--delete", options->deleted,
                   "First remove this one with its CELLs; older revisions can then not be read");
  add_place_options(*verb, options->place, false);
}

}  // namespace cellmap::cli
