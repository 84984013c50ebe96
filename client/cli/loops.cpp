#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>

#include "client/cli/arguments.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/map_reader.hpp"

namespace cellmap::cli {
namespace {

struct LoopsArguments {
  Place place;
  std::string map, pose;
  std::uint32_t from = 0, to = 0, cell = 0, loop = 0;
  std::optional<double> sigma_m, sigma_deg;
};

std::string loop_line(const Constraint& loop) {
  const auto t = loop.T_from_to.translation();
  return format(
      "loop %-5u %u -> %u  (%.2f %.2f %.2f) m, %.2f deg  %s, inliers %.2f, residual %.3f m  %s\n",
      loop.id.value, loop.from.value, loop.to.value, t.x(), t.y(), t.z(),
      angle_between_rad(Pose::Identity(), loop.T_from_to) * 180 / std::numbers::pi,
      std::string(to_string(loop.origin)).c_str(), loop.scores.inlier_ratio_hit,
      loop.scores.median_residual_m, std::string(to_string(verdict(loop))).c_str());
}

void list_loops(const LoopsArguments& options, const Console& console) {
  const LoopList loops = open_reader(options.place)->loops(options.map);
  std::string text;
  for (const Constraint& loop : loops.loops) text += loop_line(loop);
  console.print(client::to_json(loops), text.empty() ? "No loops.\n" : text);
}

void show(const LoopsArguments& options, const Console& console) {
  const ConstraintReport report =
      open_reader(options.place)->loop(options.map, ConstraintId{options.loop});
  const RegistrationScores& scores = report.constraint.scores;
  std::string text = loop_line(report.constraint);
  text += format("  weight        %.3f (%s)\n", report.constraint.weight,
                 std::string(to_string(report.verdict)).c_str());
  text += format("  gap           %.3f m, %.3f deg between the measured and the present pose\n",
                 report.gap_m, report.gap_deg);
  text +=
      format("  chi-square    %.2f (of a true loop below 16.8 in 99 of 100 cases)\n", report.chi2);
  text += format(
      "  registration  %u of %u points met a plane, %.1f %% of them agree; %.1f %% lie in "
      "front, %.1f %% beyond\n",
      scores.hits, scores.points, 100 * scores.inlier_ratio_hit, 100 * scores.share_in_front,
      100 * scores.share_beyond);
  console.print(client::to_json(report), text);
}

void print(const LoopReport& report, const Console& console, const std::string& headline) {
  std::string text = headline;
  for (const Constraint& loop : report.loops) text += loop_line(loop);
  text +=
      format("revision %llu, %s CELLs moved\n", static_cast<unsigned long long>(report.revision),
             with_commas(report.moved).c_str());
  console.print(client::to_json(report), text);
}

/// The information of independent errors in translation and rotation.
std::optional<Matrix6d> information_of(const LoopsArguments& options) {
  if (options.sigma_m.has_value() != options.sigma_deg.has_value()) {
    throw Error(ErrorCode::kInvalidArgument, "--sigma-m and --sigma-deg go together");
  }
  if (!options.sigma_m) return std::nullopt;
  const double sigma_rad = *options.sigma_deg * std::numbers::pi / 180;
  Tangent weights;
  weights.head<3>().setConstant(1 / (*options.sigma_m * *options.sigma_m));
  weights.tail<3>().setConstant(1 / (sigma_rad * sigma_rad));
  return Matrix6d(weights.asDiagonal());
}

void add(const LoopsArguments& options, const Console& console) {
  const Pose T_from_to = parse_pose("--pose", options.pose);
  const auto information = information_of(options);
  print(
      connect(options.place)
          .add_loop(options.map, CellId{options.from}, CellId{options.to}, T_from_to, information),
      console, "Added:\n");
}

void detect(const LoopsArguments& options, const Console& console) {
  const LoopReport report = connect(options.place).detect_loops(options.map, CellId{options.cell});
  print(report, console, report.loops.empty() ? "No loop found; nothing changed.\n" : "Found:\n");
}

void pin(const LoopsArguments& options, const Console& console) {
  print(connect(options.place).pin_loop(options.map, ConstraintId{options.loop}, true), console,
        "Pinned:\n");
}

void unpin(const LoopsArguments& options, const Console& console) {
  print(connect(options.place).pin_loop(options.map, ConstraintId{options.loop}, false), console,
        "No longer pinned:\n");
}

void remove(const LoopsArguments& options, const Console& console) {
  print(connect(options.place).delete_loop(options.map, ConstraintId{options.loop}), console,
        "Deleted.\n");
}

}  // namespace

void add_loops(CLI::App& app, Verbs& verbs) {
  CLI::App* group =
      app.add_subcommand("loops", "List, explain, add, detect, pin and delete loop closures");
  group->require_subcommand(1);
  const auto leaf = [&](const char* name, const char* description, const char* example,
                        bool with_store, void (*action)(const LoopsArguments&, const Console&)) {
    const auto options = std::make_shared<LoopsArguments>();
    CLI::App* verb = verbs.add(*group, name, description, example,
                               [options, action](const Console& c) { action(*options, c); });
    verb->add_option("MAP", options->map, "Name of the map")->required();
    add_place_options(*verb, options->place, with_store, with_store);
    return std::pair(verb, options);
  };
  leaf("list", "List the loops", "  cellmap loops list town --server URL\n", true, list_loops);

  const auto [add_verb, added] =
      leaf("add", "Add a measured loop; the map is optimised",
           "  cellmap loops add town --from 3 --to 57 --pose \"1.2 0.1 0 0 0 0.01 0.99995\" "
           "--server URL\n",
           false, add);
  add_verb->add_option("--from", added->from, "CELL that the pose is relative to")->required();
  add_verb->add_option("--to", added->to, "CELL whose pose it is")->required();
  add_verb->add_option("--pose", added->pose, "T_from_to as \"x y z qx qy qz qw\"")->required();
  add_verb->add_option("--sigma-m", added->sigma_m, "Standard deviation of the translation, metres")
      ->check(CLI::PositiveNumber);
  add_verb
      ->add_option("--sigma-deg", added->sigma_deg, "Standard deviation of the rotation, degrees")
      ->check(CLI::PositiveNumber);

  const auto [detect_verb, detected] =
      leaf("detect", "Look for loops of a CELL; what passes is added and the map is optimised",
           "  cellmap loops detect town 57 --server URL\n", false, detect);
  detect_verb->add_option("CELL", detected->cell, "Number of the CELL")->required();

  const auto with_loop = [&](const char* name, const char* description, bool with_store,
                             void (*action)(const LoopsArguments&, const Console&)) {
    const std::string example = "  cellmap loops " + std::string(name) + " town 131 --server URL\n";
    const auto [verb, options] = leaf(name, description, example.c_str(), with_store, action);
    verb->add_option("LOOP", options->loop, "Number of the loop")->required();
  };
  with_loop("show", "Explain what became of a loop and why", true, show);
  with_loop("pin", "Hold a loop for certain; the map is optimised", false, pin);
  with_loop("unpin", "Judge a pinned loop like any other again", false, unpin);
  with_loop("delete", "Delete a loop; the map is optimised without it", false, remove);
}

}  // namespace cellmap::cli
