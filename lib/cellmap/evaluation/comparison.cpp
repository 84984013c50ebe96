#include "cellmap/evaluation/comparison.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <fstream>
#include <limits>
#include <unordered_set>

#include "cellmap/core/error.hpp"
#include "cellmap/core/progress.hpp"
#include "cellmap/evaluation/held_back_registration.hpp"
#include "cellmap/evaluation/surface_index.hpp"

namespace cellmap {
namespace {

namespace fs = std::filesystem;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
/// Beyond the range that is evaluated, so that nothing at its edge lacks its neighbour.
constexpr double kMarginM = 1.0;
/// The stacked points are asked once for so large an area each, however often it was scanned.
constexpr double kReferenceVoxelM = 0.1;
constexpr std::size_t kMaxReferencePoints = 12'000'000;

double processor_s() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

/// At most about `count`, evenly spread over the order.
PointCloud thinned(const PointCloud& cloud, std::size_t count) {
  return every_nth(cloud, std::max<std::size_t>(1, (cloud.size() + count - 1) / count));
}

/// The first point of each voxel.
PointCloud one_a_voxel(const PointCloud& points, double voxel_m) {
  std::unordered_set<std::uint64_t> seen;
  PointCloud result;
  const auto part = [&](float v) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(v / voxel_m)) +
                                      (1 << 20)) &
           0x1fffffU;
  };
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::uint64_t key = part(points.x[i]) << 42 | part(points.y[i]) << 21 | part(points.z[i]);
    if (seen.insert(key).second) result.push_back(points[i]);
  }
  return result;
}

/// What lies along the path of the mapped scans.
class Corridor {
 public:
  explicit Corridor(const ComparedDrive& drive) : path_(path_of(drive)), tree_(path_) {}

  bool holds(const Eigen::Vector3f& p, double range_m) const {
    return tree_.nearest({p.x(), p.y(), 0}).squared_distance_m2 <= range_m * range_m;
  }
  PointCloud within(const PointCloud& points, double range_m) const {
    PointCloud kept;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (holds(points[i], range_m)) kept.push_back(points[i]);
    }
    return kept;
  }
  TriangleMesh within(const TriangleMesh& mesh, double range_m) const {
    TriangleMesh kept;
    kept.vertices = mesh.vertices;
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      const auto [a, b, c] = mesh.corners(t);
      const Eigen::Vector3d middle = (a + b + c) / 3;
      if (holds(middle.cast<float>(), range_m)) kept.triangles.push_back(mesh.triangles[t]);
    }
    return kept;
  }

 private:
  static PointCloud path_of(const ComparedDrive& drive) {
    PointCloud path;
    for (const PlacedScan& placed : drive.mapped) {
      const Eigen::Vector3d p = placed.T_map_scan.translation();
      path.push_back(Eigen::Vector3d(p.x(), p.y(), 0).cast<float>());
    }
    return path;
  }
  PointCloud path_;
  NearestPoints tree_;
};

/// The stacked points, against which all rows are measured.
class Reference {
 public:
  Reference(const ComparedDrive& drive, const ComparisonOptions& options)
      : options_(options),
        corridor_(drive),
        points_(
            thinned(corridor_.within(stacked_points(drive), options.evaluation_range_m + kMarginM),
                    kMaxReferencePoints)),
        tree_(points_),
        asked_(thinned(
            corridor_.within(one_a_voxel(points_, kReferenceVoxelM), options.evaluation_range_m),
            options.samples)) {}

  ReconstructionErrors measure(const DecodedMap& map) const {
    const double range_m = options_.evaluation_range_m;
    if (map.surface.empty()) {
      const PointCloud points = corridor_.within(map.points, range_m + kMarginM);
      if (points.empty()) return reconstruction_errors({}, {});
      const PointCloud samples = thinned(corridor_.within(points, range_m), options_.samples);
      return errors(samples, distances_to_points(asked_, NearestPoints(points), options_.threads));
    }
    const TriangleMesh surface = corridor_.within(map.surface, range_m + kMarginM);
    const PointCloud samples = corridor_.within(sample_surface(surface, options_.samples), range_m);
    return errors(samples, distances_to_surface(asked_, surface, options_.threads));
  }

 private:
  ReconstructionErrors errors(const PointCloud& samples,
                              const std::vector<double>& from_points_m) const {
    return reconstruction_errors(distances_to_points(samples, tree_, options_.threads),
                                 from_points_m);
  }

  const ComparisonOptions& options_;
  Corridor corridor_;
  PointCloud points_;
  NearestPoints tree_;
  PointCloud asked_;
};

std::string folder_name(const std::string& row) {
  std::string name;
  for (const char c : row) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.';
    if (plain) {
      name += c;
    } else if (!name.empty() && name.back() != '-') {
      name += '-';
    }
  }
  return name;
}

