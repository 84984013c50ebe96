#include "cellmap/change/diff.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>
#include <set>
#include <string>
#include <tuple>

#include "cellmap/change/change_regions.hpp"
#include "cellmap/change/patch_views.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/core/parallel.hpp"
#include "cellmap/core/progress.hpp"

namespace cellmap {
namespace {

using Target = std::shared_ptr<const RegistrationTarget>;

void require(bool fulfilled, const char* rule) {
  if (!fulfilled) throw Error(ErrorCode::kInvalidArgument, std::string("diff: expected ") + rule);
}

/// What was said of the patches of one CELL so far.
struct Evidence {
  std::vector<std::uint8_t> confirmed, through;

  void add(const std::vector<PatchView>& views) {
    confirmed.resize(views.size());
    through.resize(views.size());
    for (std::size_t i = 0; i < views.size(); ++i) {
      confirmed[i] |= views[i] == PatchView::kConfirmed;
      through[i] = static_cast<std::uint8_t>(
          std::min(255, through[i] + (views[i] == PatchView::kSeenThrough)));
    }
  }
};

/// Two CELLs that look at each other.
struct Comparison {
  CellPair pair;
  Target earlier, later;
  Pose T_earlier_later;
  std::vector<PatchView> of_earlier, of_later;
};

/// The pose that the two CELLs' own planes ask for, where it is near the given one.
Pose registered(const Comparison& c, const DiffOptions& options) {
  RegistrationOptions registration = default_place_registration();
  registration.judge = false;
  registration.give_way = options.give_way;
  constexpr std::size_t kPoints = 4'000;
  const auto points = [](const Target& target) {
    const PointCloud all = reconstruct_points(target->cell(), target->lattice());
    return every_nth(all, all.size() / kPoints + 1);
  };
  const Pose& given = c.T_earlier_later;
  const RegistrationResult result =
      register_cells(*c.earlier, points(c.earlier), *c.later, points(c.later), given, registration);
  const bool believed = result.converged &&
                        (result.T_target_source.translation() - given.translation()).norm() <=
                            options.max_correction_m &&
                        angle_between_rad(result.T_target_source, given) * 180 / std::numbers::pi <=
                            options.max_correction_deg;
  return believed ? result.T_target_source : given;
}

void compare(Comparison& c, const DiffOptions& options) {
  if (options.registers) c.T_earlier_later = registered(c, options);
  c.of_earlier = views_of(*c.earlier, *c.later, c.T_earlier_later.inverse(), options);
  c.of_later = views_of(*c.later, *c.earlier, c.T_earlier_later, options);
}

/// Loads CELLs and keeps those that are asked for again soon.
class Shelf {
 public:
  explicit Shelf(const TargetProvider& targets) : targets_(targets) {}

  /// Loads `wanted` and forgets everything else.
  void hold(const std::set<CellId>& wanted) {
    std::erase_if(held_, [&](const auto& entry) { return !wanted.contains(entry.first); });
    for (const CellId id : wanted) {
      if (!held_.contains(id)) held_.emplace(id, targets_(id));
    }
  }
  const Target& operator[](CellId id) const { return held_.at(id); }

 private:
  const TargetProvider& targets_;
  std::map<CellId, Target> held_;
};

double area_m2(const RegistrationTarget& cell, std::size_t patch) {
  const Plane& plane = cell.cell().planes[patch];
  const std::uint32_t index = cell.cell().indices[patch];
  const double radius_m = cell.lattice().patch_radius_rad(index) * plane.distance_m;
  const double cosine =
      std::abs(cell.lattice().direction(index).dot(Eigen::Vector3d(plane.nx, plane.ny, plane.nz)));
  return std::numbers::pi * radius_m * radius_m / std::max(cosine, 0.2);
}

/// The verdict on the patches of one CELL; what changed is also put into `changes`.
CellDiff verdict(const PlacedCell& placed, const RegistrationTarget& target,
                 const Evidence& evidence, PatchChange gone, const DiffOptions& options,
                 std::vector<ChangedPatch>& changes) {
  const Cell& cell = target.cell();
  CellDiff diff{placed.id, std::vector(cell.planes.size(), PatchChange::kNeverSeen), {}};
  std::vector<bool> changed = surface_patches(target, options);
  for (std::size_t i = 0; i < changed.size(); ++i) {
    const bool looked_at = !evidence.confirmed.empty();
    if (looked_at && evidence.confirmed[i]) diff.patches[i] = PatchChange::kStayed;
    changed[i] = changed[i] && looked_at && !evidence.confirmed[i] &&
                 evidence.through[i] >= options.least_views;
  }
  changed = standing_together(target, changed, options.least_changed);
  for (std::size_t i = 0; i < changed.size(); ++i) {
    if (!changed[i]) continue;
    const std::uint32_t index = cell.indices[i];
    const Eigen::Vector3d middle = cell.planes[i].distance_m * target.lattice().direction(index);
    diff.patches[i] = gone;
    diff.changed.push_back(index);
    changes.push_back({placed.id, placed.T_map_cell * middle, area_m2(target, i)});
  }
  return diff;
}

/// The CELLs of one session: how their patches differ, and where those are that changed.
struct Side {
  std::span<const PlacedCell> cells;
  PatchChange gone;
  std::vector<Evidence> evidence{cells.size()};

