#include "cellmap/registration/residuals.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>

#include "cellmap/core/parallel.hpp"
#include "cellmap/simd/residuals.hpp"

namespace cellmap {
namespace {

/// Chunks are what threads share out, blocks what stays in the nearest cache. Both fixed, so that
/// sums are formed in the same order on any number of threads.
constexpr std::size_t kPointsABlock = 512;
constexpr std::size_t kPointsAChunk = 16 * kPointsABlock;

/// The pose that moves a term's scan into its CELL's frame.
Pose moving_pose(const RegistrationTerm& term, const Pose& T) {
  return term.reverse ? T.inverse(Eigen::Isometry) : T;
}

simd::Motion to_motion(const Pose& T) {
  simd::Motion motion;
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t c = 0; c < 3; ++c) {
      motion.R[3 * r + c] = static_cast<float>(T.linear()(r, c));
    }
    motion.t[r] = static_cast<float>(T.translation()[r]);
  }
  return motion;
}

simd::Weights to_weights(const RegistrationStage& stage) {
  simd::Weights weights;
  weights.gate_m = static_cast<float>(stage.gate_m);
  weights.inverse_width = static_cast<float>(1.0 / stage.kernel_width_m);
  switch (stage.kernel) {
    case RobustKernel::kNone:
      break;
    case RobustKernel::kCauchy:
      weights.weighting = simd::Weighting::kCauchy;
      break;
    case RobustKernel::kGemanMcClure:
      weights.weighting = simd::Weighting::kGemanMcClure;
      break;
  }
  return weights;
}

/// Points in the CELL's frame and what belongs to them.
struct alignas(64) Block {
  std::size_t begin = 0, count = 0;  // in the scan
  std::array<float, kPointsABlock> x, y, z;
  std::array<float, kPointsABlock> scratch;

  simd::Points points() const { return {x.data(), y.data(), z.data()}; }
};

/// Adds sums for the left perturbation of the pose that moves the scan as sums for that of T: where
/// the scan is moved by T^-1, exp(xi) T is T exp(Ad xi), its inverse exp(-Ad xi) T^-1, with the
/// adjoint of T^-1.
void add_to(NormalSystem& system, std::span<const simd::NormalSums> chunks, bool reverse,
            const Pose& T) {
  simd::NormalSums sums;
  for (const simd::NormalSums& chunk : chunks) sums.add(chunk);
  Matrix6d H;
  Tangent g;
  std::size_t k = 0;
  for (int row = 0; row < 6; ++row) {
    g[row] = sums.jd[static_cast<std::size_t>(row)];
    for (int col = row; col < 6; ++col) H(row, col) = H(col, row) = sums.jj[k++];
  }
  if (reverse) {
    const Matrix6d A = adjoint(T.inverse(Eigen::Isometry));
    H = A.transpose() * H * A;
    g = -A.transpose() * g;
  }
  system.H += H;
  system.g += g;
  system.points += sums.points;
}

std::size_t chunks_of(std::size_t points) { return (points + kPointsAChunk - 1) / kPointsAChunk; }

}  // namespace

Residual evaluate(const RegistrationTerm& term, const Pose& T, std::size_t point) {
  const Eigen::Vector3d p = (*term.scan)[point].cast<double>();
  const Pose T_cell_scan = moving_pose(term, T);
  const Eigen::Vector3d moved = T_cell_scan * p;
  if (!(moved.squaredNorm() > 0)) return {};  // at the origin there is no direction
  const std::uint32_t index = term.target->lattice().nearest(moved);
  const std::uint32_t slot = index == Lattice::kNowhere ? 0 : term.target->slot_of(index);
  if (slot == 0) return {};
  const simd::HessePlane& plane = term.target->plane_table().of(index);
  const Eigen::Vector3d normal(plane.nx, plane.ny, plane.nz);
  Residual residual{static_cast<std::int32_t>(slot - 1), normal.dot(moved) - plane.offset_m, {}};
  if (term.reverse) {  // -n^T R^-1 [I, -[p]x]
    const Eigen::Vector3d m = -(T.linear() * normal);
    residual.jacobian << m, p.cross(m);
  } else {  // n^T [I, -[T p]x]
    residual.jacobian << normal, moved.cross(normal);
  }
  return residual;
}

MatchedTerm::MatchedTerm(const RegistrationTerm& term, Effort effort, const ReuseBound& reuse)
    : term_(term), effort_(std::move(effort)), reuse_(reuse), places_(term.scan->size()) {}

