#include "cellmap/place/described_query.hpp"

#include <algorithm>
#include <cassert>
#include <numbers>
#include <tuple>
#include <utility>

#include "cellmap/place/polar_image.hpp"

namespace cellmap {
namespace {

constexpr double kCentreStepM = 2.0;
/// A bin is 4 m by 6 deg and needs no more to be described.
constexpr std::size_t kMostViewPoints = 20'000;
constexpr std::size_t kTurns = PlaceSignature::kSectors;
/// Of the first look at many CELLs. With seven, one in eight occluded queries lost its place.
constexpr std::size_t kFirstLookHarmonics = 10;
constexpr std::size_t kAllHarmonics = PlaceSignature::kHarmonics + 1;

/// Of the squares around a query, by number.
int column_of(std::size_t view) { return static_cast<int>(view) / (2 * QueryViews::kSteps + 1); }
int row_of(std::size_t view) { return static_cast<int>(view) % (2 * QueryViews::kSteps + 1); }

Eigen::Vector2d centre_of(std::size_t view) {
  return kCentreStepM *
         Eigen::Vector2d(column_of(view) - QueryViews::kSteps, row_of(view) - QueryViews::kSteps);
}

/// From its points in its ground frame.
QueryViews views_of(const PointCloud& points, const GiveWay& give_way) {
  const Columns columns(points);
  std::vector<PlaceSignature> signatures;
  signatures.reserve(QueryViews::kViews);
  for (std::size_t view = 0; view < QueryViews::kViews; ++view) {
    signatures.emplace_back(columns, centre_of(view));
    give_way();
  }
  return {std::move(signatures), columns.seen()};
}

}  // namespace

QueryViews::QueryViews(std::vector<PlaceSignature> signatures, const Seen& seen)
    : signatures_(std::move(signatures)),
      seen_(seen),
      sees_all_(std::all_of(seen.begin(), seen.end(), [](bool sees) { return sees; })) {
  assert(signatures_.size() == kViews);
  std::vector<PlaceSignature> some;
  for (std::size_t view = 0; view < kViews; ++view) {
    if ((column_of(view) + row_of(view)) % 2 == 0) some.push_back(signatures_[view]);
  }
  all_ = PlaceSignature::side_by_side(signatures_);
  some_ = PlaceSignature::side_by_side(some);
}

DescribedQuery::DescribedQuery(const PointCloud& points, const GiveWay& give_way)
    : ground_(fit_ground(points)),
      views_(views_of(transformed(every_nth(points, points.size() / kMostViewPoints + 1),
                                  ground_.T_ground_sensor),
                      give_way)) {}

float likeness(const QueryViews& query, const DescribedPlace& place) {
  if (query.sees_all()) return place.signature.most_alike(query.all(), kAllHarmonics);
  const PlaceSignature signature = place.signature.expanded();
  std::array<float, kTurns> by_turn;
  signature.correlate(query.all(), kAllHarmonics, by_turn);
  const PlaceSignature::Correlation visible = signature.visible_share(query.seen());
  for (std::size_t k = 0; k < kTurns; ++k) by_turn[k] /= visible[k];
  return *std::max_element(by_turn.begin(), by_turn.end());
}

float first_likeness(const QueryViews& query, const DescribedPlace& place) {
  return place.signature.most_alike(query.some(), kFirstLookHarmonics);
}

std::vector<PlaceAlignment> align(const DescribedQuery& query, const DescribedPlace& place,
                                  std::size_t count) {
  struct Peak {
    float similarity;
    std::size_t view, turn;
  };
  const QueryViews& views = query.views();
  const PlaceSignature signature = place.signature.expanded();
  std::vector<Peak> peaks;
  const PlaceSignature::Correlation visible = views.sees_all()
                                                  ? PlaceSignature::Correlation::Ones().eval()
                                                  : signature.visible_share(views.seen());
  for (std::size_t v = 0; v < QueryViews::kViews; ++v) {
    const PlaceSignature::Correlation agreement =
        signature.correlate(views.signatures()[v]).cwiseQuotient(visible);
    for (std::size_t k = 0; k < kTurns; ++k) {
      const float before = agreement[(k + kTurns - 1) % kTurns];
      const float after = agreement[(k + 1) % kTurns];
      if (agreement[k] >= before && agreement[k] > after) peaks.push_back({agreement[k], v, k});
    }
  }
  count = std::min(count, peaks.size());
  std::partial_sort(peaks.begin(), peaks.begin() + static_cast<std::ptrdiff_t>(count), peaks.end(),
                    [](const Peak& a, const Peak& b) {
                      return std::tuple(-a.similarity, a.view, a.turn) <
                             std::tuple(-b.similarity, b.view, b.turn);
                    });
  std::vector<PlaceAlignment> best;
  for (std::size_t i = 0; i < count; ++i) {
    // The view's centre comes to lie on the CELL's origin: p_cell = R (p_query - centre), both in
    // their ground frames.
    const Eigen::Vector2d centre = centre_of(peaks[i].view);
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
