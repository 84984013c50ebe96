#pragma once

#include "cellmap/geometry/pose.hpp"

namespace cellmap {

/// How certain relative poses are, as information matrices for the left perturbation
/// exp(xi) * T_from_to. A residual of registration knows only noise; what it does not know of
/// (occlusion edges, moving things, a sensor's calibration: 8 cm and 0.13 deg on real pairs
/// of KITTI 00) must hold it down, or the graph trusts a loop of 300 such steps to a few
/// millimetres.

/// Standard deviations of a relative pose, the same along all axes, at the origin of its source.
struct PoseSigma {
  double translation_m = 0.05;
  double rotation_rad = 0.002;
};

/// Diagonal information at the source's origin, carried to the left perturbation.
Matrix6d information_of(const PoseSigma& sigma, const Pose& T_from_to);

/// (information^-1 + floor)^-1, with directions that were not measured left without weight.
Matrix6d realistic_information(const Matrix6d& information, const Pose& T_from_to,
                               const PoseSigma& floor = {});

}  // namespace cellmap
