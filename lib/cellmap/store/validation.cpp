#include "cellmap/store/validation.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

using Limits = StoreLimits;

[[noreturn]] void invalid(const std::string& message) {
  throw Error(ErrorCode::kInvalidArgument, message);
}

void check_size(const char* what, std::size_t size, std::size_t limit) {
  if (size > limit) {
    throw Error(ErrorCode::kTooLarge, std::string(what) + ": at most " + std::to_string(limit) +
                                          " are taken at once, got " + std::to_string(size));
  }
}

void check_text(const char* what, const std::string& text, std::size_t limit) {
  check_size((std::string("bytes of a job's ") + what).c_str(), text.size(), limit);
  // SQLite's text functions end at a NUL and PostgreSQL refuses it.
  if (text.find('\0') != std::string::npos) invalid(std::string(what) + ": contains a NUL byte");
}

void check_count(const char* what, std::uint64_t count) {
  if (count > Limits::kMaxCount) invalid(std::string(what) + ": more than 1e15");
}

bool is_bounded(const Eigen::Vector3d& position) {
  return position.allFinite() && position.cwiseAbs().maxCoeff() <= Limits::kMaxCoordinateM;
}

void check_pose(const std::string& what, const Pose& pose) {
  if (!is_storable(pose)) {
    invalid(what + ": expected a finite rigid pose with coordinates of at most 1e7 m");
  }
}

bool is_session_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
         c == '_' || c == '-';
}

void check_session(const std::string& session) {
  // "." and ".." would be parts of addresses that proxies and browsers resolve.
  if (session.empty() || session.size() > 64 || session == "." || session == ".." ||
      !std::all_of(session.begin(), session.end(), is_session_character)) {
    invalid(
        "session: expected 1 to 64 characters of A-Z, a-z, 0-9, '.', '_' and '-', and not . "
        "or .. alone");
  }
}

void check_bytes(const std::string& name, const EncodedCell& encoded,
                 const std::optional<CodedCopy>& coded) {
  if (encoded.bytes.empty()) invalid(name + ": its encoded bytes are missing");
  check_size("bytes of an encoded CELL", encoded.bytes.size(), kMaxCellBytes);
  if (!coded) return;
  coded->form.validate();
  if (coded->form.encoding == KeptEncoding::kRaw) invalid(name + ": a coded CELL is not raw");
  if (coded->content.bytes.empty()) invalid(name + ": its coded bytes are missing");
  check_size("bytes of a coded CELL", coded->content.bytes.size(), kMaxCellBytes);
}

void check_new_cell(const NewCell& cell) {
  const std::string name = "CELL " + std::to_string(cell.id.value);
  if (!cell.cell) invalid(name + ": has no content");
  check_session(cell.cell->session);
  check_pose(name + ": T_map_cell", cell.T_map_cell);
  check_pose(name + ": T_odom_cell", cell.cell->T_odom_cell);
  check_bytes(name, cell.encoded, cell.coded);
  check_count("raw_points", cell.raw_points);
  check_count("voxel_points", cell.voxel_points);
  check_size("scans of a CELL", cell.scans.size(), Limits::kMaxScansPerCell);
  for (const ScanInCell& scan : cell.scans) check_pose(name + ": T_cell_scan", scan.T_cell_scan);
}

void check_new_cells(const std::vector<NewCell>& cells) {
  std::set<CellId> ids;
  std::set<std::pair<std::string, std::uint32_t>> places;
  for (const NewCell& cell : cells) {
    check_new_cell(cell);
    if (!ids.insert(cell.id).second) {
      invalid("CELL " + std::to_string(cell.id.value) + " occurs twice in one update");
    }
    if (!places.emplace(cell.cell->session, cell.cell->sequence).second) {
      invalid("session " + cell.cell->session + ", sequence " +
              std::to_string(cell.cell->sequence) + " occurs twice in one update");
    }
  }
}

void check_scores(const RegistrationScores& scores) {
  for (const double value :
       {scores.inlier_ratio_all, scores.inlier_ratio_hit, scores.share_in_front,
        scores.share_beyond, scores.median_residual_m}) {
    if (!std::isfinite(value)) invalid("constraint: a registration score is not finite");
  }
}

void check_judgement(ConstraintId id, const Judgement& judgement) {
  if (judgement.weight >= 0 && judgement.weight <= 1) return;
  invalid("constraint " + std::to_string(id.value) + ": expected a weight from 0 to 1");
}

