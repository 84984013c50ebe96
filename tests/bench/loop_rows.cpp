#include <benchmark/benchmark.h>

#include <map>

#include "bench/rows.hpp"
#include "cellmap/place/loop_detection.hpp"
#include "cellmap/pose_graph/information.hpp"

namespace cellmap::bench {
namespace {

constexpr std::uint32_t kCells = 577;  // of KITTI 00, as the paper counts
constexpr double kStepM = 6.0;
constexpr double kPaperMs = 9.7 + 183.3 + 326.2;
/// In the simulated town the vehicle is back on its first street at this scan.
constexpr std::size_t kRevisitScan = 530, kRevisitScans = 8;

/// A vehicle comes to a town over a long road, drives through a street and, after a turn around the
/// block, through it again. Only the CELLs of the street have planes; the others are nodes.
class Revisit {
 public:
  explicit Revisit(const Setting& setting) {
    const auto first_visit = local_maps(setting.simulated, false);
    const auto second_visit = local_maps(simulated_scans(kRevisitScan, kRevisitScans), true);
    const std::uint32_t road = kCells - 1 - kBlock - static_cast<std::uint32_t>(first_visit.size());

    const Pose entry = first_visit.front().T_odom_cell();
    for (std::uint32_t i = 0; i < road; ++i) {
      Pose T = entry;
      T.translation() += entry.linear() * Eigen::Vector3d(-kStepM * (road - i), 0, 0);
      add_node(T);
    }
    for (const LocalMap& local_map : first_visit) add_cell(local_map, setting);
    // Around the block: far enough to the side to be no candidates.
    for (std::uint32_t i = 0; i < kBlock; ++i) {
      Pose T = entry;
      T.translation() += entry.linear() * Eigen::Vector3d(-kStepM * i, 500, 0);
      add_node(T);
    }
    T_true_ = second_visit.front().T_odom_cell();
    Tangent off = Tangent::Zero();
    off.head<2>() << 0.24, 0.18;
    off[5] = 0.017;
    add_cell(second_visit.front(), setting);
    graph_.nodes[query()] = T_true_ * exp(off);
    scan_ = second_visit.front().base_scan().points;
  }

  CellId query() const { return {kCells}; }
  const PoseGraph& graph() const { return graph_; }
  const PointCloud& scan() const { return scan_; }
  const std::map<CellId, std::shared_ptr<const RegistrationTarget>>& targets() const {
    return targets_;
  }
  /// Largest distance of a pose of the query from the truth.
  double error_m(CellId from, const Pose& T_from_query) const {
    return (graph_.nodes.at(from) * T_from_query.translation() - T_true_.translation()).norm();
  }

 private:
  static constexpr std::uint32_t kBlock = 60;

  void add_node(const Pose& T) {
    const CellId id{static_cast<std::uint32_t>(graph_.nodes.size() + 1)};
    if (id.value > 1) {
      Constraint c;
      c.from = {id.value - 1};
      c.to = id;
      c.T_from_to = graph_.nodes.at(c.from).inverse() * T;
      graph_.constraints.push_back(c);
    }
    graph_.nodes[id] = T;
  }

  void add_cell(const LocalMap& local_map, const Setting& setting) {
    add_node(local_map.T_odom_cell());
    const CellId id = graph_.nodes.rbegin()->first;
    targets_[id] = std::make_shared<const RegistrationTarget>(
        to_target(local_map, setting.lattice, "bench", id.value));
  }

  PoseGraph graph_;
  std::map<CellId, std::shared_ptr<const RegistrationTarget>> targets_;
  PointCloud scan_;
  Pose T_true_ = Pose::Identity();
};

/// The paper's loop closure: the nearest CELLs, one registration each, accepted by its inliers.
std::vector<LoopCandidate> loops_paper_way(const Revisit& revisit, const Setting& setting,
                                           const std::map<CellId, PaperCell>& cells,
                                           const LoopOptions& options, int threads) {
  std::vector<LoopCandidate> accepted;
  for (LoopCandidate& found : find_loop_candidates(revisit.graph(), revisit.query(), options)) {
    const PaperTerm term{&cells.at(found.cell), &revisit.scan()};
    found.T_candidate_query = register_paper_way(std::array{term}, *setting.tree,
                                                 found.T_candidate_query, {.threads = threads});
    const double inliers =
        inlier_ratio_paper_way(term, *setting.tree, found.T_candidate_query, threads);
    if (inliers >= kPaperInlierRatio) accepted.push_back(found);
  }
  return accepted;
}

}  // namespace

void loop_rows(const Setting& setting, const AddRow& add) {
  const Revisit revisit(setting);
  std::map<CellId, PaperCell> paper_cells;
  for (const auto& [id, target] : revisit.targets()) {
    paper_cells.emplace(id, to_paper_cell(target->cell()));
  }
  const TargetProvider targets = [&](CellId id) { return revisit.targets().at(id); };
  for (const int threads : setting.threads) {
    LoopOptions options;
    options.closures = options.candidates;  // as many as the paper's
    options.registration.threads = threads;
    const auto search = [&] {
      return detect_loops(revisit.graph(), revisit.query(), revisit.scan(), targets, options);
    };
    const auto paper_search = [&] {
      return loops_paper_way(revisit, setting, paper_cells, options, threads);
    };
    const auto closures = search();
    const auto accepted = paper_search();
    require_agreement(!closures.empty() && !accepted.empty(), "a loop where there is one");
    for (const LoopClosure& closure : closures) {
      require_agreement(revisit.error_m(closure.from, closure.result.T_target_source) < 0.1,
                        "loops within 0.1 m of the truth");
    }
    const auto candidates = find_loop_candidates(revisit.graph(), revisit.query(), options);
    const Comparison comparison =
        compare(Contestant{[&] { benchmark::DoNotOptimize(search()); }},
                Contestant{[&] { benchmark::DoNotOptimize(paper_search()); }},
                {.seconds = setting.quick ? 1.5 : 12.0,
                 .min_pairs = 2,
                 .warm_up = false,
                 .threads = threads});
    Row row = duration_row("loop_search_577", threads, "ms", 1e-3, comparison, kSimulated);
    row.extra["paper_ms"] = kPaperMs;
    row.extra["candidates"] = candidates.size();
    row.extra["closures"] = closures.size();
    row.extra["baseline_accepted"] = accepted.size();
    add(std::move(row));
  }
}

}  // namespace cellmap::bench
