#pragma once

#include <cstddef>
#include <cstdint>

#include "cellmap/core/give_way.hpp"

namespace cellmap {

/// When a patch is believed to have stayed or to be gone. The defaults put precision first: what is
/// called changed should be, and a patch of which nothing certain can be said counts as never seen.
/// Both sessions must lie in one frame to about half a metre; what is left of that is taken away by
/// registering each pair of CELLs before it is compared, and the distances below absorb the rest
/// (5 to 10 cm and a tenth of a degree).
struct DiffOptions {
  /// CELLs whose origins are farther apart than this are not compared.
  double reach_m = 15.0;
  /// CELLs of the other session that look at a CELL, nearest first. More see more and cost more.
  std::size_t views = 5;
  /// Patches farther than this from the origin of either CELL are not judged: a patch of 1 deg is
  /// 0.7 m wide there.
  double max_range_m = 40.0;

  /// Stayed: in the patch's direction the other CELL has a plane within this of it, along the
  /// normal and facing the same way within `same_facing_deg`; or there or in a direction beside it
  /// something at the patch's range, within this.
  double stayed_distance_m = 0.2;
  double same_facing_deg = 60.0;

  /// Looked through: what the other CELL sees in the patch's direction lies farther along the ray
  /// by at least this, plus this share of the range ...
  double margin_m = 0.5;
  double margin_share = 0.03;
  /// ... and the patch lies this far in front of its plane: a point just above ground that is seen
  /// at a grazing angle is not looked through.
  double clear_distance_m = 0.25;
  /// Of the patch's direction and the six around it, one patch apart, so many must be looked
  /// through, the middle one among them, and none may be hidden by something nearer.
  std::size_t clear_directions = 4;
  /// A patch that either CELL meets at a smaller angle is not called changed.
  double min_angle_deg = 12.0;
  /// Nor one with fewer than this many of the six patches around it on a surface with it: leaves,
  /// edges and patches that hang between two surfaces.
  std::size_t least_surface = 1;
  /// CELLs that must have looked through it, where no CELL confirms it.
  std::size_t least_views = 1;
  /// Changed patches stand together: so many of the six around it must be changed too.
  std::size_t least_changed = 1;

  /// Whether pairs of CELLs are registered before they are compared, and the largest correction
  /// that is believed; beyond it the poses of the map stand.
  bool registers = true;
  double max_correction_m = 0.5;
  double max_correction_deg = 1.5;

  /// Changed patches within this of one another are one region ...
  double region_gap_m = 0.7;
  /// ... which counts from this many patches on, all CELLs of its session together.
  std::size_t least_region_patches = 12;

  int threads = 1;   ///< 0: all. The result does not depend on it.
  GiveWay give_way;  ///< as in RegistrationOptions; and after every comparison of two CELLs

  /// Throws Error{kInvalidArgument} naming the option and its range.
  void validate() const;
};

}  // namespace cellmap