  std::vector<CellDiff> verdicts(const TargetProvider& targets, const DiffOptions& options,
                                 std::vector<ChangeRegion>& regions) const {
    std::vector<CellDiff> diffs;
    std::vector<ChangedPatch> changes;
    for (std::size_t i = 0; i < cells.size(); ++i) {
      diffs.push_back(
          verdict(cells[i], *targets(cells[i].id), evidence[i], gone, options, changes));
    }
    const auto groups =
        group_changes(changes, gone, options.region_gap_m, options.least_region_patches);
    regions.insert(regions.end(), groups.begin(), groups.end());
    return diffs;
  }
};

/// The pairs of one earlier CELL.
std::vector<Comparison> comparisons_of(std::span<const CellPair> pairs, const Side& earlier,
                                       const Side& later, Shelf& shelf) {
  const PlacedCell& one = earlier.cells[pairs.front().earlier];
  std::set<CellId> wanted{one.id};
  for (const CellPair& pair : pairs) wanted.insert(later.cells[pair.later].id);
  shelf.hold(wanted);
  std::vector<Comparison> comparisons;
  for (const CellPair& pair : pairs) {
    const PlacedCell& other = later.cells[pair.later];
    comparisons.push_back({pair,
                           shelf[one.id],
                           shelf[other.id],
                           one.T_map_cell.inverse() * other.T_map_cell,
                           {},
                           {}});
  }
  return comparisons;
}

}  // namespace

std::string_view to_string(PatchChange change) {
  switch (change) {
    case PatchChange::kNeverSeen:
      return "never_seen";
    case PatchChange::kStayed:
      return "stayed";
    case PatchChange::kVanished:
      return "vanished";
    case PatchChange::kAppeared:
      return "appeared";
  }
  return "never_seen";
}

std::size_t CellDiff::count(PatchChange change) const {
  return static_cast<std::size_t>(std::ranges::count(patches, change));
}

void DiffOptions::validate() const {
  require(reach_m > 0 && reach_m <= 1000, "a reach of above 0 to 1000 m");
  require(views >= 1 && views <= 100, "1 to 100 views of a CELL");
  require(max_range_m > 0, "a largest range above 0 m");
  require(stayed_distance_m > 0 && margin_m > 0 && margin_share >= 0 && clear_distance_m >= 0,
          "distances and margins above 0");
  require(margin_m > stayed_distance_m, "a margin above the distance within which a patch stayed");
  require(same_facing_deg >= 0 && same_facing_deg <= 90 && min_angle_deg >= 0 && min_angle_deg < 90,
          "angles within 0 and 90 deg");
  require(clear_directions >= 1 && clear_directions <= 7, "1 to 7 clear directions");
  require(least_surface <= 6 && least_changed <= 6, "at most 6 neighbours of a patch");
  require(least_views >= 1, "at least one view");
  require(max_correction_m >= 0 && max_correction_deg >= 0, "corrections of 0 or more");
  require(region_gap_m > 0, "a gap between regions above 0 m");
  require(threads >= 0, "0 (all) or more threads");
}

std::vector<CellPair> pairs_to_compare(std::span<const PlacedCell> earlier,
                                       std::span<const PlacedCell> later,
                                       const DiffOptions& options) {
  std::set<std::pair<std::size_t, std::size_t>> pairs;
  const auto add_nearest = [&](std::span<const PlacedCell> of, std::span<const PlacedCell> among,
                               bool swapped) {
    for (std::size_t i = 0; i < of.size(); ++i) {
      std::vector<std::tuple<double, CellId, std::size_t>> near;
      for (std::size_t j = 0; j < among.size(); ++j) {
        const double apart_m =
            (of[i].T_map_cell.translation() - among[j].T_map_cell.translation()).norm();
        if (apart_m <= options.reach_m) near.emplace_back(apart_m, among[j].id, j);
      }
      std::ranges::sort(near);
      for (std::size_t k = 0; k < std::min(near.size(), options.views); ++k) {
        const std::size_t j = std::get<2>(near[k]);
        pairs.emplace(swapped ? j : i, swapped ? i : j);
      }
    }
  };
  add_nearest(earlier, later, false);
  add_nearest(later, earlier, true);
  std::vector<CellPair> list;
  for (const auto& [i, j] : pairs) list.push_back({i, j});
  return list;
}

SessionDiff diff_sessions(std::span<const PlacedCell> earlier, std::span<const PlacedCell> later,
                          const TargetProvider& targets, const DiffOptions& options,
                          const std::stop_token& stop) {
  options.validate();
  const std::vector<CellPair> pairs = pairs_to_compare(earlier, later, options);
  Side before{earlier, PatchChange::kVanished}, after{later, PatchChange::kAppeared};
  Shelf shelf(targets);
  for (std::size_t begin = 0; begin < pairs.size();) {
    throw_if_stopped(stop);
    std::size_t end = begin;
    while (end < pairs.size() && pairs[end].earlier == pairs[begin].earlier) ++end;
    auto comparisons =
        comparisons_of(std::span(pairs).subspan(begin, end - begin), before, after, shelf);
    parallel_for(comparisons.size(), 1, {options.threads, options.give_way},
                 [&](std::size_t from, std::size_t to) {
                   for (std::size_t i = from; i < to; ++i) compare(comparisons[i], options);
                 });
    for (const Comparison& c : comparisons) {
      before.evidence[c.pair.earlier].add(c.of_earlier);
      after.evidence[c.pair.later].add(c.of_later);
    }
    begin = end;
  }
  SessionDiff diff;
  diff.pairs = pairs.size();
  diff.earlier = before.verdicts(targets, options, diff.regions);
  diff.later = after.verdicts(targets, options, diff.regions);
  return diff;
}

}  // namespace cellmap
