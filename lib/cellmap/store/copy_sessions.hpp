#pragma once

#include <map>
#include <set>
#include <stop_token>
#include <string>

#include "cellmap/core/progress.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

/// Copies sessions of one map into another of the same lattice: descriptions, CELLs with their
/// stretches of the drive, poses, and the constraints between them with what is thought of those.
/// CELLs keep their bytes, in whatever form, and hashes, and get new ids, which are returned by the
/// old ones.
///
/// Into an empty map they come as they are. In another they begin as islands of their own
/// (pose_graph/frames.hpp), whether they were aligned or not, because the two map frames have
/// nothing to do with each other; what joins them is for the caller.
///
/// CELLs that are there already are left alone, so that a copy that broke off can be made again:
/// CELLs go in order, constraints last. Throws Error{kConflict} where a session of that name holds
/// other CELLs, {kInvalidArgument} where the lattices differ, {kNotFound} for a session or map that
/// is not there, {kPreconditionFailed} where somebody else changed the target meanwhile (make the
/// copy again), {kCancelled} when stopped. O(CELLs) with one CELL at a time in memory.
std::map<CellId, CellId> copy_sessions(Store& store, const std::string& from,
                                       const std::set<std::string>& sessions, const std::string& to,
                                       const std::stop_token& stop = {},
                                       const ProgressCallback& progress = {});

}  // namespace cellmap
