#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/command_line.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/job_text.hpp"
#include "client/cli/map_reader.hpp"
#include "client/cli/map_text.hpp"

namespace cellmap::cli {
namespace {

struct MergeArguments {
  Place place;
  std::string map, from, into;
  std::set<std::string> sessions;
};

void merge(const MergeArguments& options, const Console& console) {
  const Interrupt interrupt;
  Client client = connect(options.place);
  Job job = client.merge(options.map, options.from, options.sessions);
  {
    ProgressBar bar(console, "merge");
    job = client.follow_job(
        job.id, [&](const Job& latest) { show(bar, latest); }, interrupt.token());
  }
  if (!is_final(job.state)) {
    throw Error(ErrorCode::kCancelled, "stopped watching; job " + std::to_string(job.id.value) +
                                           " goes on in the server (cellmap jobs follow)");
  }
  throw_unless_succeeded(job);
  client::Json sessions = client::Json::array();
  std::string text;
  for (const Session& session : client.sessions(options.map)) {
    sessions.push_back(client::to_json(session));
    text += session_line(session);
  }
  console.print({{"job", client::to_json(job)}, {"sessions", sessions}}, text);
}

void split(const MergeArguments& options, const Console& console) {
  const MapInfo map = connect(options.place).split(options.map, options.sessions, options.into);
  console.print(client::to_json(map), map_text(map));
}

}  // namespace

void add_merge(CLI::App& app, Verbs& verbs) {
  const auto merged = std::make_shared<MergeArguments>();
  CLI::App* verb = verbs.add(
      app, "merge", "Copy the sessions of another map into a map and join them to it",
      "  cellmap merge town --from east-wing --server http://127.0.0.1:8080\n"
      "Sessions that are found nowhere in the map stay unaligned: see 'cellmap sessions'.\n",
      [merged](const Console& console) { merge(*merged, console); });
  verb->add_option("MAP", merged->map, "Name of the map that grows")->required();
  verb->add_option("--from", merged->from, "Name of the other, which stays as it is")->required();
  verb->add_option("--sessions", merged->sessions, "Only these, separated by commas")
      ->delimiter(',');
  add_place_options(*verb, merged->place, false);

  const auto divided = std::make_shared<MergeArguments>();
  CLI::App* division =
      verbs.add(app, "split", "Move sessions of a map into a new map",
                "  cellmap split town --sessions robot3 --into basement --server URL\n"
                "Revisions of the map before the split can no longer be read.\n",
                [divided](const Console& console) { split(*divided, console); });
  division->add_option("MAP", divided->map, "Name of the map that they leave")->required();
  division->add_option("--sessions", divided->sessions, "Their names, separated by commas")
      ->delimiter(',')
      ->required();
  division->add_option("--into", divided->into, "Name of the new map")->required();
  add_place_options(*division, divided->place, false);
}

}  // namespace cellmap::cli
