#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "cellmap/core/error.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "client/cli/evaluate_recorded.hpp"
#include "client/cli/evaluate_simulated.hpp"
#include "client/cli/evaluate_verbs.hpp"
#include "client/cli/interrupt.hpp"

namespace cellmap::cli {
namespace {

struct EvaluateRelocalisationArguments {
  SimulatedTown town;
  std::string cache, data, json_file, trials_file;
  std::vector<std::string> only;
  bool quick = false;
  int threads = 1;
  std::size_t map_cells = 0;
};

/// The store that maps are built in: the cache, or a file that is gone afterwards.
class MapStore {
 public:
  explicit MapStore(const std::string& cache) {
    if (cache.empty()) {
      own_ = std::filesystem::temp_directory_path() /
             format("cellmap-evaluate-%d.db", static_cast<int>(::getpid()));
    }
    store_ = open_sqlite_store(cache.empty() ? own_.string() : cache);
  }
  ~MapStore() {
    store_.reset();
    std::error_code ignored;
    if (own_.empty()) return;
    for (const char* suffix : {"", "-wal", "-shm"}) {
      std::filesystem::remove(own_.string() + suffix, ignored);
    }
  }
  MapStore(const MapStore&) = delete;
  MapStore& operator=(const MapStore&) = delete;

  Store& operator*() const { return *store_; }

 private:
  std::filesystem::path own_;
  std::unique_ptr<Store> store_;
};

/// One row a trial, for those who want to see which queries fail.
class TrialsFile {
 public:
  explicit TrialsFile(const std::string& file) {
    if (file.empty()) return;
    stream_.open(file);
    if (!stream_) throw Error(ErrorCode::kIo, "cannot write " + file);
    stream_ << "scenario,mapped,accepted,confidence,error_m,error_deg,query_ms,distance_m,"
               "lateral_m,points,hits,inliers_all,inliers_hit,in_front,beyond,median_residual_m,"
               "structure_points,structure_inliers,structure_in_front,planes,confirmed,"
               "seen_through,weakest_share\n";
  }

  void add(const std::string& scenario, const Asked& asked) {
    if (!stream_.is_open()) return;
    const RelocalisationTrial& t = asked.trial;
    stream_ << scenario
            << format(",%d,%d,%.4f,%.4f,%.4f,%.2f,%.2f,%.2f", t.mapped, t.accepted, t.confidence,
                      t.error_m, t.error_deg, t.query_ms, t.distance_m, t.lateral_m);
    const RelocalisationCandidate best = asked.best.value_or(RelocalisationCandidate{});
    const RegistrationScores& r = best.registration.scores;
    const StructureScores& s = best.structure;
    stream_ << format(",%u,%u,%.4f,%.4f,%.4f,%.4f,%.4f", r.points, r.hits, r.inlier_ratio_all,
                      r.inlier_ratio_hit, r.share_in_front, r.share_beyond, r.median_residual_m)
            << format(",%u,%.4f,%.4f,%u,%.4f,%.4f,%.4f\n", s.points, s.inlier_ratio,
                      s.share_in_front, s.planes, s.confirmed_ratio, s.share_seen_through,
                      best.registration.degeneracy.weakest_share);
  }

 private:
  std::ofstream stream_;
};

/// Runs scenarios one after the other and keeps their trials.
class Evaluation {
 public:
  Evaluation(const EvaluateRelocalisationArguments& options, const Console& console)
      : options_(options), console_(console), trials_(options.trials_file) {
    relocalise_.threads = options.threads;
  }

  bool is_wanted(const std::string& scenario) const {
    return options_.only.empty() ||
           std::any_of(options_.only.begin(), options_.only.end(),
                       [&](const std::string& name) { return scenario.starts_with(name); });
  }

  void run_simulated(Store& store, const std::stop_token& stop) {
    const auto names = simulated_scenarios();
    if (std::none_of(names.begin(), names.end(), [&](const auto& n) { return is_wanted(n); }))
      return;
    KnownMap map = [&] {
      ProgressBar bar(console_, "simulated map");
      return load_known_map(store, build_simulated(store, options_.town, stop, shown_on(bar)));
    }();
    map.grow_to(options_.map_cells, options_.town.seed);
    std::vector<Scenario> of_map;
    for (const std::string& name : names) {
      if (!is_wanted(name)) continue;
      ProgressBar bar(console_, name);
      const std::size_t total =
          name == "elsewhere" ? options_.town.elsewhere : options_.town.queries;
      simulated_queries(options_.town, name, stop, [&](const KnownQuery& query) {
        add(of_map, name, {}, ask(map, query, relocalise_));
        bar.update(of_map.back().trials.size(), total);
      });
    }
    report(of_map);
  }

  void run_recorded(Store& store, const std::stop_token& stop) {
    if (options_.data.empty()) return;
    for (const RecordedDrive& drive : recorded_drives(options_.data)) {
      if (!is_wanted(drive.name)) continue;
      const KnownMap map = [&] {
        ProgressBar bar(console_, drive.name + " map");
        build_recorded(store, options_.data, drive, stop, shown_on(bar));
        return load_known_map(store, drive.name);
      }();
      std::vector<Scenario> of_map;
      ProgressBar bar(console_, drive.name);
      std::size_t done = 0;
      recorded_queries(options_.data, drive, map, stop,
                       [&](const std::string& name, const KnownQuery& query) {
                         add(of_map, name, drive.limits, ask(map, query, relocalise_));
                         bar.update(++done, 0);
                       });
      report(of_map);
    }
  }

