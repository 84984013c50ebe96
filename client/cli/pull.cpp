#include "cellmap/client/pull.hpp"

#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/arguments.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/form_flags.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/map_reader.hpp"

namespace cellmap::cli {
namespace {

struct PullArguments {
  Place place;
  std::string map, folder, near;
  FormFlags form;
  double radius_m = 0, budget_mb = 0;
  bool follow = false;
};

PullOptions pull_options(const PullArguments& options) {
  constexpr double kMegabyte = 1e6;
  PullOptions pull;
  if (options.near.empty() != (options.radius_m == 0)) {
    throw Error(ErrorCode::kInvalidArgument, "--near \"x,y,z\" and --radius METRES go together");
  }
  if (!options.near.empty()) {
    const auto near = parse_numbers<3>("--near", "x,y,z", options.near);
    pull.near = Eigen::Vector3d(near[0], near[1], near[2]);
    pull.radius_m = options.radius_m;
  }
  pull.form = options.form.form();
  pull.budget_bytes = static_cast<std::uint64_t>(options.budget_mb * kMegabyte);
  pull.validate();
  return pull;
}

client::Json to_json(const PullReport& report, const PullArguments& options) {
  return {{"folder", options.folder},
          {"from_revision", report.from},
          {"revision", report.to},
          {"cells", report.cells},
          {"held", report.held},
          {"fetched", report.fetched},
          {"fetched_bytes", report.fetched_bytes},
          {"moved", report.moved},
          {"removed", report.removed},
          {"evicted", report.evicted},
          {"received_bytes", report.received_bytes},
          {"started_over", report.started_over}};
}

std::string report_text(const PullReport& report, const PullArguments& options) {
  return format(
      "%s is at revision %llu (was %llu): holds %s of %s CELLs, fetched %s (%s), moved %s, "
      "evicted %s; received %s\n",
      options.folder.c_str(), static_cast<unsigned long long>(report.to),
      static_cast<unsigned long long>(report.from), with_commas(report.held).c_str(),
      with_commas(report.cells).c_str(), with_commas(report.fetched).c_str(),
      human_bytes(double(report.fetched_bytes)).c_str(), with_commas(report.moved).c_str(),
      with_commas(report.evicted).c_str(), human_bytes(double(report.received_bytes)).c_str());
}

void pull_once(const PullArguments& options, const Console& console) {
  Client client = connect(options.place);
  PullOptions pull = pull_options(options);
  PullReport report;
  {
    ProgressBar bar(console, "pull");
    pull.on_cell = [&](std::size_t done, std::size_t total) { bar.update(done, total, "CELLs"); };
    report = pull_map(client, options.map, options.folder, pull);
  }
  console.print(to_json(report, options), report_text(report, options));
}

/// One line for each pull that changed something, so that a pipe can be read line by line.
void follow_map(const PullArguments& options, const Console& console) {
  const Interrupt interrupt;
  Client client = connect(options.place);
  FollowOptions follow;
  follow.pull = pull_options(options);
  follow.on_pull = [&](const PullReport& report) {
    console.out << (console.json ? client::dump(to_json(report, options), false) + "\n"
                                 : report_text(report, options))
                << std::flush;
  };
  follow.on_away = [&](const Error& error, std::chrono::milliseconds delay) {
    console.err << "cellmap pull: " << error.what()
                << format("; the mirror stays as it is, next try in %.1f s\n",
                          static_cast<double>(delay.count()) / 1000)
                << std::flush;
  };
  follow_map(client, options.map, options.folder, follow, interrupt.token());
}

}  // namespace

void add_pull(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<PullArguments>();
  CLI::App* verb = verbs.add(
      app, "pull", "Mirror a map, or what is near a robot, into a folder; again: only what changed",
      "  cellmap pull town town-mirror --server http://127.0.0.1:8080\n"
      "  cellmap pull town here --server URL --follow --near 10,20,0 --radius 150 --budget 200\n"
      "  cellmap pull town thin --server URL --encoding compact --bound 20mm\n"
      "Then, with or without the server:\n"
      "  cellmap relocalise scan.bin --map town --mirror here\n"
      "Each update after the first takes a few kB: poses, no CELLs that are there already. With\n"
      "--follow it goes on until Ctrl-C, a line (with --json an object) for every update, and "
      "waits\n"
      "for a server that is away.\n",
      [options](const Console& console) {
        options->follow ? follow_map(*options, console) : pull_once(*options, console);
      });
  verb->add_option("MAP", options->map, "Name of the map")->required();
  verb->add_option("DIR,--out", options->folder, "Folder of the mirror")->required();
  verb->add_flag("--follow", options->follow, "Keep the folder up to date until stopped");
  verb->add_option("--near", options->near, "Only CELLs around this place, \"x,y,z\", map frame");
  verb->add_option("--radius", options->radius_m, "... within this many metres")
      ->check(CLI::PositiveNumber);
  verb->add_option("--budget", options->budget_mb,
                   "Most megabytes of CELL files; beyond it the furthest go (default: no limit)")
      ->check(CLI::PositiveNumber);
  add_form_flags(*verb, options->form,
                 "In which form CELLs come and are kept; without it raw, or compact as the map is");
  add_place_options(*verb, options->place, false);
}

}  // namespace cellmap::cli
