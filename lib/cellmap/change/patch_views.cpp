#include "cellmap/change/patch_views.hpp"

#include <array>
#include <cmath>
#include <numbers>
#include <span>

#include "cellmap/geometry/angle.hpp"

namespace cellmap {
namespace {

/// The patch in a direction and the six around it.
constexpr std::size_t kDirections = 7;
/// From the middle of a patch to that of its neighbours, in mean radii of patches: discs in a
/// triangular lattice.
constexpr double kSpacing = 1.9;

/// What a CELL sees around many directions.
class Neighbourhoods {
 public:
  Neighbourhoods(const RegistrationTarget& cell, const PointCloud& towards) : cell_(cell) {
    const double angle = kSpacing * cell.lattice().patch_radius_rad();
    directions_.reserve(kDirections * towards.size());
    for (std::size_t i = 0; i < towards.size(); ++i) {
      const Eigen::Vector3f u = towards[i].normalized();
      const Eigen::Vector3f a = u.unitOrthogonal(), b = u.cross(a);
      directions_.push_back(u);
      for (std::size_t k = 0; k + 1 < kDirections; ++k) {
        const double turn = 2 * std::numbers::pi * static_cast<double>(k) / (kDirections - 1);
        const Eigen::Vector3f aside =
            static_cast<float>(std::cos(turn)) * a + static_cast<float>(std::sin(turn)) * b;
        directions_.push_back(static_cast<float>(std::cos(angle)) * u +
                              static_cast<float>(std::sin(angle)) * aside);
      }
    }
    patch_.resize(directions_.size());
    cell.lattice().nearest(directions_, patch_);
  }

  /// What lies in direction `k` around the point `i`: the middle one first.
  struct Seen {
    const Plane* plane = nullptr;  ///< null: nothing
    Eigen::Vector3f direction;
    Eigen::Vector3f normal;
    float offset_m = 0;
    std::uint32_t slot = 0;
  };
  Seen at(std::size_t i, std::size_t k) const {
    const std::size_t at = kDirections * i + k;
    Seen seen;
    seen.direction = directions_[at];
    if (patch_[at] == Lattice::kNowhere) return seen;
    seen.slot = cell_.slot_of(patch_[at]);
    if (seen.slot == 0) return seen;
    const simd::HessePlane& hesse = cell_.hesse_plane(seen.slot);
    seen.plane = &cell_.cell().planes[seen.slot - 1];
    seen.normal = {hesse.nx, hesse.ny, hesse.nz};
    seen.offset_m = hesse.offset_m;
    return seen;
  }

 private:
  const RegistrationTarget& cell_;
  PointCloud directions_;
  std::vector<std::uint32_t> patch_;
};

PointCloud centres_of(const RegistrationTarget& cell) {
  return reconstruct_points(cell.cell(), cell.lattice());
}

Eigen::Vector3f normal_of(const Plane& plane) { return {plane.nx, plane.ny, plane.nz}; }

/// Judges a patch by what another CELL sees around its direction.
class Judge {
 public:
  Judge(const DiffOptions& options, double patch_radius_rad)
      : options_(options),
        same_facing_(static_cast<float>(std::cos(options.same_facing_deg * kRadPerDeg))),
        least_sine_(static_cast<float>(std::sin(options.min_angle_deg * kRadPerDeg))),
        spacing_rad_(static_cast<float>(kSpacing * patch_radius_rad)) {}

  PatchView operator()(const Eigen::Vector3f& at, const Eigen::Vector3f& normal,
                       const Neighbourhoods& around, std::size_t i) const {
    const float range = at.norm();
    if (!(range > 0 && range <= options_.max_range_m)) return PatchView::kNothing;
    std::size_t through = 0;
    bool hidden = false, middle_through = false;
    for (std::size_t k = 0; k < kDirections; ++k) {
      const auto seen = around.at(i, k);
      if (!seen.plane) continue;
      if (confirms(seen, at, normal, range, k == 0)) return PatchView::kConfirmed;
      hidden |= seen.plane->distance_m < range - margin(range);
      if (!looks_through(seen, range)) continue;
      ++through;
      middle_through |= k == 0;
    }
    const bool grazing = std::abs(normal.dot(at)) < least_sine_ * range;
    const bool clear = middle_through && through >= options_.clear_directions && !hidden;
    return clear && !grazing ? PatchView::kSeenThrough : PatchView::kNothing;
  }

