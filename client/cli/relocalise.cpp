#include <CLI/CLI.hpp>
#include <chrono>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "cellmap/client/files.hpp"
#include "client/cli/arguments.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/map_reader.hpp"
#include "client/cli/mapper_flags.hpp"
#include "client/cli/offline_relocalise.hpp"

namespace cellmap::cli {
namespace {

struct RelocaliseArguments {
  Place place;
  std::string scan, map, prior, truth, truth_row;
  double radius_m = 10, yaw_range_deg = 20;
  int threads = 1;
};

std::optional<PosePrior> prior_of(const RelocaliseArguments& options) {
  if (options.prior.empty()) return std::nullopt;
  return PosePrior{parse_pose("--prior", options.prior), options.radius_m,
                   options.yaw_range_deg * std::numbers::pi / 180};
}

std::optional<Pose> truth_of(const RelocaliseArguments& options) {
  if (!options.truth.empty()) return parse_pose("--truth", options.truth);
  if (options.truth_row.empty()) return std::nullopt;
  return pose_from_row_major_3x4(
      parse_numbers<12>("--truth-row", "a KITTI row", options.truth_row));
}

std::string scores_text(const RegistrationScores& scores) {
  return format(
      "inliers %.2f of %s hit points (%.2f of all), %.3f in front, median residual %.3f m",
      scores.inlier_ratio_hit, with_commas(scores.hits).c_str(), scores.inlier_ratio_all,
      scores.share_in_front, scores.median_residual_m);
}

std::string found_text(const Relocalisation& relocalisation) {
  const RelocalisationCandidate& found = *relocalisation.answer.found;
  const auto values = to_xyz_qxyzw(found.T_map_scan);
  const Tangent sigma = relocalisation.answer.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  std::string text = format("Found at CELL %u\n  T_map_scan  %.3f %.3f %.3f  %.6f %.6f %.6f %.6f\n",
                            found.cell.value, values[0], values[1], values[2], values[3], values[4],
                            values[5], values[6]);
  text += format("  sigma       %.3f %.3f %.3f m, %.3f %.3f %.3f deg%s\n", sigma[0], sigma[1],
                 sigma[2], sigma[3] * 180 / std::numbers::pi, sigma[4] * 180 / std::numbers::pi,
                 sigma[5] * 180 / std::numbers::pi,
                 found.registration.degeneracy.degenerate ? "  (a direction is weakly held)" : "");
  if (const auto& geopose = relocalisation.geopose) {
    const Eigen::Quaterniond& q = geopose->q_enu_body;
    text +=
        format("  on Earth    %.8f %.8f deg, %.3f m  %.6f %.6f %.6f %.6f\n", geopose->latitude_deg,
               geopose->longitude_deg, geopose->height_m, q.x(), q.y(), q.z(), q.w());
  }
  text += format("  confidence  %.4f\n", found.confidence);
  if (const SurroundingsScores& around = found.surroundings; around.cells > 0) {
    text += format("  around      %u CELLs confirm %.0f %% of what the scan should see\n",
                   around.cells, 100 * around.agreement);
  }
  return text + "  scores      " + scores_text(found.registration.scores) + "\n";
}

std::string answer_text(const Relocalisation& relocalisation) {
  const RelocalisationAnswer& answer = relocalisation.answer;
  std::string text = answer.found ? found_text(relocalisation)
                                  : "Not found: no place of the map agrees with the scan.\n";
  for (const RelocalisationCandidate& other : answer.alternatives) {
    text += format("  %s CELL %u: %s\n", other.accepted ? "also    " : "rejected", other.cell.value,
                   scores_text(other.registration.scores).c_str());
  }
  return text + format("  %zu CELLs considered, %.0f ms\n", answer.cells_considered,
                       relocalisation.time_ms);
}

bool is_cell(const RelocaliseArguments& options) {
  return std::filesystem::path(options.scan).extension() == ".cell";
}

EncodedCell read_cell(const std::string& file) {
  auto bytes = client::read_file(file, kMaxCellBytes);
  if (!bytes) throw Error(ErrorCode::kNotFound, "there is no file " + file);
  const ContentHash hash = view_cell(*bytes).hash;
  return {hash, *std::move(bytes)};
}

RelocalisationQuery relocalisation_query(const RelocaliseArguments& options) {
  if (!is_cell(options)) {
    return RelocalisationQuery::from_scan(filter_scan(read_scan(options.scan), 0, {}).points);
  }
  const Cell cell = decode_cell(read_cell(options.scan).bytes);
  return RelocalisationQuery::from_cell(cell, Lattice(cell.lattice));
}

Relocalisation ask(const RelocaliseArguments& options, const std::optional<PosePrior>& prior) {
  if (options.place.is_offline()) {
    RelocalisationQuery query = relocalisation_query(options);
    query.prior = prior;
    return relocalise_offline(*open_reader(options.place), options.map, query, options.threads);
  }
  Client client = connect(options.place);
  return is_cell(options) ? client.relocalise(options.map, read_cell(options.scan), prior)
                          : client.relocalise(options.map, read_scan(options.scan), prior);
}

void run_relocalise(const RelocaliseArguments& options, const Console& console) {
  const auto prior = prior_of(options);
  const auto truth = truth_of(options);
  const Relocalisation answer = ask(options, prior);
  client::Json json = client::to_json(answer);
  std::string text = answer_text(answer);
  if (truth && answer.answer.found) {
    const Pose& found = answer.answer.found->T_map_scan;
    const double error_m = (found.translation() - truth->translation()).norm();
    const double error_deg = angle_between_rad(found, *truth) * 180 / std::numbers::pi;
    json["error_m"] = error_m;
    json["error_deg"] = error_deg;
    text += format("  error       %.3f m, %.3f deg against the truth\n", error_m, error_deg);
  }
  console.print(json, text);
}

}  // namespace

void add_relocalise(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<RelocaliseArguments>();
  CLI::App* verb =
      verbs.add(app, "relocalise", "Find where in a map a scan was taken, or a CELL built",
                "  cellmap relocalise scan.bin --server http://127.0.0.1:8080 --map town\n"
                "  cellmap relocalise scan.pcd --store map.db --map town --prior \"10 2 0 0 0 0 "
                "1\" --radius 5\n"
                "\"Not found\" is an answer: exit code 0, and \"found\": false with --json.\n",
                [options](const Console& console) { run_relocalise(*options, console); });
  verb->add_option("SCAN", options->scan,
                   "One scan: .bin (KITTI), .pcd or .ply; or a CELL of the map's lattice: .cell")
      ->required();
  verb->add_option("--map", options->map, "Name of the map")->required();
  add_place_options(*verb, options->place, true, true);
  auto* prior = verb->add_option("--prior", options->prior,
                                 "Roughly known T_map_scan as \"x y z qx qy qz qw\"");
  verb->add_option("--radius", options->radius_m, "The truth is within this of the prior, metres")
      ->needs(prior)
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  verb->add_option("--yaw-range", options->yaw_range_deg, "And the true yaw within this, degrees")
      ->needs(prior)
      ->check(CLI::Range(0.0, 180.0))
      ->capture_default_str();
  auto* truth = verb->add_option("--truth", options->truth,
                                 "True T_map_scan as \"x y z qx qy qz qw\": prints the error");
  verb->add_option("--truth-row", options->truth_row, "The same as a KITTI row of 12 numbers")
      ->excludes(truth);
  verb->add_option("--threads", options->threads, "With --store: threads; 0: all")
      ->capture_default_str();
}

}  // namespace cellmap::cli
