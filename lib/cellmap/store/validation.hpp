#pragma once

#include "cellmap/store/claims.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

/// Limits that every engine shares. They bound what one call can cost; real use stays far below.
struct StoreLimits {
  static constexpr double kMaxCoordinateM = 1e7;  ///< of a position in the map frame
  static constexpr std::size_t kMaxCellsPerUpdate = 10'000;
  static constexpr std::size_t kMaxScansPerCell = 100'000;
  static constexpr std::size_t kMaxPosesPerUpdate = 4'000'000;
  static constexpr std::size_t kMaxConstraintsPerUpdate = 1'000'000;
  static constexpr std::size_t kMaxPageSize = 10'000;
  static constexpr std::uint64_t kMaxCount = 1'000'000'000'000'000;  ///< of points
  static constexpr std::size_t kMaxRequestBytes = 1u << 20;          ///< of a job's request
  static constexpr std::size_t kMaxJobTextBytes = 1u << 14;          ///< of a job's other texts
  static constexpr std::size_t kMaxWorkerBytes = 200;                ///< of a worker's name
};

/// What can be checked of an argument without looking into the store. Throws
/// Error{kInvalidArgument}, {kTooLarge} over a limit, naming the field and the value.
void validate(const MapUpdate& update);
void validate(const CellQuery& query);
void validate(const JobRecord& job);
void validate(const SessionInfo& session);
void validate(const ClaimWish& wish);
void validate_position(const Eigen::Vector3d& position);

/// True for a rigid pose with a position inside StoreLimits::kMaxCoordinateM.
bool is_storable(const Pose& pose);

}  // namespace cellmap
