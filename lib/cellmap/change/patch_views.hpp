#pragma once

#include <cstdint>
#include <vector>

#include "cellmap/change/diff_options.hpp"
#include "cellmap/registration/registration.hpp"

namespace cellmap {

/// What one CELL says of a patch of another.
enum class PatchView : std::uint8_t {
  kNothing,      ///< hidden, out of range, not looked at, or not clear
  kConfirmed,    ///< it has the surface too
  kSeenThrough,  ///< it sees something behind, all around
};

/// The patches of `cell` as another CELL saw their places: one a plane, in the order of the planes.
/// The sight line is the other CELL's: its lattice patch in the direction of the patch, and the six
/// around it. Serial; about 0.1 us a patch.
std::vector<PatchView> views_of(const RegistrationTarget& cell, const RegistrationTarget& other,
                                const Pose& T_other_cell, const DiffOptions& options);

/// Which patches of a CELL lie on a surface that their neighbours go on with and that the CELL
/// meets at an angle: those that may be called changed.
std::vector<bool> surface_patches(const RegistrationTarget& cell, const DiffOptions& options);

/// `marked` without those that have fewer than `least` marked patches among the six around them.
std::vector<bool> standing_together(const RegistrationTarget& cell, const std::vector<bool>& marked,
                                    std::size_t least);

}  // namespace cellmap
