#include <CLI/CLI.hpp>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>

#include "cellmap/client/files.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/edit.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"
#include "client/cli/command_line.hpp"

// cellmap optimize: a pose graph in g2o, solved without a server or a store.

namespace cellmap::cli {
namespace {

constexpr std::uintmax_t kLargestFile = 1u << 30;

struct OptimizeArguments {
  std::string in, out, information = "g2o";
  bool best_start = false, least_squares = false, graduated = false;
};

std::string read_bounded(const std::string& file) {
  std::error_code problem;
  const std::uintmax_t size = std::filesystem::file_size(file, problem);
  std::ifstream stream(file, std::ios::binary);
  if (problem || !stream) throw Error(ErrorCode::kNotFound, "cannot read " + file);
  if (size > kLargestFile) {
    throw Error(ErrorCode::kInvalidArgument, file + " is larger than 1 GiB");
  }
  std::ostringstream text;
  text << stream.rdbuf();
  return std::move(text).str();
}

PoseGraphOptions optimisation(const OptimizeArguments& options) {
  PoseGraphOptions result;
  if (options.best_start) result.start = GraphStart::kBest;
  if (options.least_squares) result.loop_loss_scale = 0;
  if (options.graduated) result.robustness = LoopRobustness::kGraduated;
  return result;
}

client::Json loops_of(const PoseGraph& graph) {
  client::Json loops = client::Json::array();
  for (const Constraint& c : graph.constraints) {
    if (c.kind != ConstraintKind::kLoop) continue;
    loops.push_back({{"id", c.id.value},
                     {"from", c.from.value},
                     {"to", c.to.value},
                     {"weight", c.weight},
                     {"chi2", c.chi2},
                     {"verdict", to_string(verdict(c))}});
  }
  return loops;
}

void run_optimize(const OptimizeArguments& options, const Console& console) {
  const auto meaning = options.information == "ceres" ? G2oInformation::kCeresExample
                                                      : G2oInformation::kRightPerturbation;
  PoseGraph graph = pose_graph_from_g2o(read_bounded(options.in), meaning);
  const auto begun = std::chrono::steady_clock::now();
  const PoseGraphSummary summary = optimize(graph, optimisation(options));
  const double time_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begun).count();
  client::write_file_atomically(options.out, to_g2o(graph));
  const client::Json loops = loops_of(graph);
  console.print(
      {{"nodes", graph.nodes.size()},
       {"constraints", graph.constraints.size()},
       {"converged", summary.converged},
       {"iterations", summary.iterations},
       {"time_ms", time_ms},
       {"initial_cost", summary.initial_cost},
       {"final_cost", summary.final_cost},
       {"moved", summary.moved},
       {"rejected", summary.rejected},
       {"loops", loops}},
      format("%zu poses, %zu constraints: cost %.9g -> %.9g, %d iterations, %.0f ms%s\n"
             "%zu of %zu loops rejected, %zu poses moved\n",
             graph.nodes.size(), graph.constraints.size(), summary.initial_cost, summary.final_cost,
             summary.iterations, time_ms, summary.converged ? "" : ", not converged",
             summary.rejected, loops.size(), summary.moved));
}

}  // namespace

void add_optimize(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<OptimizeArguments>();
  CLI::App* verb =
      verbs.add(app, "optimize",
                "Solve a pose graph given as g2o; loops that contradict the rest are rejected",
                "  cellmap optimize town.g2o solved.g2o\n"
                "  cellmap optimize sphere2500.g2o solved.g2o --least-squares --best-start\n"
                "Edges of consecutive ids are odometry, all others loops. Planar graphs are "
                "lifted. The cost\n"
                "is half the chi-square of (position error, twice the quaternion's vector part).\n",
                [options](const Console& console) { run_optimize(*options, console); });
  verb->add_option("in", options->in, "g2o file (SE3:QUAT or SE2)")->required();
  verb->add_option("out", options->out, "g2o file to write")->required();
  verb->add_flag("--best-start", options->best_start,
                 "Start from a spanning tree or the chordal relaxation where that is better");
  verb->add_flag("--least-squares", options->least_squares, "Every loop counts in full");
  verb->add_flag("--graduated", options->graduated,
                 "Judge loops by graduated non-convexity (slower, for comparison)");
  verb->add_option("--information", options->information,
                   "What an edge's matrix means: 'g2o' (its own definition) or 'ceres' (as the "
                   "pose-graph example that comes with Ceres takes it)")
      ->check(CLI::IsMember({"g2o", "ceres"}));
}

}  // namespace cellmap::cli
