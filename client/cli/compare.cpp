#include "client/cli/compare.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/client/comparison.hpp"
#include "cellmap/client/files.hpp"
#include "cellmap/core/progress.hpp"
#include "cellmap/evaluation/comparison.hpp"
#include "cellmap/store/documents.hpp"
#include "client/cli/client_options.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/mapper_flags.hpp"

#ifdef CELLMAP_WITH_PCL
#include "cellmap/pcl/pcl_representations.hpp"
#endif

namespace cellmap::cli {
namespace {

namespace fs = std::filesystem;

struct CompareArguments {
  DriveFlags drive;
  MapperFlags mapper;
  ComparisonOptions comparison;
  std::size_t held_back = 8;
  std::vector<std::string> rows;
  Place place;
  std::string json, html, keep, map;
  CLI::Option* json_option = nullptr;
};

/// A folder of its own that goes with it.
class WorkFolder {
 public:
  WorkFolder() {
    std::string name = (fs::temp_directory_path() / "cellmap-compare-XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) {
      throw Error(ErrorCode::kIo, "cannot make a folder in " + fs::temp_directory_path().string());
    }
    path_ = name;
  }
  ~WorkFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

/// The paper's figure for the neural map, over KITTI 00.
PublishedRow pin_slam() {
  constexpr double kBytes = 102.1e6, kLengthM = 3724.2;
  return {"neural points (PIN-SLAM)", "CELLmap paper, 102.1 MB for 3,724 m of KITTI 00",
          kBytes / kLengthM};
}

/// CELLs in every form; and those of patches without depth, which are the paper's number of planes.
std::vector<Representation> cell_representations(const CompareArguments& options,
                                                 const MapperOptions& mapper) {
  std::vector<CellForm> forms = {{}, {KeptEncoding::kPacked}};
  for (const double bound_m : {0.005, 0.01, 0.02, 0.03, 0.05}) {
    forms.push_back(compact_form(bound_m));
  }
  const LatticeSpec lattice = options.mapper.lattice();
  std::vector<Representation> rows;
  for (const CellForm& form : forms) {
    rows.push_back(cells(form, mapper.cell_distance_m, mapper.build, lattice));
  }
  CellBuildOptions strict = mapper.build;
  strict.max_range_gap_m = 0.2;
  strict.min_points = 12;
  for (const CellForm& form : {forms[0], forms[4], forms[6]}) {
    rows.push_back(cells(form, mapper.cell_distance_m, strict, lattice));
    rows.back().name += ", range gap 0.2 m, 12 points";
  }
  return rows;
}

std::vector<Representation> all_representations(const CompareArguments& options) {
  const MapperOptions mapper = options.mapper.mapper_options(options.comparison.threads);
  std::vector<Representation> all = {raw_points(), raw_points(9)};
  for (const double voxel_m : {0.4, 0.2, 0.1}) all.push_back(voxel_points(voxel_m));
  for (const double step_m : {0.01, 0.05, 0.1}) all.push_back(quantised_voxels(0.4, step_m));
  for (const double step_m : {0.01, 0.05}) all.push_back(quantised_voxels(0.2, step_m));
#ifdef CELLMAP_WITH_PCL
  for (Representation& row : pcl_io::representations()) all.push_back(std::move(row));
#endif
  all.push_back(surfels(0.4));
  all.push_back(surfels(0.2));
  for (Representation& row : cell_representations(options, mapper)) all.push_back(std::move(row));
  return all;
}

/// Those whose names hold one of the words that were given; all where none was.
std::vector<Representation> chosen_representations(const CompareArguments& options) {
  std::vector<Representation> chosen = all_representations(options);
  if (options.rows.empty()) return chosen;
  std::erase_if(chosen, [&](const Representation& row) {
    return std::none_of(options.rows.begin(), options.rows.end(), [&](const std::string& word) {
      return row.name.find(word) != std::string::npos;
    });
  });
  if (chosen.empty()) {
    throw Error(ErrorCode::kInvalidArgument, "--rows: no row's name holds any of these words");
  }
  return chosen;
}

/// The drive's own poses.txt, or the true ones of a folder that has only these.
std::unique_ptr<ScanSource> open_drive(DriveFlags flags) {
  const fs::path folder(flags.dataset);
  if (flags.poses.empty() && !fs::exists(folder / "poses.txt") &&
      fs::exists(folder / "poses_gt.txt")) {
    flags.poses = "poses_gt.txt";
  }
  return flags.open();
}

void put_with_map(const CompareArguments& options, const std::string& json) {
  if (options.place.store.empty()) {
    put_comparison(client_options_of(options.place), options.map, json);
  } else {
    documents_of(*open_existing_store(options.place.store))
        .put_document(options.map, "comparison", json);
  }
}

void run_compare(const CompareArguments& options, const Console& console) {
  const Interrupt interrupt;
  if (!options.map.empty()) open_reader(options.place)->map(options.map);  // before minutes of work
  const std::vector<Representation> representations = chosen_representations(options);
  const MapperOptions mapper = options.mapper.mapper_options(options.comparison.threads);
  const WorkFolder work;
  const fs::path folder = options.keep.empty() ? work.path() : fs::path(options.keep);
  const auto source = open_drive(options.drive);
  ComparedDrive drive;
  {
    ProgressBar bar(console, "read");
    drive = read_compared_drive(*source, mapper.filter, options.held_back,
                                options.drive.poses.empty(), [&](std::size_t done) {
                                  throw_if_stopped(interrupt.token());
                                  bar.update(done, source->size(), "scans");
                                });
  }
  Comparison comparison;
  {
    ProgressBar bar(console, "compare");
    std::size_t done = 0;
    comparison =
        compare(drive, representations, options.comparison, folder, interrupt.token(),
                [&](const std::string& name) { bar.update(done++, representations.size(), name); });
  }
  comparison.dataset = options.drive.session_name();
  if (options.rows.empty()) {
#ifndef CELLMAP_WITH_PCL
    for (const char* name : {"PCL octree", "Draco", "mesh (Poisson)"}) {
      comparison.rows.push_back(missing_row(name, "this build has no PCL (CELLMAP_WITH_PCL)"));
    }
#endif
    comparison.rows.push_back(published_row(pin_slam()));
  }
  const std::string json = to_json(comparison);
  if (!options.json.empty()) client::write_file_atomically(options.json, json + "\n");
  if (!options.html.empty()) client::write_file_atomically(options.html, to_html(comparison));
  if (!options.map.empty()) put_with_map(options, json);
  Console out = console;
  out.json = options.json_option->count() > 0 && options.json.empty();
  out.print(client::Json::parse(json), to_table(comparison));
}

}  // namespace

void add_compare(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<CompareArguments>();
  CLI::App* verb = verbs.add(
      app, "compare", "Measure map representations on a drive: their size and what it costs",
      "  cellmap compare kitti00-dense --angle-correction 0.205 --html report.html\n"
      "  cellmap compare drive --scans 40 --held-back 4 --json rows.json\n"
      "  cellmap compare drive --server http://127.0.0.1:8080 --map town\n"
      "Poses are poses_gt.txt of the folder where it has one, else poses.txt or --poses.\n",
      [options](const Console& console) { run_compare(*options, console); });
  add_drive_flags(*verb, options->drive);
  ComparisonOptions& comparison = options->comparison;
  verb->add_option("--held-back", options->held_back, "Scans that are registered, not mapped")
      ->check(CLI::Range(1, 100'000))
      ->capture_default_str();
  verb->add_option("--starts", comparison.starts, "Starts of each held-back scan")
      ->capture_default_str();
  verb->add_option("--start-error", comparison.start_error_m, "How far off they start, metres")
      ->capture_default_str();
  verb->add_option("--start-turn", comparison.start_error_deg, "How far turned, degrees")
      ->capture_default_str();
  verb->add_option("--evaluation-range", comparison.evaluation_range_m,
                   "Reconstruction counts so far from the path, metres")
      ->capture_default_str();
  verb->add_option("--samples", comparison.samples, "Distances measured each way")
      ->capture_default_str();
  verb->add_option("--seed", comparison.seed, "Of the starts")->capture_default_str();
  verb->add_option("--rows", options->rows, "Only rows whose names hold one of these words");
  verb->add_option("--threads", comparison.threads, "Threads; 0: all. Only times depend on it")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  // Here with a file: an option of the same name instead of the flag that every verb has.
  verb->remove_option(verb->get_option("--json"));
  options->json_option =
      verb->add_option("--json", options->json,
                       "Write the rows as JSON to this file; without one, print them")
          ->expected(0, 1);
  verb->add_option("--html", options->html, "Write a report with plots to this file");
  verb->add_option("--map", options->map,
                   "Keep the comparison with this map of --server or --store");
  add_place_options(*verb, options->place, true);
  verb->add_option("--keep", options->keep, "Keep the files of all representations in this folder");
  add_mapper_flags(*verb, options->mapper);
}

}  // namespace cellmap::cli
