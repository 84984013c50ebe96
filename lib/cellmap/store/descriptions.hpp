#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/core/hash.hpp"
#include "cellmap/core/id.hpp"

namespace cellmap {

class Store;

/// What was made of the planes of a CELL and takes longer to make again than to read.
struct CellDescription {
  CellId cell;
  ContentHash hash;  ///< CellRecord::hash of what it was made of
  Bytes bytes;       ///< the store does not look into them
};

/// What a store keeps beside CELLs so that it need not be made again: nothing is lost where it is
/// missing. Gone with its CELL, and not copied with its map. No part of a revision. Concurrency and
/// errors as `Store`.
class Descriptions {
 public:
  virtual ~Descriptions() = default;

  /// Of these CELLs (ascending) those that are kept and were made of what the CELL is now; by id.
  /// What is damaged counts as missing. Error{kNotFound} where there is no such map.
  virtual std::vector<CellDescription> descriptions(const std::string& map,
                                                    std::span<const CellId> cells) const = 0;
  /// Replaces earlier ones; of a CELL that is not there, or is another one by now, nothing is kept.
  /// Error{kTooLarge} above kMaxDescriptionBytes, {kNotFound} where there is no such map.
  virtual void keep_descriptions(const std::string& map,
                                 const std::vector<CellDescription>& descriptions) = 0;
};

constexpr std::size_t kMaxDescriptionBytes = 64u << 10;

/// The descriptions of a store. Throws Error{kUnsupported} for an engine that keeps none.
Descriptions& descriptions_of(Store& store);

}  // namespace cellmap
