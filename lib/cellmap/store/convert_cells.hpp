#pragma once

#include <functional>
#include <stop_token>
#include <string>

#include "cellmap/core/progress.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

/// What a conversion did.
struct ConversionReport {
  std::uint64_t converted = 0;  ///< CELLs
  std::uint64_t left = 0;       ///< CELLs that were as asked, or compact within a tighter bound
  std::uint64_t replaced = 0;   ///< of the converted: their hash is another one now
};

/// Throws Error{kConflict} where `convert_cells` would.
void require_convertible(const MapInfo& map, const CellForm& form);

/// Called around each commit: a server holds the map's writer.
using AroundCommit = std::function<void(const std::function<void()>& commit)>;

/// Brings the CELLs of a map into a form, and has it keep those that come from now on in it. One
/// CELL is one transaction and one revision; one that broke off is called again and goes on. raw
/// and packed are the same CELL in other bytes. Where a CELL becomes compact it becomes another
/// one: what its bytes decode to. It keeps id and pose, has another hash, and followers are told
/// of it as added anew; the source is gone, also for earlier revisions.
///
/// What is compact stays compact: planes that were rounded are never coded again, since errors
/// would add up unseen. Where any CELL is kept within a wider bound than asked for (exact forms
/// ask for none): Error{kConflict} before anything is changed. Throws Error{kCancelled} when
/// stopped, {kInvalidArgument}, {kNotFound}, and what the store throws.
ConversionReport convert_cells(Store& store, const std::string& map, const CellForm& form,
                               const std::stop_token& stop = {},
                               const ProgressCallback& progress = {},
                               const AroundCommit& around = {});

}  // namespace cellmap