std::uint64_t write_files(const MapFiles& files, const fs::path& folder) {
  fs::create_directories(folder);
  std::uint64_t bytes = 0;
  for (const MapFile& file : files) {
    const fs::path path = folder / file.name;
    std::ofstream out(path, std::ios::binary | std::ios::trunc);
    out.write(reinterpret_cast<const char*>(file.bytes.data()),
              static_cast<std::streamsize>(file.bytes.size()));
    out.close();
    if (!out) throw Error(ErrorCode::kIo, path.string() + ": cannot be written");
    bytes += fs::file_size(path);
  }
  return bytes;
}

void read_files(MapFiles& files, const fs::path& folder) {
  for (MapFile& file : files) {
    std::ifstream in(folder / file.name, std::ios::binary);
    in.read(reinterpret_cast<char*>(file.bytes.data()),
            static_cast<std::streamsize>(file.bytes.size()));
    if (!in) throw Error(ErrorCode::kIo, (folder / file.name).string() + ": cannot be read");
  }
}

ComparisonRow measure(const ComparedDrive& drive, const Representation& representation,
                      const Reference& reference, const ComparisonOptions& options,
                      const fs::path& folder) {
  ComparisonRow row;
  row.name = representation.name;
  const double begun_s = processor_s();
  MapFiles files = representation.encode(drive);
  row.encode_s = processor_s() - begun_s;
  row.bytes = write_files(files, folder);
  row.bytes_per_m = static_cast<double>(row.bytes) / drive.length_m;
  read_files(files, folder);
  const double read_s = processor_s();
  const DecodedMap map = representation.decode(files);
  row.decode_s = processor_s() - read_s;
  if (!map.cells.empty()) {
    row.planes = 0;
    for (const ReadCell& placed : map.cells) *row.planes += placed.target->cell().planes.size();
  }
  row.reconstruction = reference.measure(map);
  const HeldBackErrors errors = register_held_back(drive, map, options);
  row.registration_error_m = errors.points_m;
  row.registration_origin_m = errors.origin_m;
  row.registration_turn_deg = errors.turn_deg;
  row.registrations = errors.registrations;
  row.failed = errors.failed;
  return row;
}

ComparisonRow unmeasured(std::string name, std::string note) {
  ComparisonRow row;
  row.name = std::move(name);
  row.measured = false;
  row.note = std::move(note);
  row.bytes_per_m = kNaN;
  return row;
}

}  // namespace

void ComparisonOptions::validate() const {
  const auto require = [](bool holds, const char* message) {
    if (!holds) throw Error(ErrorCode::kInvalidArgument, message);
  };
  require(evaluation_range_m >= 1 && evaluation_range_m <= 1000,
          "evaluation_range_m: expected 1 to 1000");
  require(samples >= 1 && samples <= 10'000'000, "samples: expected 1 to 10,000,000");
  require(start_error_m >= 0 && start_error_m <= 10, "start_error_m: expected 0 to 10");
  require(start_error_deg >= 0 && start_error_deg <= 90, "start_error_deg: expected 0 to 90");
  require(starts >= 1 && starts <= 1000, "starts: expected 1 to 1000");
  require(registration_points >= 100, "registration_points: expected at least 100");
  require(thin_m > 0 && thin_m <= 10, "thin_m: expected more than 0, up to 10");
  require(failed_m > 0, "failed_m: expected more than 0");
}

Comparison compare(const ComparedDrive& drive, const std::vector<Representation>& representations,
                   const ComparisonOptions& options, const fs::path& folder,
                   const std::stop_token& stop,
                   const std::function<void(const std::string&)>& progress) {
  options.validate();
  if (!(drive.length_m > 0)) {
    throw Error(ErrorCode::kInvalidArgument,
                "expected a drive that moves, found one that does not");
  }
  const Reference reference(drive, options);
  Comparison comparison;
  comparison.scans = drive.mapped.size() + drive.held_back.size();
  comparison.held_back = drive.held_back.size();
  comparison.length_m = drive.length_m;
  for (const Representation& representation : representations) {
    throw_if_stopped(stop);
    if (progress) progress(representation.name);
    comparison.rows.push_back(measure(drive, representation, reference, options,
                                      folder / folder_name(representation.name)));
  }
  return comparison;
}

ComparisonRow published_row(const PublishedRow& published) {
  ComparisonRow row = unmeasured(published.name, "published: " + published.source);
  row.bytes_per_m = published.bytes_per_m;
  return row;
}

ComparisonRow missing_row(std::string name, std::string why) {
  return unmeasured(std::move(name), std::move(why));
}

}  // namespace cellmap
