#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "cellmap/client/folder_lock.hpp"
#include "cellmap/client/pull.hpp"

namespace cellmap::client {

/// Pulls a map into a folder again and again; holds the folder's lock and its state meanwhile.
/// Not installed: `pull_map` and `follow_map` are its faces.
class Puller {
 public:
  /// Throws as `pull_map` does where the folder is not this map's.
  Puller(Client& client, std::string map, std::filesystem::path folder);

  /// Takes over what has changed; `given`: where that is known already.
  PullReport pull(const PullOptions& options, std::optional<Changes> given = {});

  /// Of the mirror: whatever differs from it is news.
  Revision revision() const { return mirror_ ? mirror_->revision : 0; }
  Stamp map_created() const { return mirror_ ? mirror_->map_created : 0; }

 private:
  Changes next_changes(Mirror& mirror, PullReport& report, std::optional<Changes> given);
  CellForm form_of(const PullOptions& options, const Mirror& next, const Changes& changes);
  void fetch(const std::vector<CellRecord>& missing, const CellForm& form,
             const PullOptions& options, PullReport& report);

  Client& client_;
  std::string map_;
  std::filesystem::path folder_;
  FolderLock lock_;
  std::optional<Mirror> mirror_;  ///< what the folder holds; empty before the first pull
};

/// RFC 3339 text keeps milliseconds.
bool is_same_creation(Stamp a, Stamp b);

}  // namespace cellmap::client
