#pragma once

#include <span>

#include "cellmap/registration/residuals.hpp"

namespace cellmap {

/// The information that the inliers of all terms hold about the pose `T`, for the left
/// perturbation.
///
/// Points are not independent witnesses: all points that hit one plane share the error of that
/// plane (its fit, the curvature of the surface, the pose of the stacked scans). The distances are
/// therefore taken as the sum of an error of the plane, variance b, and an error of the point,
/// variance w, both estimated from the distances themselves by a one-way analysis of variance. The
/// mean of m points on one plane then has the variance b + w / m, so each of them counts with the
/// weight 1 / (m b + w): a plane hit by a thousand points says little more than one hit by ten.
Matrix6d information_of(std::span<const RegistrationTerm> terms, std::span<const HitDistances> hits,
                        const Pose& T, const PointSelection& selection);

/// What the information says about the weakest motion about the scan's origin.
/// `median_range_m` turns rotations into the displacements they cause.
Degeneracy degeneracy_of(const Matrix6d& information, const Pose& T, double median_range_m,
                         double degeneracy_share);

/// Median range of every selected point of all scans; 0 where there are none.
double median_range_m(std::span<const RegistrationTerm> terms, const PointSelection& selection);

}  // namespace cellmap