void check_constraint(const Constraint& constraint) {
  if (constraint.from == constraint.to) {
    invalid("constraint: joins CELL " + std::to_string(constraint.from.value) + " to itself");
  }
  check_pose("constraint: T_from_to", constraint.T_from_to);
  const Matrix6d& information = constraint.information;
  if (!information.allFinite() || !information.isApprox(information.transpose(), 1e-9) ||
      !(information.trace() > 0)) {
    invalid("constraint: expected a finite symmetric information matrix of positive trace");
  }
  if (constraint.kind < ConstraintKind::kOdometry || constraint.kind > ConstraintKind::kLoop ||
      constraint.origin < ConstraintOrigin::kMapper ||
      constraint.origin > ConstraintOrigin::kUser) {
    invalid("constraint: unknown kind or origin");
  }
  check_scores(constraint.scores);
  check_judgement(constraint.id, judgement(constraint));
}

}  // namespace

bool is_storable(const Pose& pose) { return is_rigid(pose) && is_bounded(pose.translation()); }

void validate_position(const Eigen::Vector3d& position) {
  if (!is_bounded(position)) invalid("position: expected finite coordinates of at most 1e7 m");
}

void validate(const MapUpdate& update) {
  check_size("new CELLs", update.cells.size(), Limits::kMaxCellsPerUpdate);
  check_size("moved poses", update.poses.size(), Limits::kMaxPosesPerUpdate);
  check_size("new constraints", update.add_constraints.size(), Limits::kMaxConstraintsPerUpdate);
  check_size("removed constraints", update.remove_constraints.size(),
             Limits::kMaxConstraintsPerUpdate);
  check_size("recoded CELLs", update.recoded.size(), Limits::kMaxCellsPerUpdate);
  check_new_cells(update.cells);
  for (const auto& [id, recoded] : update.recoded) {
    check_bytes("CELL " + std::to_string(id.value), recoded.encoded, recoded.coded);
  }
  for (const auto& [id, pose] : update.poses) {
    check_pose("CELL " + std::to_string(id.value) + ": T_map_cell", pose);
  }
  for (const Constraint& constraint : update.add_constraints) check_constraint(constraint);
  for (const auto& [id, judgement] : update.judged) check_judgement(id, judgement);
  for (const std::string& session : update.remove_sessions) check_session(session);
  std::set<ConstraintId> removed;
  for (const ConstraintId id : update.remove_constraints) {
    if (!removed.insert(id).second) {
      invalid("constraint " + std::to_string(id.value) + " is removed twice in one update");
    }
  }
}

void validate(const CellQuery& query) {
  if (query.limit < 1 || query.limit > Limits::kMaxPageSize) {
    invalid("limit: expected 1 to " + std::to_string(Limits::kMaxPageSize) + ", got " +
            std::to_string(query.limit));
  }
  if (query.near) {
    validate_position(*query.near);
    if (!std::isfinite(query.radius_m) || query.radius_m <= 0) {
      invalid("radius: expected a finite value above 0 m beside a position");
    }
  } else if (query.radius_m != 0) {
    invalid("radius: given without a position to search from");
  }
  if (query.box) {
    const Eigen::AlignedBox3d& box = *query.box;
    if (!box.min().allFinite() || !box.max().allFinite() || box.isEmpty()) {
      invalid("box: expected finite corners, each minimum at most its maximum");
    }
  }
  if (query.session) check_session(*query.session);
}

void validate(const SessionInfo& session) {
  check_session(session.name);
  for (const auto& [what, text] :
       {std::pair("robot", &session.robot), std::pair("sensor", &session.sensor),
        std::pair("odometry_frame", &session.odometry_frame)}) {
    const bool valid = text->size() <= 64 &&
                       std::ranges::all_of(*text, [](char c) { return c >= ' ' && c <= '~'; });
    if (!valid) invalid(std::string(what) + ": expected up to 64 printable ASCII characters");
  }
  if (session.started < 0) invalid("started: expected nanoseconds since 1970, or 0");
}

void validate(const JobRecord& job) {
  validate_map_name(job.map);
  if (job.kind.empty()) invalid("job: its kind is empty");
  check_text("kind", job.kind, 64);
  check_text("request", job.request_json, Limits::kMaxRequestBytes);
  check_text("error code", job.error_code, 64);
  check_text("error message", job.error_message, Limits::kMaxJobTextBytes);
  if (job.state < JobState::kQueued || job.state > JobState::kCancelled) {
    invalid("job: unknown state");
  }
  for (const std::uint64_t count : {job.scans_done, job.scans_total, job.cells_done}) {
    check_count("job progress", count);
  }
}

void validate(const ClaimWish& wish) {
  if (wish.worker.empty()) invalid("worker: its name is empty");
  check_text("worker", wish.worker, Limits::kMaxWorkerBytes);
  if (wish.lease.count() <= 0 || wish.lease > std::chrono::hours(24)) {
    invalid("lease: expected more than nothing and at most a day");
  }
}

}  // namespace cellmap
