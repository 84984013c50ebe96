#include "cellmap/store/store.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/store/read_cell.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kMaxMapNameLength = 64;

constexpr std::array<std::pair<JobState, std::string_view>, 5> kJobStates = {{
    {JobState::kQueued, "queued"},
    {JobState::kRunning, "running"},
    {JobState::kSucceeded, "succeeded"},
    {JobState::kFailed, "failed"},
    {JobState::kCancelled, "cancelled"},
}};

bool is_lower_or_digit(char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); }

/// The beginning of a name that may be anything, fit for a message.
std::string printable_head(const std::string& name) {
  std::string head = name.substr(0, kMaxMapNameLength);
  std::replace_if(
      head.begin(), head.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return head + (name.size() > kMaxMapNameLength ? "..." : "");
}

}  // namespace

std::string_view to_string(JobState state) {
  for (const auto& [known, name] : kJobStates) {
    if (known == state) return name;
  }
  return "unknown";
}

JobState job_state_from_string(std::string_view name) {
  for (const auto& [state, known] : kJobStates) {
    if (known == name) return state;
  }
  throw Error(ErrorCode::kCorruptData,
              "job state: expected queued, running, succeeded, failed or cancelled");
}

MapUpdate to_map_update(CellUpdate update, std::optional<KeptCell> kept) {
  MapUpdate result;
  if (update.cell) {
    if (!kept) kept = keep_cell(update.cell, {});
    result.cells.push_back({.id = update.id,
                            .cell = update.cell,
                            .encoded = std::move(kept->encoded),
                            .coded = std::move(kept->coded),
                            .T_map_cell = update.poses.at(update.id),
                            .unaligned = update.unaligned,
                            .scans = std::move(update.scans),
                            .raw_points = update.raw_points,
                            .voxel_points = update.voxel_points});
    update.poses.erase(update.id);
  }
  result.poses = std::move(update.poses);
  result.judged = std::move(update.judged);
  result.aligned = std::move(update.aligned);
  result.add_constraints = std::move(update.constraints);
  return result;
}

std::shared_ptr<const Bytes> Store::compressed_cell(const std::string& map, CellId id) const {
  const StoredCell stored = stored_cell(map, id);
  if (stored.form.encoding == KeptEncoding::kRaw) return stored.frame;
  return std::make_shared<const Bytes>(zstd_compress(open_stored_cell(stored).encoded.bytes));
}

void validate_map_name(const std::string& name) {
  const bool valid =
      !name.empty() && name.size() <= kMaxMapNameLength && is_lower_or_digit(name.front()) &&
      std::all_of(name.begin(), name.end(),
                  [](char c) { return is_lower_or_digit(c) || c == '_' || c == '-'; });
  if (!valid) {
    throw Error(ErrorCode::kInvalidArgument,
                "map name: expected 1 to 64 characters of a-z, 0-9, '_' and '-', beginning with a "
                "letter or digit, found '" +
                    printable_head(name) + "'");
  }
}

}  // namespace cellmap
