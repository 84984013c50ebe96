// Measures the product against the paper's way. See run.sh and BENCHMARK.md.
#include <CLI/CLI.hpp>
#include <array>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <set>
#include <thread>

#include "bench/rows.hpp"
#include "cellmap/simd/targets.hpp"

namespace cellmap::bench {
namespace {

/// Half a street of the simulated town; the pair is its beginning, loops come back to it.
constexpr std::size_t kStreetFirst = 20, kStreetScans = 70;

struct Group {
  const char* name;
  void (*rows)(const Setting&, const AddRow&);
  bool computes = true;  ///< with the library's kernels, so that the instruction set matters
  bool by_name = false;  ///< only measured where --only names it: it takes long, or much memory
};
constexpr std::array kGroups = {
    Group{"nearest", nearest_rows},
    Group{"cell", cell_rows},
    Group{"registration", registration_rows},
    Group{"loop", loop_rows},
    Group{"pose_graph", pose_graph_rows, false},
    Group{"codec", codec_rows, false},
    Group{"store", store_rows, false},
    Group{"ingest", ingest_rows},
    Group{"places", place_rows, true, true},
};

Setting make_setting(bool quick) {
  Setting setting;
  setting.quick = quick;
  setting.lattice = std::make_shared<const Lattice>(LatticeSpec{});
  setting.tree = std::make_shared<const LatticeTree>(*setting.lattice);
  setting.simulated = simulated_scans(kStreetFirst, kStreetScans);
  setting.pairs.push_back(make_pair(kSimulated, setting.simulated, setting.lattice));
  const auto kitti = kitti_scans();
  if (!kitti.empty()) setting.pairs.push_back(make_pair(kKitti, kitti, setting.lattice));
  setting.threads = {1};
  if (std::thread::hardware_concurrency() >= 2) setting.threads.push_back(2);
  return setting;
}

struct Flags {
  bool quick = false, kitti00 = false;
  std::string json;
  std::vector<std::string> only;
};

std::vector<Row> run(const Flags& flags) {
  std::vector<Row> rows;
  bool computes = true;
  const AddRow add = [&](Row row) {
    if (computes) row.extra["isa"] = simd::instruction_set();
    std::cerr << row.name << " (" << row.data << ", " << row.threads << " threads): " << row.ours
              << " against " << row.baseline << ' ' << row.unit << '\n';
    rows.push_back(std::move(row));
  };
  const std::set<std::string> only(flags.only.begin(), flags.only.end());
  const Setting setting = make_setting(flags.quick);
  for (const Group& group : kGroups) {
    if (only.empty() ? group.by_name : !only.contains(group.name)) continue;
    const double begin = now_s();
    computes = group.computes;
    group.rows(setting, add);
    std::cerr << "  " << group.name << " rows took " << now_s() - begin << " s\n";
  }
  computes = true;
  if (flags.kitti00) kitti00_ingest_row(add);
  return rows;
}

int main_of(int argc, char** argv) {
  CLI::App app{"Measures CELLmap against the paper's way; prints a Markdown table"};
  Flags flags;
  std::string peak_memory_of;
  std::vector<std::string> places_of, keep_places_of;
  int threads = 1;
  std::set<std::string> names;
  for (const Group& group : kGroups) names.insert(group.name);
  app.add_flag("--quick", flags.quick, "fewer repeats and a short drive: under a minute");
  app.add_flag("--kitti00", flags.kitti00,
               "also map a simulated drive along KITTI 00's route (4,541 scans, many minutes)");
  app.add_option("--json", flags.json, "write the rows to this file as well")->type_name("FILE");
  app.add_option("--only", flags.only, "measure only these groups of rows")
      ->check(CLI::IsMember(names))
      ->delimiter(',');
  app.add_option("--peak-memory-of", peak_memory_of)->group("");
  app.add_option("--places-of", places_of)->expected(2)->group("");
  app.add_option("--keep-places-of", keep_places_of)->expected(2)->group("");
  app.add_option("--threads", threads)->group("");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (!peak_memory_of.empty()) return print_peak_memory_of_build(peak_memory_of, threads);
  if (!keep_places_of.empty()) return keep_places_of_store(keep_places_of[0], keep_places_of[1]);
  if (!places_of.empty()) return print_places_of_store(places_of[0], places_of[1]);

  // Opened first: a wrong name should not cost a minute.
  std::ofstream json;
  if (!flags.json.empty()) {
    json.open(flags.json);
    if (!json) {
      std::cerr << "cannot write " << flags.json << "; name a file in an existing folder\n";
      return 2;
    }
  }
  if (flags.kitti00 && !std::filesystem::exists(kitti00_route())) {
    std::cerr << "--kitti00 needs the route " << kitti00_route().string()
              << "; set CELLMAP_DATA to the folder of the real data\n";
    return 2;
  }
  const std::vector<Row> rows = run(flags);
  std::cout << "Machine: " << machine() << "\n\n" << to_markdown(rows);
  if (json.is_open()) json << to_json(rows).dump(1) << '\n';
  return json.is_open() && !json.flush() ? 2 : 0;
}

}  // namespace
}  // namespace cellmap::bench

int main(int argc, char** argv) {
  try {
    return cellmap::bench::main_of(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "cellmap_bench: " << error.what() << '\n';
    return 1;
  }
}
