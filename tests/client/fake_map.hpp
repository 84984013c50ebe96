#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "cellmap/client/json.hpp"
#include "cellmap/codec/cell_batch.hpp"
#include "client/fake_server.hpp"
#include "codec/samples.hpp"

namespace cellmap::test {

using client::Json;

/// A map that a test grows, behind the routes that a pull uses; answers in JSON, as a server that
/// knows nothing else.
struct FakeMap {
  struct Entry {
    EncodedCell cell;
    CellRecord record;
  };
  Stamp created = 1'795'319'109'125'000'000;
  Revision revision = 0;
  std::map<CellId, Entry> cells;
  std::vector<std::pair<Revision, Constraint>> constraints;
  std::vector<std::vector<std::uint32_t>> batches;  ///< ids of each batch that was asked for

  void add(std::uint32_t id) {
    ++revision;
    const Cell cell = random_cell(id, 40, 1000);
    Entry entry{encode_cell(cell), {}};
    entry.record.id = CellId{id};
    entry.record.hash = entry.cell.hash;
    entry.record.added = entry.record.moved = revision;
    entry.record.session = cell.session;
    entry.record.encoded_bytes = entry.cell.bytes.size();
    cells[CellId{id}] = std::move(entry);
    if (!cells.contains(CellId{id - 1})) return;
    Constraint constraint;
    constraint.id = ConstraintId{id};
    constraint.from = CellId{id - 1};
    constraint.to = CellId{id};
    constraints.emplace_back(revision, constraint);
  }

  void move(std::uint32_t id, double x) {
    CellRecord& record = cells.at(CellId{id}).record;
    record.T_map_cell.translation().x() = x;
    record.moved = ++revision;
  }

  void place(std::uint32_t id, double x) {
    cells.at(CellId{id}).record.T_map_cell.translation().x() = x;
  }

  std::string summary() const {
    MapInfo info;
    info.name = "m";
    info.created = created;
    info.revision = revision;
    info.cells = cells.size();
    return client::dump(client::to_json(info));
  }

  std::string changes(Revision since) const {
    Json json = {{"since", since}, {"revision", revision}};
    json["added"] = json["moved"] = json["removed"] = json["removed_constraints"] = Json::array();
    json["added_constraints"] = Json::array();
    for (const auto& [id, entry] : cells) {
      const CellRecord& record = entry.record;
      if (record.added > since) {
        json["added"].push_back(client::to_json(record));
      } else if (record.moved > since) {
        json["moved"].push_back({{"id", id.value}, {"pose", client::to_json(record.T_map_cell)}});
      }
    }
    for (const auto& [added, constraint] : constraints) {
      if (added > since) json["added_constraints"].push_back(client::to_json(constraint));
    }
    return client::dump(json);
  }

  std::string batch(const std::string& request) {
    Bytes bytes;
    batches.emplace_back();
    const Json wanted = client::parse_json(request);
    for (const Json& id : wanted.at("ids")) {
      batches.back().push_back(id);
      append_to_batch(bytes, CellId{id}, cells.at(CellId{id}).cell.bytes);
    }
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  }

  void answer(const httplib::Request& request, httplib::Response& response) {
    if (request.path.ends_with("/changes")) {
      answer_json(response, changes(std::stoull(request.get_param_value("since"))));
    } else if (request.path.ends_with("/cells:batch")) {
      response.set_header("CELLmap-Revision", std::to_string(revision));
      response.set_content(batch(request.body), "application/vnd.cellmap.cells");
    } else {
      answer_json(response, summary());
    }
  }

  FakeServer server{[this](const httplib::Request& request, httplib::Response& response) {
    answer(request, response);
  }};
};

}  // namespace cellmap::test
