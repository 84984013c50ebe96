#include "cellmap/archive/update_archive.hpp"

#include <algorithm>
#include <iterator>

#include "cellmap/archive/archive_precision.hpp"
#include "cellmap/archive/archive_writer.hpp"
#include "cellmap/codec/changes_codec.hpp"
#include "cellmap/codec/pose_graph_codec.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/checksum.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

/// What updates left behind is one section up to here, so that the footer does not grow.
constexpr std::uint64_t kMaxSupersededBytes = 16u << 20;

Error conflict(const std::string& what) {
  return Error(ErrorCode::kConflict,
               "the archive cannot be brought up to date: " + what + "; archive the map anew");
}

bool is_same_measurement(const Constraint& a, const Constraint& b) {
  return a.from == b.from && a.to == b.to && a.kind == b.kind &&
         a.T_from_to.matrix() == b.T_from_to.matrix();
}

/// What leads from `before` to `after`.
MapChanges changes_between(const PoseGraph& before, const PoseGraph& after) {
  if (after.revision < before.revision) {
    throw conflict("it holds revision " + std::to_string(before.revision) +
                   " of its map, which is later than " + std::to_string(after.revision));
  }
  MapChanges changes;
  changes.since = before.revision;
  changes.revision = after.revision;
  if (!std::ranges::equal(before.nodes, after.nodes, {}, &std::pair<const CellId, Pose>::first,
                          &std::pair<const CellId, Pose>::first)) {
    throw conflict("the map has other CELLs by now");
  }
  for (const auto& [id, pose] : after.nodes) {
    if (before.nodes.at(id).matrix() != pose.matrix()) changes.moved.emplace(id, pose);
  }
  auto old = before.constraints.begin();
  for (const Constraint& constraint : after.constraints) {
    for (; old != before.constraints.end() && old->id < constraint.id; ++old) {
      changes.removed_constraints.push_back(old->id);
    }
    if (old == before.constraints.end() || old->id != constraint.id) {
      changes.added_constraints.push_back(constraint);
      continue;
    }
    if (!is_same_measurement(*old, constraint)) throw conflict("it is of another map");
    ++old;
  }
  for (; old != before.constraints.end(); ++old) changes.removed_constraints.push_back(old->id);
  changes.unaligned = after.unaligned;
  changes.judged = judged_anew(before.constraints, after.constraints);
  return changes;
}

/// Takes the old changes off the list, and puts what lies there up to the old end on it as
/// superseded.
void supersede(ByteFile& file, ArchiveFooter& footer, const ArchiveState& state) {
  std::uint64_t begin = state.footer_offset;
  auto& sections = footer.sections;
  while (!sections.empty()) {
    const ArchiveSection& last = sections.back();
    const bool goes = last.kind == ArchiveSectionKind::kChanges ||
                      (last.kind == ArchiveSectionKind::kSuperseded &&
                       state.end - last.offset <= kMaxSupersededBytes);
    if (!goes) break;
    begin = last.offset;
    sections.pop_back();
  }
  const Bytes left = file.read(begin, state.end - begin);
  sections.push_back({ArchiveSectionKind::kSuperseded, begin, left.size(), checksum(left)});
}

PoseGraph first_graph(ByteFile& file, const ArchiveFooter& footer) {
  const auto found =
      std::ranges::find(footer.sections, ArchiveSectionKind::kPoseGraph, &ArchiveSection::kind);
  return decode_pose_graph(
      zstd_decompress(file.read(found->offset, found->bytes), kMaxArchiveSectionBytes));
}

}  // namespace

std::uint64_t update_archive(ByteFile& file, const PoseGraph& newest) {
  ArchiveReader reader(borrowed(file));
  reader.pose_graph();  // verified, as everything that is kept
  ArchiveFooter footer = reader.footer();
  PoseGraph first = first_graph(file, footer), graph = newest;
  if (footer.encoding == ArchiveEncoding::kCompact) {
    first = to_archive_precision(std::move(first));  // which it may not be from the beginning
    graph = to_archive_precision(std::move(graph));
  }
  const MapChanges changes = changes_between(first, graph);
  supersede(file, footer, reader.state());
  footer.revision = graph.revision;
  const ArchiveState state =
      append_archive_state(file, reader.state().end, reader.state().serial + 1, footer,
                           {{ArchiveSectionKind::kChanges, encode_changes(changes)}});
  return state.end - state.block_offset + kArchiveStateBytes;
}

}  // namespace cellmap
