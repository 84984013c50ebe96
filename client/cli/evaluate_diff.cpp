#include <CLI/CLI.hpp>
#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/evaluate_verbs.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/simulated_days.hpp"

namespace cellmap::cli {
namespace {

struct EvaluateDiffArguments {
  TwoDays days;
  std::vector<std::string> only;
};

struct LaneScenario {
  const char* name;
  double lateral_offset_m;
};
constexpr LaneScenario kScenarios[] = {{"same_lane", 0}, {"other_lane", 3.5}};

double share(std::size_t part, std::size_t whole) {
  return whole == 0 ? 0 : static_cast<double>(part) / static_cast<double>(whole);
}

client::Json to_json(const ChangeCount& count) {
  return {{"patches", count.patches},
          {"never_seen_share", share(count.never_seen, count.patches)},
          {"claimed", count.claimed},
          {"right", count.right},
          {"precision", share(count.right, count.claimed)},
          {"in_sight", count.in_sight},
          {"found", count.found},
          {"recall", share(count.found, count.in_sight)}};
}

client::Json to_json(const ChangeScore& score) {
  client::Json json = to_json(score.total());
  json["by_range"] = client::Json::array();
  for (std::size_t bin = 0; bin < score.by_range.size(); ++bin) {
    client::Json row = to_json(score.by_range[bin]);
    row["to_m"] = ChangeScore::kStep_m * static_cast<double>(bin + 1);
    json["by_range"].push_back(std::move(row));
  }
  return json;
}

std::string line(const std::string& label, const ChangeCount& count) {
  return format("  %-20s %10zu %9.1f %% %8zu %9.1f %% %9zu %7.1f %%\n", label.c_str(),
                count.patches, 100 * share(count.never_seen, count.patches), count.claimed,
                100 * share(count.right, count.claimed), count.in_sight,
                100 * share(count.found, count.in_sight));
}

std::string score_text(const std::string& name, const ChangeScore& score) {
  std::string text = line(name, score.total());
  for (std::size_t bin = 0; bin < score.by_range.size(); ++bin) {
    text += line(format("  %.0f to %.0f m", ChangeScore::kStep_m * static_cast<double>(bin),
                        ChangeScore::kStep_m * static_cast<double>(bin + 1)),
                 score.by_range[bin]);
  }
  return text;
}

struct Scored {
  std::size_t cells = 0, pairs = 0, regions = 0;
  double diff_ms = 0;
  ChangeScore vanished, appeared;
};

Scored score(const TwoDays& town, const Console& console) {
  const Interrupt interrupt;
  ProgressBar bar(console, "simulate");
  const SimulatedDays days =
      simulate_two_days(town, interrupt.token(), [&](const Progress& progress) {
        bar.update(progress.scans_done, progress.scans_total, "scans");
      });
  DiffOptions options;
  options.threads = town.threads;
  const auto begun = std::chrono::steady_clock::now();
  const SessionDiff diff = diff_sessions(days.earlier.cells, days.later.cells, days.targets(),
                                         options, interrupt.token());
  Scored scored;
  scored.diff_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begun).count();
  scored.cells = days.earlier.cells.size() + days.later.cells.size();
  scored.pairs = diff.pairs;
  scored.regions = diff.regions.size();
  scored.vanished = score_changes(days.earlier, diff.earlier, days.later, options);
  scored.appeared = score_changes(days.later, diff.later, days.earlier, options);
  return scored;
}

void run_evaluate_diff(const EvaluateDiffArguments& options, const Console& console) {
  client::Json scenarios = client::Json::object();
  std::string text = format(
      "Simulated; poses off by %.2f m and %.2f deg a CELL.\n  %-20s %10s %11s %8s %11s %9s %9s\n",
      options.days.pose_error_m, options.days.pose_error_deg, "", "patches", "never seen",
      "claimed", "precision", "in sight", "recall");
  for (const LaneScenario& scenario : kScenarios) {
    if (!options.only.empty() &&
        std::ranges::find(options.only, scenario.name) == options.only.end())
      continue;
    TwoDays days = options.days;
    days.lateral_offset_m = scenario.lateral_offset_m;
    const Scored scored = score(days, console);
    scenarios[scenario.name] = {
        {"cells", scored.cells},
        {"pairs", scored.pairs},
        {"regions", scored.regions},
        {"pair_ms", scored.diff_ms / static_cast<double>(std::max<std::size_t>(1, scored.pairs))},
        {"vanished", to_json(scored.vanished)},
        {"appeared", to_json(scored.appeared)}};
    text += format("%s: %zu CELLs, %zu pairs, %zu regions, %.1f ms a pair\n", scenario.name,
                   scored.cells, scored.pairs, scored.regions,
                   scored.diff_ms / static_cast<double>(std::max<std::size_t>(1, scored.pairs))) +
            score_text("vanished", scored.vanished) + score_text("appeared", scored.appeared);
  }
  console.print({{"simulated", true},
                 {"pose_error_m", options.days.pose_error_m},
                 {"pose_error_deg", options.days.pose_error_deg},
                 {"scenarios", std::move(scenarios)}},
                text);
}

}  // namespace

void add_evaluate_diff(CLI::App& group, Verbs& verbs) {
  const auto options = std::make_shared<EvaluateDiffArguments>();
  TwoDays& days = options->days;
  CLI::App* verb = verbs.add(
      group, "diff",
      "Precision and recall of changes between two simulated days: the same town, other cars",
      "  cellmap evaluate diff --json\n"
      "  cellmap evaluate diff --length 1000 --threads 0\n"
      "A patch that is called vanished or appeared is right where it lies on a vehicle and the\n"
      "other day has nothing within 0.3 m; recall is over those that a CELL of the other day had "
      "in\n"
      "free sight. Simulated figures.\n",
      [options](const Console& console) { run_evaluate_diff(*options, console); });
  verb->add_option("--route", days.route, "\"town\", \"city\" or a trajectory file")
      ->capture_default_str();
  verb->add_option("--length", days.length_m, "Metres of the route; 0: all")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  verb->add_option("--lidar", days.lidar, "hdl64e, os1-64 or vlp16")->capture_default_str();
  verb->add_option("--lattice-size", days.lattice_size, "N of the lattice")->capture_default_str();
  verb->add_option("--pose-error", days.pose_error_m,
                   "Of the second day's CELLs in the map, standard deviation, metres")
      ->check(CLI::Range(0.0, 10.0))
      ->capture_default_str();
  verb->add_option("--pose-error-deg", days.pose_error_deg, "The same, degrees")
      ->check(CLI::Range(0.0, 45.0))
      ->capture_default_str();
  verb->add_option("--only", options->only, "same_lane or other_lane; may be repeated")
      ->allow_extra_args(false);
  verb->add_option("--seed", days.seed, "Of the town")->capture_default_str();
  verb->add_option("--threads", days.threads, "0: all")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
}

}  // namespace cellmap::cli