  void print() const {
    client::Json json = client::Json::object();
    for (const RelocalisationReport& report : reports_) {
      json[report.scenario] = client::parse_json(to_json(report));
    }
    if (!options_.json_file.empty()) {
      std::ofstream file(options_.json_file);
      file << client::dump(json) << '\n';
      if (!file.flush()) throw Error(ErrorCode::kIo, "cannot write " + options_.json_file);
    }
    Console console = console_;
    console.json &= options_.json_file.empty();
    console.print(json, to_table(reports_));
  }

 private:
  static ProgressCallback shown_on(ProgressBar& bar) {
    return [&bar](const Progress& p) {
      bar.update(p.scans_done, p.scans_total, std::to_string(p.cells_done) + " CELLs");
    };
  }

  void add(std::vector<Scenario>& scenarios, const std::string& name,
           const RelocalisationLimits& limits, const Asked& asked) {
    auto scenario = std::find_if(scenarios.begin(), scenarios.end(),
                                 [&](const Scenario& s) { return s.name == name; });
    if (scenario == scenarios.end()) {
      scenario = scenarios.insert(scenario, {name, {}, limits});
    }
    scenario->trials.push_back(asked.trial);
    trials_.add(name, asked);
  }

  /// The scenarios of one map share what its most believed wrong answer was.
  void report(const std::vector<Scenario>& scenarios) {
    double wrong = 0;
    for (const Scenario& s : scenarios) {
      wrong = std::max(wrong, highest_wrong_confidence(s.trials, s.limits));
    }
    for (const Scenario& s : scenarios) {
      reports_.push_back(summarise(s.name, s.trials, s.limits, wrong));
    }
  }

  const EvaluateRelocalisationArguments& options_;
  const Console& console_;
  TrialsFile trials_;
  RelocaliseOptions relocalise_;
  std::vector<RelocalisationReport> reports_;
};

void run_evaluate_relocalisation(EvaluateRelocalisationArguments options, const Console& console) {
  const Interrupt interrupt;
  if (options.quick) {
    options.town.queries = std::min<std::size_t>(options.town.queries, 40);
    options.town.elsewhere = std::min<std::size_t>(options.town.elsewhere, 100);
  }
  options.town.threads = options.threads;
  const MapStore store(options.cache);
  Evaluation evaluation(options, console);
  evaluation.run_simulated(*store, interrupt.token());
  evaluation.run_recorded(*store, interrupt.token());
  evaluation.print();
}

void add_town_options(CLI::App& verb, SimulatedTown& town) {
  const std::string group = "Simulation";
  verb.add_option("--route", town.route, "city (3.7 km), town (1 km) or a trajectory file")
      ->capture_default_str()
      ->group(group);
  verb.add_option("--length", town.length_m, "Of the route, metres; 0: all")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str()
      ->group(group);
  verb.add_option("--lidar", town.lidar, "Of the map: hdl64e, os1-64 or vlp16")
      ->capture_default_str()
      ->group(group);
  verb.add_option("--query-lidar", town.query_lidar, "Of the queries (default: the map's)")
      ->group(group);
  verb.add_option("--lattice-size", town.lattice_size, "Of the map")
      ->check(CLI::Range(1000, 1'000'000))
      ->capture_default_str()
      ->group(group);
  verb.add_option("--seed", town.seed, "Of the town")->capture_default_str()->group(group);
  verb.add_option("--queries", town.queries, "A scenario")->capture_default_str()->group(group);
  verb.add_option("--elsewhere", town.elsewhere, "Queries from places that are not in the map")
      ->capture_default_str()
      ->group(group);
}

}  // namespace

void add_evaluate_relocalisation(CLI::App& group, Verbs& verbs) {
  const auto options = std::make_shared<EvaluateRelocalisationArguments>();
  CLI::App* verb = verbs.add(
      group, "relocalisation",
      "Recall, precision, errors and time of relocalisation without a prior, over a simulated map "
      "of 577 CELLs and over recorded drives",
      "  cellmap evaluate relocalisation --quick --cache maps.db\n"
      "  cellmap evaluate relocalisation --json report.json --cache maps.db --threads 0\n"
      "  cellmap evaluate relocalisation --data recordings --only kitti00-keyframes\n"
      "The map takes minutes to simulate; with --cache it is built once.\n",
      [options](const Console& console) { run_evaluate_relocalisation(*options, console); });
  verb->add_option("FILE", options->json_file, "With --json: write the document to this file");
  verb->add_flag("--quick", options->quick, "A sample: 40 queries a scenario, 100 from elsewhere");
  verb->add_option("--only", options->only, "Scenarios whose names begin so; may be repeated")
      ->allow_extra_args(false);
  verb->add_option("--cache", options->cache, "Store file that keeps the maps for the next time");
  verb->add_option("--data", options->data,
                   "Folder of recorded drives: kitti00-keyframes, mulran-kaist03, livox-hku1")
      ->check(CLI::ExistingDirectory);
  verb->add_option("--trials", options->trials_file, "Write every query's outcome as CSV");
  verb->add_option("--map-cells", options->map_cells,
                   "Let the simulated map grow to so many CELLs, most of them invented")
      ->check(CLI::Range(0, 1'000'000))
      ->group("Simulation");
  verb->add_option("--threads", options->threads,
                   "Of the simulator and of each query; 0: all. With 1, times are processor time")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  add_town_options(*verb, options->town);
}

}  // namespace cellmap::cli
