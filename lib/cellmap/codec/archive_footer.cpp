#include "cellmap/codec/archive_footer.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "cellmap/codec/cell_wire.hpp"
#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/codec/verified_buffer.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/schema/archive_generated.h"

namespace cellmap {
namespace {

constexpr char kFooterIdentifier[] = "CAFT";
constexpr BufferKind kFooterKind = {
    "archive footer", kFooterIdentifier, kMaxArchiveFooterBytes,
    [](flatbuffers::Verifier& v) { return schema::VerifyArchiveFooterBuffer(v); }};
/// A session or section with storage of its own takes more bytes than this.
constexpr std::size_t kMinTableBytes = 16;
constexpr std::size_t kMaxTextBytes = 64;

Error corrupt_footer(const std::string& what) {
  return Error(ErrorCode::kCorruptData, "the archive's footer is not valid: " + what);
}

void check_encoding(const ArchiveFooter& footer) {
  const int encoding = static_cast<int>(footer.encoding);
  if (encoding < 1 || encoding > 3) {
    throw Error(ErrorCode::kUnsupported,
                "the archive's encoding " + std::to_string(encoding) + " is unknown to this build");
  }
  const bool compact = footer.encoding == ArchiveEncoding::kCompact;
  const bool bounded = footer.bound_m >= kMinCompactBoundM && footer.bound_m <= kMaxCompactBoundM;
  if (compact ? !bounded : footer.bound_m != 0) throw corrupt_footer("its bound is out of range");
}

void check_sessions(const ArchiveFooter& footer) {
  std::set<std::string> names;
  for (const ArchiveSession& session : footer.sessions) {
    if (!is_session_name(session.name) || !names.insert(session.name).second) {
      throw corrupt_footer(
          "a session has no name of its own of 1 to 64 characters of A-Z a-z 0-9 . _ -");
    }
    for (const std::string* text : {&session.robot, &session.sensor, &session.odometry_frame}) {
      if (text->size() > kMaxTextBytes) throw corrupt_footer("a session's description is too long");
    }
  }
}

void check_sections(const ArchiveFooter& footer) {
  if (footer.sections.size() > kMaxArchiveSections) {
    throw Error(ErrorCode::kTooLarge, "an archive has at most " +
                                          std::to_string(kMaxArchiveSections) +
                                          " sections; 'cellmap repair' writes it anew without "
                                          "what updates left behind");
  }
  std::set<ArchiveSectionKind> kinds;
  std::uint64_t end = footer.sections.empty() ? 0 : footer.sections.front().offset;
  for (const ArchiveSection& section : footer.sections) {
    const int kind = static_cast<int>(section.kind);
    if (kind < 1 || kind > 5) {
      throw Error(ErrorCode::kUnsupported, "the archive has a section of a kind (" +
                                               std::to_string(kind) + ") unknown to this build");
    }
    if (section.kind != ArchiveSectionKind::kSuperseded && !kinds.insert(section.kind).second) {
      throw corrupt_footer("it names a section twice");
    }
    if (section.offset != end || section.offset % kArchiveAlignment != 0 ||
        section.bytes > kMaxArchiveBytes || section.end() > kMaxArchiveBytes) {
      throw corrupt_footer("its sections do not lie one behind the other");
    }
    end = section.end();
  }
  if (!kinds.contains(ArchiveSectionKind::kPoseGraph) ||
      !kinds.contains(ArchiveSectionKind::kCells) || !kinds.contains(ArchiveSectionKind::kScans)) {
    throw corrupt_footer("it lacks the section of poses, of CELLs or of scans");
  }
}

void check_footer(const ArchiveFooter& footer) {
  check_encoding(footer);
  check_sessions(footer);
  check_sections(footer);
  if (footer.georeference) {
    try {
      footer.georeference->validate();
    } catch (const Error& error) {
      throw corrupt_footer(error.what());
    }
  }
}

flatbuffers::Offset<schema::ArchiveGeoreference> georeference_to_wire(
    flatbuffers::FlatBufferBuilder& builder, const std::optional<Georeference>& georeference) {
  if (!georeference) return 0;
  Pose T_enu_map = Pose::Identity();
  T_enu_map.linear() = georeference->R_enu_map;
  const schema::Pose wire = pose_to_wire(T_enu_map);
  return schema::CreateArchiveGeoreference(builder, georeference->latitude_deg,
                                           georeference->longitude_deg, georeference->height_m,
                                           &wire);
}

std::string text_of(const flatbuffers::String* wire) {
  return wire && wire->size() <= kMaxArchiveFooterBytes ? wire->str() : std::string();
}

std::uint32_t micrometres(double bound_m) {
  return static_cast<std::uint32_t>(std::lround(bound_m * 1e6));
}

}  // namespace

std::string_view to_string(ArchiveSectionKind kind) {
  switch (kind) {
    case ArchiveSectionKind::kPoseGraph:
      return "pose graph";
    case ArchiveSectionKind::kChanges:
      return "changes";
    case ArchiveSectionKind::kCells:
      return "list of CELLs";
    case ArchiveSectionKind::kScans:
      return "scans";
    case ArchiveSectionKind::kSuperseded:
      return "superseded";
  }
  return "unknown";
}

Bytes encode_archive_footer(const ArchiveFooter& footer) {
  check_footer(footer);
  flatbuffers::FlatBufferBuilder builder(1024);
  const auto map = builder.CreateString(footer.map);
  const auto lattice = lattice_to_wire(builder, footer.lattice);
  std::vector<flatbuffers::Offset<schema::ArchiveSession>> sessions;
  for (const ArchiveSession& session : footer.sessions) {
    const auto name = builder.CreateString(session.name);
    const auto robot = builder.CreateSharedString(session.robot);
    const auto sensor = builder.CreateSharedString(session.sensor);
    const auto frame = builder.CreateSharedString(session.odometry_frame);
    sessions.push_back(
        schema::CreateArchiveSession(builder, name, robot, sensor, frame, session.started));
  }
  const auto wire_sessions = builder.CreateVector(sessions);
  const auto georeference = georeference_to_wire(builder, footer.georeference);
  std::vector<flatbuffers::Offset<schema::ArchiveSection>> sections;
  for (const ArchiveSection& section : footer.sections) {
    sections.push_back(
        schema::CreateArchiveSection(builder, static_cast<schema::SectionKind>(section.kind),
                                     section.offset, section.bytes, section.checksum));
  }
  const auto wire_sections = builder.CreateVector(sections);
  schema::FinishArchiveFooterBuffer(
      builder, schema::CreateArchiveFooter(
                   builder, kFormatVersion, map, footer.created, lattice,
                   static_cast<schema::ArchiveEncoding>(footer.encoding),
                   micrometres(footer.bound_m), footer.revision, footer.cells, footer.planes,
                   footer.cell_bytes, footer.scans, wire_sessions, georeference, wire_sections));
  const auto* begin = reinterpret_cast<const std::byte*>(builder.GetBufferPointer());
  return Bytes(begin, begin + builder.GetSize());
}

ArchiveFooter decode_archive_footer(std::span<const std::byte> bytes) {
  const Bytes copy = verified_copy(bytes, kFooterKind, 64 + bytes.size() / kMinTableBytes);
  const auto& wire = *schema::GetArchiveFooter(copy.data());
  ArchiveFooter footer;
  footer.map = text_of(wire.map());
  footer.created = wire.created_ns();
  footer.lattice = lattice_from_wire(*wire.lattice());
  footer.encoding = static_cast<ArchiveEncoding>(wire.encoding());
  footer.bound_m = wire.bound_um() * 1e-6;
  footer.revision = wire.revision();
  footer.cells = wire.cells();
  footer.planes = wire.planes();
  footer.cell_bytes = wire.cell_bytes();
  footer.scans = wire.scans();
  for (const schema::ArchiveSession* session : *wire.sessions()) {
    footer.sessions.push_back({text_of(session->name()), text_of(session->robot()),
                               text_of(session->sensor()), text_of(session->odometry_frame()),
                               session->started_ns()});
  }
  if (const auto* georeference = wire.georeference()) {
    footer.georeference = Georeference{
        georeference->latitude_deg(), georeference->longitude_deg(), georeference->height_m(),
        pose_from_wire(georeference->t_enu_map(), "the archive's georeference").linear()};
  }
  for (const schema::ArchiveSection* section : *wire.sections()) {
    footer.sections.push_back({static_cast<ArchiveSectionKind>(section->kind()), section->offset(),
                               section->length(), section->checksum()});
  }
  check_footer(footer);
  return footer;
}

}  // namespace cellmap