 private:
  using Seen = Neighbourhoods::Seen;

  float margin(float range) const {
    return static_cast<float>(options_.margin_m + options_.margin_share * range);
  }

  bool confirms(const Seen& seen, const Eigen::Vector3f& at, const Eigen::Vector3f& normal,
                float range, bool is_middle) const {
    const auto near = static_cast<float>(options_.stayed_distance_m);
    const float beyond = std::abs(seen.plane->distance_m - range);
    if (beyond <= near) return true;
    if (!is_middle) return false;
    // The other CELL's plane goes on for about a patch: far along the ray where it is grazed.
    const float cosine = std::max(1e-3f, std::abs(seen.normal.dot(seen.direction)));
    const float stretch =
        1.5f * spacing_rad_ * range * std::sqrt(1 - std::min(1.f, cosine * cosine)) / cosine;
    return beyond <= near + stretch && std::abs(seen.normal.dot(at) - seen.offset_m) <= near &&
           std::abs(seen.normal.dot(normal)) >= same_facing_;
  }

  bool looks_through(const Seen& seen, float range) const {
    const float in_front = range * seen.normal.dot(seen.direction) - seen.offset_m;
    return seen.plane->distance_m >= range + margin(range) && in_front >= options_.clear_distance_m;
  }

  const DiffOptions& options_;
  float same_facing_, least_sine_, spacing_rad_;
};

}  // namespace

std::vector<PatchView> views_of(const RegistrationTarget& cell, const RegistrationTarget& other,
                                const Pose& T_other_cell, const DiffOptions& options) {
  const PointCloud centres = transformed(centres_of(cell), T_other_cell);
  const Eigen::Matrix3f rotation = T_other_cell.linear().cast<float>();
  const Neighbourhoods around(other, centres);
  const Judge judge(options, other.lattice().patch_radius_rad());
  std::vector<PatchView> views(centres.size(), PatchView::kNothing);
  for (std::size_t i = 0; i < centres.size(); ++i) {
    const Plane& plane = cell.cell().planes[i];
    if (plane.distance_m > options.max_range_m) continue;
    views[i] = judge(centres[i], rotation * normal_of(plane), around, i);
  }
  return views;
}

std::vector<bool> surface_patches(const RegistrationTarget& cell, const DiffOptions& options) {
  constexpr float kSameSurface = 0.8f;  // cos 37 deg: a car is round
  const PointCloud centres = centres_of(cell);
  const Neighbourhoods around(cell, centres);
  const auto least_sine = static_cast<float>(std::sin(options.min_angle_deg * kRadPerDeg));
  std::vector<bool> surface(centres.size(), false);
  for (std::size_t i = 0; i < centres.size(); ++i) {
    const Plane& plane = cell.cell().planes[i];
    const Eigen::Vector3f normal = normal_of(plane);
    const float apart = 0.1f + 0.01f * plane.distance_m;
    if (std::abs(normal.dot(centres[i])) < least_sine * centres[i].norm()) continue;
    std::size_t going_on = 0;
    for (std::size_t k = 1; k < kDirections; ++k) {
      const auto seen = around.at(i, k);
      if (!seen.plane || seen.normal.dot(normal) < kSameSurface) continue;
      going_on += std::abs(seen.normal.dot(centres[i]) - seen.offset_m) <= apart;
    }
    surface[i] = going_on >= options.least_surface;
  }
  return surface;
}

std::vector<bool> standing_together(const RegistrationTarget& cell, const std::vector<bool>& marked,
                                    std::size_t least) {
  const Neighbourhoods around(cell, centres_of(cell));
  std::vector<bool> kept(marked.size(), false);
  for (std::size_t i = 0; i < marked.size(); ++i) {
    if (!marked[i]) continue;
    std::size_t together = 0;
    for (std::size_t k = 1; k < kDirections; ++k) {
      const auto seen = around.at(i, k);
      together += seen.plane && marked[seen.slot - 1];
    }
    kept[i] = together >= least;
  }
  return kept;
}

}  // namespace cellmap
