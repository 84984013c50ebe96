#include "cellmap/store/update_context.hpp"

#include <string_view>
#include <tuple>

#include "cellmap/store/row_codec.hpp"
#include "cellmap/store/sql_cells.hpp"
#include "cellmap/store/sql_contents.hpp"

namespace cellmap {
namespace {

ContentHash content_of(const EncodedCell& encoded, const std::optional<CodedCopy>& coded) {
  return coded ? coded->content.hash : encoded.hash;
}

std::string_view text_of(const Bytes& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// The questions of one update.
class Asking {
 public:
  Asking(UpdateContext& context, std::int64_t map) : context_(context), map_(map) {}

  void cells(const MapUpdate& update) {
    std::set<CellId> ids(update.aligned);
    for (const NewCell& cell : update.cells) ids.insert(cell.id);
    for (const auto& [id, recoded] : update.recoded) ids.insert(id);
    for (const auto& [id, T_map_cell] : update.poses) ids.insert(id);
    for (const Constraint& constraint : update.add_constraints) {
      ids.insert({constraint.from, constraint.to});
    }
    for (const CellId id : ids) {
      ask_cell(questions_, map_, id,
               [&, id](CellRecord cell) { context_.cells.emplace(id, std::move(cell)); });
    }
  }

  void places(const MapUpdate& update) {
    std::set<std::string> sessions;
    for (const NewCell& cell : update.cells) {
      sessions.insert(cell.cell->session);
      ask_cell(questions_, map_, cell.cell->session, cell.cell->sequence, [&](CellRecord found) {
        context_.places.emplace(std::pair(found.session, found.sequence), found.id);
      });
    }
    for (const std::string& session : sessions) {
      questions_.add(
          "SELECT 1 FROM cell WHERE map = ? AND session = ? LIMIT 1",
          [&, session](Query& row) {
            if (row.next()) context_.sessions.insert(session);
          },
          map_, session);
    }
  }

  void contents(const MapUpdate& update) {
    std::set<ContentHash> hashes;
    for (const NewCell& cell : update.cells) hashes.insert(content_of(cell.encoded, cell.coded));
    for (const auto& [id, recoded] : update.recoded) {
      hashes.insert(content_of(recoded.encoded, recoded.coded));
      questions_.add(
          "SELECT cell.hash, COALESCE(frame_bytes, LENGTH(frame)) FROM cell JOIN blob ON blob.hash "
          "= cell.hash "
          "WHERE map = ? AND id = ?",
          [&, id = id](Query& row) {
            if (!row.next()) return;
            context_.kept[id] = {hash_from(row.bytes(0)), row.unsigned64(1)};
          },
          map_, id.value);
    }
    for (const ContentHash& hash : hashes) {
      questions_.add(
          "SELECT encoded_bytes FROM blob WHERE hash = ?",
          [&, hash](Query& row) {
            if (row.next()) context_.contents.emplace(hash, row.unsigned64(0));
          },
          to_bytes(hash));
    }
  }

  void constraints(const MapUpdate& update) {
    std::set<ConstraintId> ids(update.remove_constraints.begin(), update.remove_constraints.end());
    for (const auto& [id, judgement] : update.judged) ids.insert(id);
    for (const ConstraintId id : ids) {
      questions_.add(
          "SELECT weight, pinned FROM pose_constraint "
          "WHERE map = ? AND id = ? AND removed IS NULL",
          [&, id](Query& row) {
            if (row.next()) context_.constraints[id] = {row.real(0), row.integer(1) != 0};
          },
          map_, id.value);
    }
    removed_.insert(update.remove_constraints.begin(), update.remove_constraints.end());
    for (const Constraint& constraint : update.add_constraints) {
      const UpdateContext::Likeness like = UpdateContext::likeness(constraint);
      questions_.add(
          "SELECT id FROM pose_constraint WHERE map = ? AND from_cell = ? AND to_cell = ? "
          "AND kind = ? AND origin = ? AND T_from_to = ? AND information = ? "
          "AND removed IS NULL ORDER BY id",
          [&, like](Query& row) {
            while (row.next()) {
              const ConstraintId id{row.unsigned32(0)};
              if (!removed_.contains(id)) context_.alike.emplace(like, id);
            }
          },
          map_, like.from.value, like.to.value, like.kind, like.origin, like.T_from_to,
          like.information);
    }
  }

  void ask(SqlConnection& connection) const { questions_.ask(connection); }

 private:
  UpdateContext& context_;
  const std::int64_t map_;
  std::set<ConstraintId> removed_;
  Questions questions_;
};

}  // namespace

bool UpdateContext::Likeness::operator<(const Likeness& other) const {
  const auto key = [](const Likeness& of) {
    return std::tuple(of.from, of.to, of.kind, of.origin, text_of(of.T_from_to),
                      text_of(of.information));
  };
  return key(*this) < key(other);
}

UpdateContext::Likeness UpdateContext::likeness(const Constraint& constraint) {
  return {constraint.from,
          constraint.to,
          static_cast<std::uint32_t>(constraint.kind),
          static_cast<std::uint32_t>(constraint.origin),
          pose_to_bytes(constraint.T_from_to),
          information_to_bytes(constraint.information)};
}

UpdateContext read_update_context(SqlConnection& connection, std::int64_t map,
                                  const MapUpdate& update) {
  UpdateContext context;
  Asking asking(context, map);
  asking.cells(update);
  asking.places(update);
  asking.contents(update);
  asking.constraints(update);
  asking.ask(connection);
  return context;
}

}  // namespace cellmap
