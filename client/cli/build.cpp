#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/core/error.hpp"
#include "cellmap/store/open_store.hpp"
#include "client/cli/build_in_store.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/form_flags.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/map_text.hpp"
#include "client/cli/mapper_flags.hpp"
#include "client/cli/store_blobs.hpp"

namespace cellmap::cli {
namespace {

struct BuildArguments {
  DriveFlags drive;
  MapperFlags mapper;
  FormFlags form;
  std::string store, map;
  int threads = 1;
};

void run_build(const BuildArguments& options, const Console& console) {
  const Interrupt interrupt;
  const auto form = options.form.form();
  const MapperOptions mapper = options.mapper.mapper_options(options.threads);
  validate_map_name(options.map);
  const auto source = options.drive.open();
  const auto store = open_store(options.store, objects_of_environment());
  std::optional<LatticeSpec> lattice;
  if (options.mapper.lattice_size) lattice = options.mapper.lattice();
  MapInfo map;
  {
    ProgressBar bar(console, "build");
    map = build_in_store(*store, options.map, lattice, form, options.drive.session_name(), *source,
                         mapper, interrupt.token(), [&](const Progress& p) {
                           bar.update(p.scans_done, p.scans_total,
                                      std::to_string(p.cells_done) + " CELLs");
                         });
  }
  console.print(client::to_json(map), map_text(map));
}

}  // namespace

void add_build(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<BuildArguments>();
  CLI::App* verb = verbs.add(
      app, "build", "Map a drive into a store of this machine; no server",
      "  cellmap build drive --store map.db --map town\n"
      "  cellmap build kitti/00 --poses odometry.txt --pose-frame camera --angle-correction 0.205 "
      "--store map.db --map kitti00\n"
      "  cellmap build drive --store map.db --map town --encoding compact --bound 20mm\n"
      "The same command again goes on where it was broken off.\n",
      [options](const Console& console) { run_build(*options, console); });
  add_drive_flags(*verb, options->drive);
  verb->add_option("--store", options->store,
                   "Store: a file, made where it is missing, or postgresql://...")
      ->required();
  verb->add_option("--map", options->map, "Name of the map; made where it is missing")->required();
  verb->add_option("--threads", options->threads, "Threads; 0: all. The bytes do not depend on it")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  add_form_flags(*verb, options->form, "How CELLs are kept; without it as the map says, or raw");
  add_mapper_flags(*verb, options->mapper);
}

}  // namespace cellmap::cli