std::uint32_t MatchedTerm::slot_of(std::size_t point) const {
  const simd::PlaneTable planes = term_.target->plane_table();
  const std::uint32_t place = places_[point];
  return place == planes.count ? 0 : term_.target->slot_of(planes.first + place);
}

bool MatchedTerm::serves(const Pose& T) const {
  if (!looked_up_at_ || !(reuse_.median_range_m > 0)) return false;
  const double translation = (looked_up_at_->translation() - T.translation()).norm();
  return angle_between_rad(*looked_up_at_, T) + translation / reuse_.median_range_m <=
         reuse_.angle_rad;
}

/// Calls `per_block(block, chunk)` for all blocks; chunks may be on different threads.
template <typename PerBlock>
void MatchedTerm::visit(const Pose& T, const PerBlock& per_block) {
  is_fresh_ = !serves(T);
  if (is_fresh_) looked_up_at_ = T;
  const simd::Motion motion = to_motion(moving_pose(term_, T));
  const PointCloud& scan = *term_.scan;
  const RegistrationTarget& target = *term_.target;
  const simd::PlaneTable planes = target.plane_table();
  parallel_for(scan.size(), kPointsAChunk, effort_, [&](std::size_t first, std::size_t last) {
    Block block;
    for (block.begin = first; block.begin < last; block.begin += kPointsABlock) {
      block.count = std::min(kPointsABlock, last - block.begin);
      simd::move(
          motion,
          {scan.x.data() + block.begin, scan.y.data() + block.begin, scan.z.data() + block.begin},
          block.count, {block.x.data(), block.y.data(), block.z.data()});
      if (is_fresh_) {
        const auto places = std::span(places_).subspan(block.begin, block.count);
        target.lattice().nearest(block.x.data(), block.y.data(), block.z.data(), places);
        simd::find_planes(planes, places.data(), block.count, places.data());
      }
      per_block(block, first / kPointsAChunk);
    }
  });
}

void MatchedTerm::add_normal_equations(const Pose& T, const RegistrationStage& stage,
                                       NormalSystem& system) {
  const simd::Weights weights = to_weights(stage);
  const simd::PlaneTable planes = term_.target->plane_table();
  std::vector<simd::NormalSums> chunks(chunks_of(places_.size()));
  visit(T, [&](Block& block, std::size_t chunk) {
    simd::accumulate(planes, places_.data() + block.begin, block.points(), block.count, weights,
                     chunks[chunk]);
  });
  add_to(system, chunks, term_.reverse, T);
}

HitDistances MatchedTerm::distances(const Pose& T) {
  const simd::PlaneTable planes = term_.target->plane_table();
  std::vector<float> distance_m(places_.size());
  visit(T, [&](Block& block, std::size_t) {
    simd::distances(planes, places_.data() + block.begin, block.points(), block.count,
                    distance_m.data() + block.begin);
  });
  std::vector<std::uint32_t> plane(places_.size());
  std::size_t hits = 0;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const std::uint32_t slot = slot_of(i);
    plane[hits] = slot - 1;
    distance_m[hits] = distance_m[i];
    hits += slot != 0;
  }
  plane.resize(hits);
  distance_m.resize(hits);
  return {places_.size(), std::move(distance_m), std::move(plane)};
}

void MatchedTerm::add_plane_weighted(const Pose& T, double gate_m,
                                     std::span<const double> weight_of_plane,
                                     NormalSystem& system) {
  assert(weight_of_plane.size() == term_.target->cell().planes.size());
  std::vector<float> weight_of_slot = {0.0f};
  weight_of_slot.insert(weight_of_slot.end(), weight_of_plane.begin(), weight_of_plane.end());
  const simd::PlaneTable planes = term_.target->plane_table();
  simd::Weights weights{simd::Weighting::kGiven, static_cast<float>(gate_m), 0, nullptr};
  std::vector<simd::NormalSums> chunks(chunks_of(places_.size()));
  visit(T, [&](Block& block, std::size_t chunk) {
    for (std::size_t k = 0; k < block.count; ++k) {
      block.scratch[k] = weight_of_slot[slot_of(block.begin + k)];
    }
    simd::Weights given = weights;
    given.given = block.scratch.data();
    simd::accumulate(planes, places_.data() + block.begin, block.points(), block.count, given,
                     chunks[chunk]);
  });
  add_to(system, chunks, term_.reverse, T);
}

}  // namespace cellmap
