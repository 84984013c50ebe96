#include "cellmap/place/along_street.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <utility>

#include "cellmap/place/pose_search.hpp"

namespace cellmap {
namespace {

constexpr double kAlongStepM = 0.25;
constexpr std::size_t kMiddle = 16;  ///< steps to either side
constexpr std::size_t kApart = 3;
constexpr std::size_t kPeaks = 2;

/// How well a scan agrees at each step along the street.
using Profile = std::array<double, 2 * kMiddle + 1>;

std::vector<std::size_t> highest_peaks(const Profile& agreeing) {
  std::vector<std::pair<double, std::size_t>> peaks;
  for (std::size_t i = 0; i < agreeing.size(); ++i) {
    const bool is_peak = (i == 0 || agreeing[i - 1] <= agreeing[i]) &&
                         (i + 1 == agreeing.size() || agreeing[i + 1] <= agreeing[i]);
    if (is_peak && (i + kApart <= kMiddle || i >= kMiddle + kApart)) {
      peaks.push_back({-agreeing[i], i});
    }
  }
  std::sort(peaks.begin(), peaks.end());
  std::vector<std::size_t> highest;
  for (std::size_t k = 0; k < std::min(kPeaks, peaks.size()); ++k) {
    highest.push_back(peaks[k].second);
  }
  return highest;
}

}  // namespace

std::vector<Pose> starts_along_street(std::span<const CellAround> cells, const PointCloud& few,
                                      const Pose& T_cell_scan, const Matrix6d& information) {
  const Eigen::Vector2d along =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(information.topLeftCorner<2, 2>())
          .eigenvectors()
          .col(0);
  const auto at = [&](std::size_t step) {
    Pose T = T_cell_scan;
    T.translation().head<2>() +=
        kAlongStepM * (static_cast<double>(step) - static_cast<double>(kMiddle)) * along;
    return T;
  };
  Profile own{}, around{};
  for (const CellAround& cell : cells) {
    const bool is_own = &cell == &cells.front();
    const Pose T_this_own = cell.T_map_cell.inverse() * cells.front().T_map_cell;
    for (std::size_t step = 0; step < own.size(); ++step) {
      (is_own ? own : around)[step] +=
          agreement(score_scan(*cell.target, few, T_this_own * at(step)));
    }
  }
  std::vector<Pose> starts;
  for (const Profile& agreeing : {own, around}) {
    for (const std::size_t step : highest_peaks(agreeing)) starts.push_back(at(step));
  }
  return starts;
}

}  // namespace cellmap
