#pragma once

#include <span>
#include <vector>

#include "cellmap/place/surroundings.hpp"

namespace cellmap {

/// Where else along the street a scan might be: up to four starts for registration, T_cell_scan of
/// the first CELL, up to 4 m from where it is thought to be and 0.75 m and more apart from it.
///
/// Where house fronts repeat, a scan can settle metres from where it is, with its own CELL
/// preferring that. The motion that `information` (of exp(xi) * T_cell_scan) holds least in the
/// plane is followed in steps of 0.25 m; how well `few` points agree is summed up for the first of
/// `cells` and for those around it, and the two highest peaks of either are returned, the highest
/// first. Serial; about 0.02 ms a CELL and step for 600 points.
std::vector<Pose> starts_along_street(std::span<const CellAround> cells, const PointCloud& few,
                                      const Pose& T_cell_scan, const Matrix6d& information);

}  // namespace cellmap
