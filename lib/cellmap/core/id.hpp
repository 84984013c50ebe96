#pragma once

#include <compare>
#include <cstdint>
#include <functional>

namespace cellmap {

/// An integer that cannot be mistaken for another kind of integer.
template <typename Tag>
struct Id {
  std::uint32_t value = 0;
  auto operator<=>(const Id&) const = default;
};

/// Names a CELL within one map; unique in the map and never reused.
using CellId = Id<struct CellIdTag>;
/// Names a constraint within one map; unique in the map and never reused.
using ConstraintId = Id<struct ConstraintIdTag>;
/// Names a job within one store.
using JobId = Id<struct JobIdTag>;

/// Revision of a map's pose graph and CELL set: 0 for an empty map, one more for every change.
using Revision = std::uint64_t;

}  // namespace cellmap

template <typename Tag>
struct std::hash<cellmap::Id<Tag>> {
  std::size_t operator()(const cellmap::Id<Tag>& id) const noexcept {
    return std::hash<std::uint32_t>()(id.value);
  }
};
