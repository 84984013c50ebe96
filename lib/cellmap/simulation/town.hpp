#pragma once

#include <cstdint>
#include <vector>

#include "cellmap/simulation/ground.hpp"
#include "cellmap/simulation/route.hpp"
#include "cellmap/simulation/town_object.hpp"

namespace cellmap::simulation {

/// The strip beside the route that nothing may stand in, to the right and to the left of every
/// pass: the driven lane, the oncoming lane and room for the lateral offsets that options allow.
constexpr double kClearRight_m = 4.2, kClearLeft_m = 6.0;

/// What stands along a route. Plans the streets' two sides lot by lot: houses close to the street
/// with trees, poles, walls, hedges and parked cars before them, larger blocks behind. Nothing
/// overlaps anything else or the strip that is kept clear. Parked cars follow `traffic_seed`, all
/// else `seed`. Linear in the length of the route.
std::vector<TownObject> plan_town(const Centreline& line, const Ground& ground, std::uint64_t seed,
                                  std::uint64_t traffic_seed);

}  // namespace cellmap::simulation
