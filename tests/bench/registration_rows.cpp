#include <benchmark/benchmark.h>

#include <array>
#include <cstdio>

#include "bench/instruction_sets.hpp"
#include "bench/rows.hpp"

namespace cellmap::bench {
namespace {

constexpr double kPaperCorrespondencesMs = 384.9, kPaperPoseMs = 676.6;
constexpr double kMaxDifferenceM = 1e-3;

/// The paper's schedule: four plain iterations on all points, whatever the step, and like the
/// baseline the pose alone.
RegistrationOptions paper_schedule(int threads) {
  const PaperRegistration paper;
  RegistrationOptions options;
  options.stages = {{paper.iterations, paper.gate_m, RobustKernel::kNone}};
  options.convergence_translation_m = 1e-12;
  options.convergence_rotation_rad = 1e-12;
  options.judge = false;
  options.threads = threads;
  return options;
}

struct PaperPair {
  PaperCell a, b;
  std::array<PaperTerm, 2> both;     // as register_cells
  std::array<PaperTerm, 1> forward;  // as register_scan

  explicit PaperPair(const CellPair& pair)
      : a(to_paper_cell(pair.a.cell())),
        b(to_paper_cell(pair.b.cell())),
        both{PaperTerm{&a, &pair.scan_b()}, PaperTerm{&b, &pair.scan_a(), true}},
        forward{PaperTerm{&a, &pair.scan_b()}} {}
};

/// The same schedule must end at the same pose.
void check_poses(const Pose& ours, const Pose& baseline) {
  const double difference_m = (ours.translation() - baseline.translation()).norm();
  char text[96];
  std::snprintf(text, sizeof(text), "the same pose after four iterations (%.4f mm apart)",
                1e3 * difference_m);
  require_agreement(difference_m < kMaxDifferenceM && angle_between_rad(ours, baseline) < 1e-4,
                    text);
}

template <typename Ours>
Comparison against_paper(const Setting& setting, std::span<const PaperTerm> terms,
                         const Pose& guess, const PaperRegistration& paper, const Ours& ours,
                         double seconds) {
  const Contestant our_way{[&] { benchmark::DoNotOptimize(ours()); }};
  const Contestant paper_way{
      [&] { benchmark::DoNotOptimize(register_paper_way(terms, *setting.tree, guess, paper)); }};
  return compare(our_way, paper_way, setting.effort(seconds, paper.threads));
}

void bidirectional_row(const Setting& setting, const CellPair& pair, const PaperPair& paper,
                       int threads, const std::string& widest, const AddRow& add) {
  const auto ours = [&] {
    return register_cells(pair.a, pair.scan_a(), pair.b, pair.scan_b(), pair.guess(),
                          paper_schedule(threads));
  };
  check_poses(ours().T_target_source,
              register_paper_way(paper.both, *setting.tree, pair.guess(), {}));
  const auto against = [&](JacobianSize size) {
    return against_paper(setting, paper.both, pair.guess(), {.threads = threads, .jacobians = size},
                         ours, 5);
  };
  Row row = duration_row("bidirectional_registration", threads, "ms", 1e-3,
                         against(JacobianSize::kDynamic), pair.data);
  row.extra["paper_ms"] = kPaperCorrespondencesMs + kPaperPoseMs;
  if (threads == 1 && simd::instruction_set() == widest) {
    const Comparison fixed = against(JacobianSize::kFixed);
    row.extra["baseline_fixed_size"] = fixed.baseline_s * 1e3;
    row.extra["ratio_fixed_size"] = fixed.ratio;
  }
  const Contestant judged{[&] {
    RegistrationOptions options = paper_schedule(threads);
    options.judge = true;
    benchmark::DoNotOptimize(
        register_cells(pair.a, pair.scan_a(), pair.b, pair.scan_b(), pair.guess(), options));
  }};
  row.extra["ours_judged"] = measure(judged, setting.effort(2, threads)).ours_s * 1e3;
  row.extra["points"] = pair.scan_a().size() + pair.scan_b().size();
  add(std::move(row));
}

void scan_row(const Setting& setting, const CellPair& pair, const PaperPair& paper, int threads,
              const AddRow& add) {
  RegistrationOptions options;
  options.threads = threads;
  const auto to_convergence = [&] {
    return register_scan(pair.a, pair.scan_b(), pair.guess(), options);
  };
  const auto four_iterations = [&] {
    return register_scan(pair.a, pair.scan_b(), pair.guess(), paper_schedule(threads));
  };
  check_poses(four_iterations().T_target_source,
              register_paper_way(paper.forward, *setting.tree, pair.guess(), {}));
  const RegistrationResult result = to_convergence();
  require_agreement(result.converged, "a registration that converges");
  Row row = duration_row(
      "scan_registration", threads, "ms", 1e-3,
      against_paper(setting, paper.forward, pair.guess(), {.threads = threads}, to_convergence, 4),
      pair.data);
  const Contestant same_work{[&] { benchmark::DoNotOptimize(four_iterations()); }};
  row.extra["ours_four_iterations"] = measure(same_work, setting.effort(2, threads)).ours_s * 1e3;
  row.extra["iterations"] = result.iterations;
  row.extra["points"] = pair.scan_b().size();
  add(std::move(row));
}

}  // namespace

void registration_rows(const Setting& setting, const AddRow& add) {
  const std::string widest = simd::instruction_set();
  for (const CellPair& pair : setting.pairs) {
    const PaperPair paper(pair);
    for (const int threads : setting.threads) scan_row(setting, pair, paper, threads, add);
    const auto row = [&] { bidirectional_row(setting, pair, paper, 1, widest, add); };
    if (setting.quick && &pair != &setting.pairs.back()) {
      row();
    } else {
      on_instruction_sets(!setting.quick, row);
    }
    for (const int threads : setting.threads) {
      if (threads > 1) bidirectional_row(setting, pair, paper, threads, widest, add);
    }
  }
}

}  // namespace cellmap::bench
