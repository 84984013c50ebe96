#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "cellmap/simulation/simulator.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/interrupt.hpp"

namespace cellmap::cli {
namespace {

struct SimulateArguments {
  SimulatorOptions simulator;
  std::string lidar = "hdl64e", frame = "auto", out;
  std::optional<int> beams, columns;
};

SimulatorOptions simulator_options(const SimulateArguments& options) {
  SimulatorOptions simulator = options.simulator;
  simulator.lidar = LidarModel::by_name(options.lidar);
  if (options.beams) simulator.lidar.beams = *options.beams;
  if (options.columns) simulator.lidar.columns = *options.columns;
  if (options.frame == "camera") simulator.route_frame = PoseFrame::kCamera;
  if (options.frame == "sensor") simulator.route_frame = PoseFrame::kSensor;
  simulator.validate();
  return simulator;
}

void run_simulate(const SimulateArguments& options, const Console& console) {
  const Interrupt interrupt;
  const auto source = simulate(simulator_options(options));
  {
    ProgressBar bar(console, "simulate");
    write_dataset(*source, options.out, interrupt.token(),
                  [&](const Progress& p) { bar.update(p.scans_done, p.scans_total); });
  }
  const double length_m = source->ground_truth().length_m();
  console.print(
      {{"folder", options.out}, {"scans", source->size()}, {"length_m", length_m}},
      format("Wrote %zu scans of a drive of %.0f m to %s: velodyne/, times.txt, poses.txt "
             "(odometry), poses_gt.txt (truth)\n",
             source->size(), length_m, options.out.c_str()));
}

}  // namespace

void add_simulate(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<SimulateArguments>();
  CLI::App* verb = verbs.add(
      app, "simulate", "Write a simulated drive with ground truth as a KITTI-layout folder",
      "  cellmap simulate --route town --scans 300 --out drive\n"
      "  cellmap simulate --route 07.txt --odometry estimated/07.txt --out drive07\n"
      "  cellmap simulate --lateral-offset 1.5 --traffic-seed 7 --odometry truth --out "
      "another-day\n",
      [options](const Console& console) { run_simulate(*options, console); });
  SimulatorOptions& simulator = options->simulator;
  verb->add_option("--route", simulator.route, "town (generated, with loops) or a trajectory file")
      ->capture_default_str();
  verb->add_option("--route-frame", options->frame, "Frame of the route: auto, camera or sensor")
      ->check(CLI::IsMember({"auto", "camera", "sensor"}))
      ->capture_default_str();
  verb->add_option("--scans", simulator.scans, "Number of scans; 0: the whole route")
      ->capture_default_str();
  verb->add_option("--seed", simulator.seed, "Of world, noise and drift")->capture_default_str();
  verb->add_option("--odometry", simulator.odometry,
                   "truth, drift (a seeded model) or a trajectory file estimated on the same route")
      ->capture_default_str();
  verb->add_option("--lidar", options->lidar, "hdl64e, os1-64 or vlp16")->capture_default_str();
  verb->add_option("--beams", options->beams, "Beams, instead of the LiDAR's own number");
  verb->add_option("--columns", options->columns,
                   "Columns a turn, instead of the LiDAR's own number");
  verb->add_option("--lateral-offset", simulator.lateral_offset_m,
                   "Drive this far left of the route, metres: another lane")
      ->capture_default_str();
  verb->add_option("--traffic-seed", simulator.traffic_seed, "Of the cars: another day; 0: --seed")
      ->capture_default_str();
  verb->add_option("--threads", simulator.threads, "Threads; 0: all")->capture_default_str();
  verb->add_option("--out", options->out, "Folder to write; must hold no scans yet")->required();
}

}  // namespace cellmap::cli
