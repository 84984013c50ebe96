#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "bench/ceres_example.hpp"
#include "bench/loopy_graph.hpp"
#include "bench/rows.hpp"
#include "support/real_data.hpp"

namespace cellmap::bench {
namespace {

/// Without the robust loss both minimise the same sum but for the second order of the rotation
/// errors, so our optimiser must find next to nothing left to do at the example's solution.
void check_solutions(const PoseGraph& start) {
  PoseGraphOptions plain;
  plain.loop_loss_scale = 0;
  PoseGraph ours = start, example = start;
  const PoseGraphSummary solved = optimize(ours, plain);
  optimize_as_ceres_example(example, 1);
  const PoseGraphSummary from_example = optimize(example, plain);
  char text[120];
  std::snprintf(text, sizeof(text), "the same minimum (costs %.6g and %.6g)", solved.final_cost,
                from_example.initial_cost);
  require_agreement(solved.converged && std::abs(from_example.initial_cost - solved.final_cost) <
                                            2e-3 * solved.final_cost,
                    text);
}

Row compare_solvers(const std::string& name, const std::string& data, const PoseGraph& start,
                    int threads, Effort effort) {
  effort.threads = threads;
  PoseGraph ours, baseline;
  PoseGraphOptions options;
  options.threads = threads;
  PoseGraphSummary summary;
  const Comparison comparison = compare(
      {[&] { summary = optimize(ours, options); }, [&] { ours = start; }},
      {[&] { optimize_as_ceres_example(baseline, threads); }, [&] { baseline = start; }}, effort);
  Row row = duration_row(name, threads, "ms", 1e-3, comparison, data);
  row.extra["iterations"] = summary.iterations;
  row.extra["nodes"] = start.nodes.size();
  row.extra["constraints"] = start.constraints.size();
  return row;
}

/// The graph solved without its last loop, then with it: the poses to start from are the last
/// solution.
PoseGraph with_one_new_loop(const PoseGraph& start) {
  PoseGraph graph = start;
  auto last = graph.constraints.end();
  while ((--last)->kind != ConstraintKind::kLoop) {
  }
  const Constraint loop = *last;
  graph.constraints.erase(last);
  optimize(graph);
  graph.constraints.push_back(loop);
  return graph;
}

/// Both from the file's poses, every loop in full; ours from the chordal start where that is
/// better.
Row public_graph_row(const std::filesystem::path& file, const Effort& effort) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  const PoseGraph start = pose_graph_from_g2o(text.str());
  PoseGraphOptions options;
  options.loop_loss_scale = 0;
  options.start = GraphStart::kBest;
  PoseGraph ours, example;
  PoseGraphSummary solved;
  const Comparison comparison =
      compare({[&] { solved = optimize(ours, options); }, [&] { ours = start; }},
              {[&] { optimize_as_ceres_example(example, 1); }, [&] { example = start; }}, effort);
  const double example_cost = optimize(example, options).initial_cost;
  char agreement[160];
  std::snprintf(agreement, sizeof(agreement), "%s: cost %.9g, of the example %.9g",
                file.stem().c_str(), solved.final_cost, example_cost);
  require_agreement(solved.converged && solved.final_cost <= example_cost * (1 + 1e-7), agreement);
  Row row = duration_row("pose_graph_public", 1, "ms", 1e-3, comparison, file.stem().string());
  row.extra["cost"] = solved.final_cost;
  row.extra["baseline_cost"] = example_cost;
  row.extra["iterations"] = solved.iterations;
  row.extra["nodes"] = start.nodes.size();
  row.extra["constraints"] = start.constraints.size();
  return row;
}

void public_graph_rows(const Setting& setting, const AddRow& add) {
  for (const char* name :
       {"smallGrid3D", "parking-garage", "sphere2500", "sphere_bignoise_vertex3"}) {
    const auto file = test::real_data("g2o") / (std::string(name) + ".g2o");
    if (!std::filesystem::exists(file)) continue;
    add(public_graph_row(file, {.seconds = setting.quick ? 1.0 : 20.0,
                                .min_pairs = setting.quick ? 1 : 3,
                                .max_pairs = 50,
                                .warm_up = false}));
    if (setting.quick) return;
  }
}

}  // namespace

void pose_graph_rows(const Setting& setting, const AddRow& add) {
  const std::vector<Pose> kitti = kitti00_cell_poses();
  const std::string route = kitti.empty() ? "simulated streets" : "kitti00 route, simulated errors";
  const PoseGraph city = loopy_graph(kitti.empty() ? street_grid_poses(577) : kitti, 11);
  check_solutions(city);
  for (const int threads : setting.threads) {
    add(compare_solvers("pose_graph_kitti00", route + ", cold", city, threads,
                        setting.effort(4, 1)));
  }
  add(compare_solvers("pose_graph_kitti00", route + ", one new loop", with_one_new_loop(city), 1,
                      setting.effort(4, 1)));

  public_graph_rows(setting, add);

  const PoseGraph large = loopy_graph(street_grid_poses(10'000), 11);
  const Effort effort = {.seconds = setting.quick ? 0.0 : 20.0,
                         .min_pairs = setting.quick ? 1 : 3,
                         .max_pairs = 10,
                         .warm_up = false};
  const std::string streets = "simulated streets";
  add(compare_solvers("pose_graph_10000", streets + ", cold", large, 1, effort));
  if (setting.quick) return;
  check_solutions(large);
  add(compare_solvers("pose_graph_10000", streets + ", cold", large, 2, effort));
  add(compare_solvers("pose_graph_10000", streets + ", one new loop", with_one_new_loop(large), 1,
                      effort));
}

}  // namespace cellmap::bench
