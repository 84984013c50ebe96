#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "cellmap/evaluation/reconstruction_metrics.hpp"
#include "cellmap/evaluation/representation.hpp"

namespace cellmap {

/// How representations of the same drive are compared.
///
/// Size: bytes of the files on the disk, after they were written there; read back from there.
///
/// Reconstruction: against the stacked points (those the map was made of), both ways, for what lies
/// within `evaluation_range_m` of a scan's position, level. A representation that says a surface
/// (surfels, mesh, patches of CELLs) is taken at its surface, the others at their points, which is
/// what their files hold: a cloud thinned to 0.4 m cannot be complete within 0.05 m, and that is
/// what is told. Distances are cut at kReconstructionLimitM.
///
/// Registration: every held-back scan, thinned alike for all, from the same seeded starts, with the
/// same stages, gates, kernels and end (`RegistrationOptions`). What differs is what the
/// representation itself offers: to a CELL the plane of the point's direction (`register_scan`, the
/// CELL nearest to the start), to all else the plane at the nearest point (`register_to_points`):
/// normals as stored, or estimated from the decoded points where the files hold none. Clouds denser
/// than `thin_m` are thinned to it first, as all who register to them do, since normals of points
/// that lie nearer than their noise are noise. The error of a registration is how far it puts the
/// scan's points, in the mean, from where the drive's own pose of the scan puts them: one number
/// for translation and rotation, which at 20 m counts a degree as 0.35 m. That pose's own error
/// (none in the simulator, centimetres on KITTI) all rows share.
struct ComparisonOptions {
  double evaluation_range_m = 30;
  std::size_t samples = 100'000;  ///< distances each way
  double start_error_m = 0.3, start_error_deg = 1.0;
  std::size_t starts = 2;  ///< of each held-back scan
  std::size_t registration_points = 20'000;
  double thin_m = 0.1;
  double failed_m = 1.0;  ///< a registration with a larger error has failed
  std::uint64_t seed = 1;
  int threads = 1;  ///< 0: all. Nothing but times depends on it.

  /// Throws Error{kInvalidArgument} naming the option and its range.
  void validate() const;
};

/// One representation of one drive. NaN where it could not be said.
struct ComparisonRow {
  std::string name;
  bool measured = true;
  std::string note;  ///< of a row that was not measured: whose figure it is, or why there is none
  std::uint64_t bytes = 0;
  double bytes_per_m = 0;
  std::optional<std::uint64_t> planes;  ///< of CELLs
  ReconstructionErrors reconstruction;
  /// Medians over the registrations that did not fail: of the error, and of it what the sensor is
  /// off and turned.
  double registration_error_m = 0, registration_origin_m = 0, registration_turn_deg = 0;
  std::size_t registrations = 0, failed = 0;
  double encode_s = 0;  ///< processor time from scans and poses to bytes, of all threads
  double decode_s = 0;  ///< from bytes to `DecodedMap`
};

struct Comparison {
  std::string dataset;
  std::size_t scans = 0, held_back = 0;
  double length_m = 0;
  std::vector<ComparisonRow> rows;
};

/// Measures every representation in turn. Files are written to a folder each under `folder`, which
/// is made. `progress` names the row that begins. Throws Error{kCancelled} between rows, {kIo}, and
/// what the representations throw. Memory: the drive, its stacked points and one representation.
Comparison compare(const ComparedDrive& drive, const std::vector<Representation>& representations,
                   const ComparisonOptions& options, const std::filesystem::path& folder,
                   const std::stop_token& stop = {},
                   const std::function<void(const std::string& name)>& progress = {});

/// A row for somebody else's figure, and one for what this build cannot measure.
ComparisonRow published_row(const PublishedRow& published);
ComparisonRow missing_row(std::string name, std::string why);

/// One JSON object: dataset, scans, held_back, length_m, rows; NaN and what does not apply is null,
/// and everything of a row that was not measured but a published `bytes_per_m`.
std::string to_json(const Comparison& comparison);

/// A table for people, one row a representation.
std::string to_table(const Comparison& comparison);

/// One HTML page with plots of size against error, that needs nothing but itself; light and dark.
std::string to_html(const Comparison& comparison);

}  // namespace cellmap
