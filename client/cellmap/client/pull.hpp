#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>

#include "cellmap/client/client.hpp"
#include "cellmap/client/mirror.hpp"

namespace cellmap {

/// Which CELLs a mirror is to hold. Poses, constraints and the list of CELLs are always those of
/// the whole map: they are small.
struct PullOptions {
  /// Fetch only CELLs whose present position is within `radius_m` of this place (map frame). CELLs
  /// that are further away but here already stay while the budget allows.
  std::optional<Eigen::Vector3d> near;
  double radius_m = 0;  ///< above 0 with `near`
  /// Bytes of CELL files; 0: no limit. Needs `near`: the nearest are kept, the furthest go first.
  std::uint64_t budget_bytes = 0;
  /// In which form CELLs travel and are kept; for less exact ones the server codes them. Unset: as
  /// the map keeps them where that is compact, else as last time, at first raw. What the folder has
  /// in a form at least as exact stays. A map that is kept compact is no more exact than that: see
  /// `CodedCellReader`.
  std::optional<CellForm> form = {};
  /// Called after each CELL that was fetched.
  std::function<void(std::size_t done, std::size_t total)> on_cell;

  /// Throws Error{kInvalidArgument} naming the option and its range.
  void validate() const;
};

/// What a pull did.
struct PullReport {
  Revision from = 0, to = 0;
  std::uint64_t cells = 0;    ///< of the map now
  std::uint64_t held = 0;     ///< of these, in the folder
  std::uint64_t fetched = 0;  ///< of these, sent by the server (or taken from the cache) this time
  std::uint64_t fetched_bytes = 0;  ///< as they are kept in the folder
  std::uint64_t moved = 0;
  std::uint64_t removed = 0;         ///< from the map
  std::uint64_t evicted = 0;         ///< from the folder, for the budget
  std::uint64_t received_bytes = 0;  ///< of bodies, as on the wire
  bool started_over = false;         ///< the folder's state did not fit the server's map
};

/// Brings `folder` up to date with a map; fetches only what changed since the last pull. Starts
/// over where the map was deleted and made again. Files of CELLs that are there with the right
/// content are not fetched again. Throws Error{kConflict} where the folder mirrors another map or
/// server, Error{kIo} where it cannot be written, and what `Client` throws; the mirror then is what
/// it was before.
PullReport pull_map(Client& client, const std::string& map, const std::filesystem::path& folder,
                    const PullOptions& options);
PullReport pull_map(Client& client, const std::string& map, const std::filesystem::path& folder,
                    const std::function<void(std::size_t done, std::size_t total)>& on_cell = {});

/// How a map is followed.
struct FollowOptions {
  PullOptions pull;
  /// Where the robot is now; replaces `pull.near` before every pull. Empty: it stays as it is.
  std::function<std::optional<Eigen::Vector3d>()> where;
  /// A robot that has moved this far since the last pull is given its surroundings, even where the
  /// map has not changed. `where` is asked every few seconds.
  double moved_m = 10;
  /// While the server is away: waits that double from the first to the longest, with jitter.
  std::chrono::milliseconds first_delay{500}, max_delay{30'000};
  /// After every pull that changed something, and after the first one.
  std::function<void(const PullReport&)> on_pull;
  /// The server cannot be reached, and how long until the next try.
  std::function<void(const Error&, std::chrono::milliseconds)> on_away;

  void validate() const;
};

/// Keeps a folder up to date until a stop is requested: over server-sent events, by long polls
/// where there are none, and by asking every five seconds where a server knows neither. Never gives
/// up while the server is away: the mirror stays as it was and is good to work with.
/// Error{kNotFound} where the map was deleted, and what else `pull_map` throws that waiting does
/// not cure.
void follow_map(Client& client, const std::string& map, const std::filesystem::path& folder,
                const FollowOptions& options, std::stop_token stop);

}  // namespace cellmap
