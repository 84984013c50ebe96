#include <CLI/CLI.hpp>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>

#include "cellmap/core/error.hpp"
#include "cellmap/evaluation/trajectory_metrics.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/evaluate_verbs.hpp"

namespace cellmap::cli {
namespace {

struct EvaluateArguments {
  std::string estimate, truth;
};

/// TUM rows have 8 columns, KITTI rows 12 (`read_trajectory` reports anything else).
bool is_tum(const std::string& file) {
  std::ifstream stream(file);
  std::string line;
  while (std::getline(stream, line)) {
    if (line.starts_with('#') || line.find_first_not_of(" \t\r") == std::string::npos) continue;
    std::istringstream columns(line);
    int count = 0;
    for (std::string column; columns >> column;) ++count;
    return count == 8;
  }
  return false;
}

std::vector<Pose> poses_of(const Trajectory& trajectory) {
  std::vector<Pose> poses;
  for (const StampedPose& pose : trajectory.poses()) poses.push_back(pose.pose);
  return poses;
}

TrajectoryErrors compare(const EvaluateArguments& options) {
  const Trajectory estimate = read_trajectory(options.estimate);
  const Trajectory truth = read_trajectory(options.truth);
  if (is_tum(options.estimate) && is_tum(options.truth))
    return evaluate_trajectory(estimate, truth);
  return evaluate_trajectory(poses_of(estimate), poses_of(truth));
}

}  // namespace

void add_evaluate(CLI::App& app, Verbs& verbs) {
  CLI::App* group = app.add_subcommand("evaluate", "Compare with the truth");
  group->require_subcommand(1);
  const auto options = std::make_shared<EvaluateArguments>();
  CLI::App* verb = verbs.add(
      *group, "trajectory",
      "Errors of an estimated trajectory: KITTI devkit, absolute (aligned), relative",
      "  cellmap evaluate trajectory --estimate optimised.txt --truth drive/poses_gt.txt\n"
      "Two TUM files are compared by their stamps, others row by row (equal numbers of rows).\n"
      "Both must hold poses of the same sensor; their world frames may differ.\n",
      [options](const Console& console) {
        const TrajectoryErrors errors = compare(*options);
        console.print(client::parse_json(to_json(errors)), to_table(errors));
      });
  verb->add_option("--estimate", options->estimate, "KITTI or TUM file")->required();
  verb->add_option("--truth", options->truth, "KITTI or TUM file")->required();
  add_evaluate_relocalisation(*group, verbs);
  add_evaluate_diff(*group, verbs);
}

}  // namespace cellmap::cli
