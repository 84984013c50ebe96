#include "server/jobs/ingest_request.hpp"

#include <algorithm>

#include "cellmap/core/error.hpp"
#include "server/api/text.hpp"

namespace cellmap::server {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxPathLength = 4096;

[[noreturn]] void invalid(const std::string& message) {
  throw Error(ErrorCode::kInvalidArgument, message);
}

void check_session(const std::string& session) {
  const bool valid =
      !session.empty() && session.size() <= 64 && std::ranges::all_of(session, [](unsigned char c) {
        return c < 0x80 && (std::isalnum(c) || c == '.' || c == '_' || c == '-');
      });
  if (!valid) {
    invalid("A session is named by 1 to 64 characters [A-Za-z0-9._-], found " + in_quotes(session) +
            ".");
  }
}

PoseFrame parse_pose_frame(const std::string& name) {
  if (name == "auto") return PoseFrame::kAuto;
  if (name == "camera") return PoseFrame::kCamera;
  if (name == "sensor") return PoseFrame::kSensor;
  invalid("Expected pose_frame to be auto, camera or sensor, found " + in_quotes(name) + ".");
}

MapperOptions parse_options(const Json& json) {
  MapperOptions options;
  ObjectReader reader(json, "options");
  const auto number = [&](const char* key, double& value) {
    value = reader.number(key).value_or(value);
  };
  number("cell_distance_m", options.cell_distance_m);
  number("min_range_m", options.filter.min_range_m);
  number("max_range_m", options.filter.max_range_m);
  number("vertical_angle_correction_deg", options.filter.vertical_angle_correction_deg);
  number("max_range_gap_m", options.build.max_range_gap_m);
  options.bidirectional = reader.boolean("bidirectional").value_or(options.bidirectional);
  options.loop_closures = reader.boolean("loop_closures").value_or(options.loop_closures);
  if (const auto name = reader.text("loop_acceptance")) {
    const auto accept = loop_acceptance_from(*name);
    if (!accept) {
      invalid("Expected loop_acceptance to be scores or paper, found " + in_quotes(*name) + ".");
    }
    options.loops.accept = *accept;
  }
  if (const auto count = reader.integer("min_points", UINT32_MAX)) {
    options.build.min_points = static_cast<std::uint32_t>(*count);
  }
  if (const auto name = reader.text("fit")) {
    const auto fit = plane_fit_from(*name);
    if (!fit) {
      invalid("Expected fit to be trimmed, ransac or streaming, found " + in_quotes(*name) + ".");
    }
    options.build.fit = *fit;
  }
  reader.finish();
  options.validate();
  return options;
}

bool is_below(const fs::path& path, const fs::path& root) {
  return std::mismatch(root.begin(), root.end(), path.begin(), path.end()).first == root.end();
}

bool is_below_any(const fs::path& path, const std::vector<fs::path>& roots) {
  return std::ranges::any_of(roots, [&](const fs::path& root) { return is_below(path, root); });
}

/// The readers follow links inside a folder, so none of them may lead out.
void check_links(const fs::path& folder, const std::vector<fs::path>& roots, int depth) {
  constexpr int kDeepestFolderThatReadersOpen = 1;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder, ignored)) {
    if (entry.is_symlink() && !is_below_any(fs::weakly_canonical(entry.path()), roots)) {
      invalid("The link " + in_quotes(entry.path().filename().string()) +
              " in the data set leads out of the server's data roots.");
    }
    if (depth < kDeepestFolderThatReadersOpen && entry.is_directory(ignored)) {
      check_links(entry.path(), roots, depth + 1);
    }
  }
}

}  // namespace

IngestRequest parse_ingest_request(const Json& json) {
  ObjectReader reader(json, "the job");
  IngestRequest request;
  const auto kind = reader.text("kind");
  if (kind != "ingest") invalid("Expected the job's kind to be 'ingest'.");
  request.path = reader.text("path");
  const bool upload = reader.boolean("upload").value_or(false);
  if (request.path.has_value() == upload) {
    invalid("Expected exactly one of 'path' and 'upload': true.");
  }
  if (request.path && (request.path->empty() || request.path->size() > kMaxPathLength ||
                       request.path->find('\0') != std::string::npos)) {
    invalid("Expected 'path' to name a folder in 1 to 4096 characters.");
  }
  auto session = reader.text("session");
  if (!session && request.path) session = fs::path(*request.path).lexically_normal().filename();
  if (!session) invalid("Expected a 'session' name for the upload.");
  check_session(*session);
  request.session = *std::move(session);
  request.poses = reader.text("poses").value_or("");
  request.pose_frame = parse_pose_frame(reader.text("pose_frame").value_or("auto"));
  request.scans_total = reader.integer("scans_total", UINT32_MAX).value_or(0);
  if (const Json* options = reader.object("options")) request.options = parse_options(*options);
  request.create_map = reader.boolean("create_map").value_or(false);
  if (const Json* lattice = reader.object("lattice")) request.lattice = lattice_from_json(*lattice);
  request.form = read_form(reader);
  reader.finish();
  return request;
}

fs::path resolve_below(const std::vector<fs::path>& roots, const std::string& asked,
                       const fs::path& base) {
  if (roots.empty()) {
    invalid("This server reads no paths: it was started without --data-root. Upload the scans.");
  }
  std::vector<fs::path> candidates;
  if (fs::path(asked).is_absolute()) {
    candidates = {asked};
  } else {
    if (!base.empty()) candidates.push_back(base / asked);
    for (const auto& root : roots) candidates.push_back(root / asked);
  }
  bool one_is_below = false;
  for (const auto& candidate : candidates) {
    std::error_code error;
    const fs::path path = fs::weakly_canonical(candidate, error);
    if (error || !is_below_any(path, roots)) continue;
    one_is_below = true;
    if (fs::exists(path, error)) return path;
  }
  if (!one_is_below) invalid("The path " + in_quotes(asked) + " is not below a data root.");
  throw Error(ErrorCode::kNotFound, "There is no " + in_quotes(asked) + " below the data roots.");
}

std::unique_ptr<ScanSource> open_request(const IngestRequest& request,
                                         const std::vector<fs::path>& roots) {
  const fs::path folder = resolve_below(roots, *request.path);
  if (!fs::is_directory(folder)) invalid("The path " + in_quotes(*request.path) + " is no folder.");
  check_links(folder, roots, 0);
  DatasetOptions options;
  options.pose_frame = request.pose_frame;
  if (!request.poses.empty()) options.poses = resolve_below(roots, request.poses, folder);
  return open_dataset(folder, options);
}

void set_threads(MapperOptions& options, int threads) {
  options.build.threads = options.registration.threads = threads;
  options.loops.registration.threads = options.pose_graph.threads = threads;
  options.junction.relocalise.threads = threads;
}

}  // namespace cellmap::server
