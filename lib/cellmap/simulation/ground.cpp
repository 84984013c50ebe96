#include "cellmap/simulation/ground.hpp"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>

#include "cellmap/simulation/random.hpp"

namespace cellmap::simulation {
namespace {

constexpr double kReach_m = 160.0;
constexpr double kGroundCell_m = 32.0;
constexpr double kBlend_m = 4.0;
constexpr double kSlopeReach2_m2 = 400.0;

std::uint64_t grid_key(double x, double y) {
  const auto gx = static_cast<std::int32_t>(std::floor(x / kGroundCell_m));
  const auto gy = static_cast<std::int32_t>(std::floor(y / kGroundCell_m));
  return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(gx)) << 32) |
         static_cast<std::uint32_t>(gy);
}

/// Every second vertex or so: the heights of a street do not change faster.
std::vector<std::size_t> thinned(const Centreline& line) {
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < line.vertices().size(); ++i) {
    if (kept.empty() || line.arc_of_vertex_m(i) - line.arc_of_vertex_m(kept.back()) >= 2.0) {
      kept.push_back(i);
    }
  }
  return kept;
}

/// Pairs of samples that lie at the same place on different passes.
std::vector<std::pair<int, int>> revisits(const Centreline& line,
                                          const std::vector<std::size_t>& samples) {
  constexpr double near_m = 6.0, pass_gap_m = 40.0;
  std::unordered_map<std::uint64_t, std::vector<int>> grid;
  std::vector<std::pair<int, int>> pairs;
  for (int i = 0; i < static_cast<int>(samples.size()); ++i) {
    const Eigen::Vector2d p = line.vertices()[samples[i]].head<2>();
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (const int j : grid[grid_key(p.x() + dx * kGroundCell_m, p.y() + dy * kGroundCell_m)]) {
          const double gap_m = line.arc_of_vertex_m(samples[i]) - line.arc_of_vertex_m(samples[j]);
          if (gap_m < pass_gap_m) continue;
          if ((line.vertices()[samples[j]].head<2>() - p).norm() < near_m) pairs.emplace_back(j, i);
        }
      }
    }
    grid[grid_key(p.x(), p.y())].push_back(i);
  }
  return pairs;
}

/// Heights in which passes of one place agree, at the least change of slope along the route:
/// minimises stiffness * sum (c_k+1 - c_k)^2 + sum over revisits (z_i + c_i - z_j - c_j)^2, c_0 =
/// 0.
Eigen::VectorXd reconciled_heights(const Centreline& line,
                                   const std::vector<std::size_t>& samples) {
  const auto n = static_cast<int>(samples.size());
  Eigen::VectorXd z(n);
  for (int i = 0; i < n; ++i) z[i] = line.vertices()[samples[i]].z();
  constexpr double stiffness = 400.0;
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
  const auto spring = [&](int i, int j, double weight, double difference) {
    entries.emplace_back(i, i, weight);
    entries.emplace_back(j, j, weight);
    entries.emplace_back(i, j, -weight);
    entries.emplace_back(j, i, -weight);
    right[i] += weight * difference;
    right[j] -= weight * difference;
  };
  entries.emplace_back(0, 0, 1e6);
  for (int i = 1; i < n; ++i) spring(i, i - 1, stiffness, 0);
  for (const auto& [i, j] : revisits(line, samples)) spring(i, j, 1.0, z[j] - z[i]);
  Eigen::SparseMatrix<double> normal(n, n);
  normal.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(normal);
  return z + solver.solve(right);
}

/// Smooth noise in [-1, 1] with features of about `scale_m`.
double value_noise(double x, double y, double scale_m, std::uint64_t seed) {
  const double gx = std::floor(x / scale_m), gy = std::floor(y / scale_m);
  const auto corner = [&](int dx, int dy) {
    const auto ix = static_cast<std::uint64_t>(static_cast<std::int64_t>(gx) + dx);
    const auto iy = static_cast<std::uint64_t>(static_cast<std::int64_t>(gy) + dy);
    return static_cast<double>(sub_seed(sub_seed(seed, ix), iy) >> 11) * 0x1p-52 - 1.0;
  };
  const auto fade = [](double t) { return t * t * (3 - 2 * t); };
  const double u = fade(x / scale_m - gx), v = fade(y / scale_m - gy);
  const double low = corner(0, 0) * (1 - u) + corner(1, 0) * u;
  const double high = corner(0, 1) * (1 - u) + corner(1, 1) * u;
  return low * (1 - v) + high * v;
}

}  // namespace

Ground::Ground(const Centreline& line, double sensor_height_m, std::uint64_t seed) : seed_(seed) {
  const std::vector<std::size_t> samples = thinned(line);
  const Eigen::VectorXd z = reconciled_heights(line, samples);
  const auto place = [&](std::size_t i) {
    Eigen::Vector3d p = line.vertices()[samples[i]];
    p.z() = z[static_cast<Eigen::Index>(i)] - sensor_height_m;
    return p;
  };
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const Eigen::Vector3d p = place(i);
    const Eigen::Vector3d chord =
        place(std::min(i + 2, samples.size() - 1)) - place(i > 2 ? i - 2 : 0);
    const double plan2 = chord.head<2>().squaredNorm();
    const Eigen::Vector2d slope =
        plan2 > 1 ? Eigen::Vector2d(chord.head<2>() * chord.z() / plan2) : Eigen::Vector2d::Zero();
    grid_[grid_key(p.x(), p.y())].push_back({p.x(), p.y(), p.z(), slope.x(), slope.y()});
  }
}

std::optional<double> Ground::height_m(double x, double y) const {
  double weights = 0, heights = 0, nearest2 = kReach_m * kReach_m;
  for (double gx = x - kReach_m; gx < x + kReach_m + kGroundCell_m; gx += kGroundCell_m) {
    for (double gy = y - kReach_m; gy < y + kReach_m + kGroundCell_m; gy += kGroundCell_m) {
      const auto found = grid_.find(grid_key(gx, gy));
      if (found == grid_.end()) continue;
      for (const Sample& sample : found->second) {
        const double dx = sample.x - x, dy = sample.y - y, d2 = dx * dx + dy * dy;
        if (d2 >= kReach_m * kReach_m) continue;
        const double fall = 1 - d2 / (kReach_m * kReach_m), near = d2 + kBlend_m * kBlend_m;
        const double weight = fall * fall / (near * near * near);
        weights += weight;
        // The slope of a street does not reach far beyond it.
        const double rise =
            -(sample.slope_x * dx + sample.slope_y * dy) / (1 + d2 / kSlopeReach2_m2);
        heights += weight * (sample.z + rise);
        nearest2 = std::min(nearest2, d2);
      }
    }
  }
  if (weights == 0) return std::nullopt;
  const double off_street = std::clamp((std::sqrt(nearest2) - 7.0) / 25.0, 0.0, 1.0);
  const double relief =
      0.5 * value_noise(x, y, 19.0, seed_) + 0.12 * value_noise(x, y, 5.0, mix(seed_));
  return heights / weights + off_street * off_street * (3 - 2 * off_street) * relief;
}

}  // namespace cellmap::simulation
