#pragma once

#include <span>

#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// Sessions in one map. A chain is what trusted constraints hold together (`is_trusted`): a
/// session, or several that a pinned loop joins. Where two chains lie to one another says only
/// what loops between them say, some of which may be false, so that no optimisation that starts
/// from their poses can tell. What tells is which of those loops agree with one another: whether
/// the cycle a -> b -> ... through both and the two chains closes within what the constraints on
/// the way may be off (pairwise consistency; Mangelson et al., ICRA 2018).
///
/// Within one chain the same test is not used to reject loops: real odometry drifts more than its
/// sigmas say (with NDT odometry on KITTI 00, 46 % of the pairs of true loops fail it), while the
/// loss of `optimize` needs no model of drift.

/// Whether any loop ties two chains. Linear.
bool has_chains(const PoseGraph& graph);

/// The largest set found of loops that agree in pairs, as positions in `loops`, ascending. `loops`
/// are positions of constraints between the same two chains. Greedy from the loops with most
/// partners; quadratic in the loops, of which at most 300 (evenly taken) are looked at. Empty where
/// `loops` is. Deterministic. `scale`: sigmas (of six degrees of freedom together) that a cycle may
/// be off.
std::vector<std::size_t> consistent_loops(const PoseGraph& graph,
                                          std::span<const std::size_t> loops, double scale);

/// The poses with chains moved, each as a rigid body, to where the largest consistent set of
/// loops puts it beside the chain that has the most such loops to it; that of the lowest node
/// stays. Chains that fewer than `least_loops` consistent loops tie stay where they are.
std::map<CellId, Pose> chain_start(const PoseGraph& graph, std::size_t least_loops, double scale);

}  // namespace cellmap
