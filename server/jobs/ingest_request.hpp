#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cellmap/codec/cell_form.hpp"
#include "cellmap/geometry/lattice.hpp"
#include "cellmap/pipeline/mapper.hpp"
#include "cellmap/scan/scan_source.hpp"
#include "server/api/json_io.hpp"

namespace cellmap::server {

/// What an ingest job was asked to do.
struct IngestRequest {
  std::string session;
  std::optional<std::string> path;  ///< as asked; unset: the client uploads the scans
  std::string poses;                ///< as asked; empty: the folder's own
  PoseFrame pose_frame = PoseFrame::kAuto;
  std::uint64_t scans_total = 0;  ///< of an upload; 0: not known
  MapperOptions options;
  bool create_map = false;
  LatticeSpec lattice;           ///< of a map that is created
  std::optional<CellForm> form;  ///< of this drive's CELLs, and of a map that is created
};

/// Throws Error{kInvalidArgument} or {kUnsupported}.
IngestRequest parse_ingest_request(const Json& json);

/// Finds a data set folder or file below the data roots. `asked` is absolute or relative to
/// `base` (where given) or to a root. Symbolic links are resolved first, so that neither ".." nor
/// a link leads out. Throws Error{kInvalidArgument} outside of the roots, Error{kNotFound}.
std::filesystem::path resolve_below(const std::vector<std::filesystem::path>& roots,
                                    const std::string& asked,
                                    const std::filesystem::path& base = {});

/// Opens the data set of a request that has a path. Throws as `resolve_below` and `open_dataset`
/// do, and Error{kInvalidArgument} where a link in the folder leads out of the roots.
std::unique_ptr<ScanSource> open_request(const IngestRequest& request,
                                         const std::vector<std::filesystem::path>& roots);

/// Of all computations; results do not depend on them. 0: all processors.
void set_threads(MapperOptions& options, int threads);

}  // namespace cellmap::server
