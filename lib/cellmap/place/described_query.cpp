#include "cellmap/place/described_query.hpp"

#include <algorithm>
#include <numbers>
#include <tuple>

#include "cellmap/place/polar_image.hpp"

namespace cellmap {
namespace {

constexpr double kCentreStepM = 2.0;
constexpr int kSteps = 2;
/// A bin is 4 m by 6 deg and needs no more to be described.
constexpr std::size_t kMostViewPoints = 20'000;
constexpr std::size_t kTurns = PlaceSignature::kSectors;
/// Of the first look at many CELLs. With seven, one in eight occluded queries lost its place.
constexpr std::size_t kFirstLookHarmonics = 10;
constexpr std::size_t kAllHarmonics = PlaceSignature::kHarmonics + 1;

}  // namespace

DescribedQuery::DescribedQuery(const PointCloud& points) : ground_(fit_ground(points)) {
  const PointCloud few = every_nth(points, points.size() / kMostViewPoints + 1);
  const Columns columns(transformed(few, ground_.T_ground_sensor));
  seen_ = columns.seen();
  sees_all_ = columns.sees_all();
  std::vector<PlaceSignature> signatures, some;
  for (int i = -kSteps; i <= kSteps; ++i) {
    for (int j = -kSteps; j <= kSteps; ++j) {
      const Eigen::Vector2d centre = kCentreStepM * Eigen::Vector2d(i, j);
      signatures.emplace_back(columns, centre);
      copies_.push_back({centre, signatures.back()});
      if ((i + j) % 2 == 0) some.push_back(signatures.back());
    }
  }
  views_ = PlaceSignature::side_by_side(signatures);
  some_views_ = PlaceSignature::side_by_side(some);
}

float likeness(const DescribedQuery& query, const DescribedPlace& place) {
  if (query.sees_all()) return place.signature.most_alike(query.views(), kAllHarmonics);
  const PlaceSignature signature = place.signature.expanded();
  std::array<float, kTurns> by_turn;
  signature.correlate(query.views(), kAllHarmonics, by_turn);
  const PlaceSignature::Correlation visible = signature.visible_share(query.seen());
  for (std::size_t k = 0; k < kTurns; ++k) by_turn[k] /= visible[k];
  return *std::max_element(by_turn.begin(), by_turn.end());
}

float first_likeness(const DescribedQuery& query, const DescribedPlace& place) {
  return place.signature.most_alike(query.some_views(), kFirstLookHarmonics);
}

std::vector<PlaceAlignment> align(const DescribedQuery& query, const DescribedPlace& place,
                                  std::size_t count) {
  struct Peak {
    float similarity;
    std::size_t copy, turn;
  };
  const PlaceSignature signature = place.signature.expanded();
  std::vector<Peak> peaks;
  const PlaceSignature::Correlation visible = query.sees_all()
                                                  ? PlaceSignature::Correlation::Ones().eval()
                                                  : signature.visible_share(query.seen());
  for (std::size_t c = 0; c < query.copies().size(); ++c) {
    const PlaceSignature::Correlation agreement =
        signature.correlate(query.copies()[c].signature).cwiseQuotient(visible);
    for (std::size_t k = 0; k < kTurns; ++k) {
      const float before = agreement[(k + kTurns - 1) % kTurns];
      const float after = agreement[(k + 1) % kTurns];
      if (agreement[k] >= before && agreement[k] > after) peaks.push_back({agreement[k], c, k});
    }
  }
  count = std::min(count, peaks.size());
  std::partial_sort(peaks.begin(), peaks.begin() + static_cast<std::ptrdiff_t>(count), peaks.end(),
                    [](const Peak& a, const Peak& b) {
                      return std::tuple(-a.similarity, a.copy, a.turn) <
                             std::tuple(-b.similarity, b.copy, b.turn);
                    });
  std::vector<PlaceAlignment> best;
  for (std::size_t i = 0; i < count; ++i) {
    // The copy's centre comes to lie on the CELL's origin: p_cell = R (p_query - centre), both in
    // their ground frames.
    const Eigen::Vector2d& centre = query.copies()[peaks[i].copy].centre;
    const double yaw = 2 * std::numbers::pi * static_cast<double>(peaks[i].turn) / kTurns;
    const Pose T_ground_ground =
        upright_pose(0, 0, yaw) * upright_pose(-centre.x(), -centre.y(), 0);
    best.push_back(
        {place.T_ground_cell.inverse() * T_ground_ground * query.ground().T_ground_sensor,
         peaks[i].similarity});
  }
  return best;
}

}  // namespace cellmap
