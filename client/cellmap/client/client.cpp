#include "cellmap/client/client.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <numbers>
#include <thread>

#include "cellmap/client/client_impl.hpp"
#include "cellmap/client/event_stream.hpp"
#include "cellmap/client/files.hpp"
#include "cellmap/client/json.hpp"
#include "cellmap/client/transport.hpp"
#include "cellmap/codec/cell_batch.hpp"
#include "cellmap/codec/changes_codec.hpp"
#include "cellmap/codec/pose_graph_codec.hpp"
#include "cellmap/codec/scan_codec.hpp"
#include "cellmap/codec/zstd.hpp"

namespace cellmap {

using client::as_bytes;
using client::as_text;
using client::HttpRequest;
using client::HttpResponse;
using client::Json;
using client::json_request;
using client::kCellType;
using client::kScanType;
using client::map_path;
using client::session_path;

namespace {

constexpr char kChangesType[] = "application/vnd.cellmap.changes";
constexpr std::size_t kBatchCells = 64;
constexpr std::size_t kPageCells = 1000;
constexpr std::chrono::milliseconds kMaxWait{60'000};
constexpr std::chrono::milliseconds kMaxSilence{20'000};  // four heartbeats

Bytes to_bytes(std::string_view text) {
  const auto bytes = as_bytes(text);
  return {bytes.begin(), bytes.end()};
}

/// Shortest text that reads back as the same number.
std::string number(double value) {
  if (!std::isfinite(value)) {
    throw Error(ErrorCode::kInvalidArgument, "a position, radius or pose is not a finite number");
  }
  return client::dump(Json(value), false);
}

template <typename Values>
std::string comma_separated(const Values& values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : ",") + number(value);
  return text;
}

/// "?a=b&c=d"; values are percent-encoded here.
class Query {
 public:
  void add(const char* key, const std::string& value) {
    text_ += (text_.empty() ? "?" : "&") + std::string(key) + "=" + percent_encoded(value);
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

std::string cell_path(const std::string& map, CellId id) {
  return map_path(map) + "/cells/" + std::to_string(id.value);
}
std::string job_path(JobId id) { return "/v1/jobs/" + std::to_string(id.value); }

/// "x y z qx qy qz qw", as the CELLmap-Pose header gives it.
Pose pose_from_header(const std::string& header) {
  std::array<double, 7> values{};
  const char* next = header.c_str();
  for (double& value : values) {
    char* end = nullptr;
    value = std::strtod(next, &end);
    if (end == next) {
      throw Error(ErrorCode::kCorruptData,
                  "the server's CELLmap-Pose header has no 7 numbers: '" + header + "'");
    }
    next = end;
  }
  return pose_from_xyz_qxyzw(values);
}

Revision revision_from_header(const std::string& header) {
  return std::strtoull(header.c_str(), nullptr, 10);
}

EncodedCell verified(Bytes bytes) {
  const ContentHash hash = verified_hash(bytes);
  return {hash, std::move(bytes)};
}

std::map<CellId, EncodedCell> split_batch(std::string_view body) {
  std::map<CellId, EncodedCell> cells;
  CellBatchReader reader(as_bytes(body));
  while (const auto entry = reader.next()) {
    cells[entry->id] = verified({entry->bytes.begin(), entry->bytes.end()});
  }
  return cells;
}

}  // namespace

void ClientOptions::validate() const {
  retry.validate();
  if (connect_timeout.count() <= 0 || read_timeout.count() <= 0 || write_timeout.count() <= 0) {
    throw Error(ErrorCode::kInvalidArgument, "client timeouts must be positive");
  }
  if (compression_level < 0 || compression_level > 19) {
    throw Error(ErrorCode::kInvalidArgument,
                "compression_level must be 0 to 19, not " + std::to_string(compression_level));
  }
  const auto is_printable = [](unsigned char c) { return c > ' ' && c < 0x7f; };
  if (token.size() > 128 || !std::ranges::all_of(token, is_printable)) {
    throw Error(ErrorCode::kInvalidArgument,
                "a token has at most 128 printable characters and no spaces");
  }
}

CellBatch Client::Impl::batch(const std::string& map, const Json& wanted) {
  HttpRequest request = json_request("POST", map_path(map) + "/cells:batch", wanted);
  request.headers["accept"] = "application/vnd.cellmap.cells";
  request.headers["accept-encoding"] = "zstd";
  request.max_answer_bytes = kMaxBatchBytes;
  const HttpResponse response = transport.perform(request);
  return {revision_from_header(response.header("cellmap-revision")), split_batch(response.body),
          std::strtoull(response.header("cellmap-remaining").c_str(), nullptr, 10)};
}

Client::Client(ClientOptions options) {
  options.validate();
  impl_ = std::make_unique<Impl>(std::move(options));
}
Client::~Client() = default;
Client::Client(Client&&) noexcept = default;
Client& Client::operator=(Client&&) noexcept = default;

const ServerUrl& Client::url() const { return impl_->transport.url(); }
Traffic Client::traffic() const { return impl_->transport.traffic(); }

void Client::check_ready() { impl_->get_text("/readyz"); }
std::string Client::metrics() { return impl_->get_text("/metrics"); }
std::string Client::openapi_yaml() { return impl_->get_text("/openapi.yaml"); }

std::vector<MapInfo> Client::maps() {
  const Json json = impl_->get_json("/v1/maps");
  std::vector<MapInfo> maps;
  for (const Json& map : client::member(json, "maps")) {
    maps.push_back(client::map_info_from_json(map));
  }
  return maps;
}

const ClientOptions& Client::options() const { return impl_->options; }

MapInfo Client::create_map(const std::string& name, const LatticeSpec& lattice,
                           const CellForm& form) {
  Json body = {{"name", name},
               {"lattice", {{"kind", to_string(lattice.kind)}, {"size", lattice.size}}}};
  if (form != CellForm{}) client::put_form(body, form);
  HttpRequest request = json_request("POST", "/v1/maps", body);
  request.idempotent = false;
  return client::map_info_from_json(impl_->send_json(request));
}

MapInfo Client::map(const std::string& name) {
  return client::map_info_from_json(impl_->get_json(map_path(name)));
}

Job Client::convert(const std::string& map, const CellForm& form) {
  Json body = Json::object();
  client::put_form(body, form);
  HttpRequest request = json_request("POST", map_path(map) + "/convert", body);
  request.idempotent = false;
  return client::job_from_json(impl_->send_json(request));
}

void Client::delete_map(const std::string& name) {
  impl_->transport.perform({"DELETE", map_path(name), {}, ""});
}

CellPage Client::cells(const std::string& map, const CellQuery& query) {
  Query url;
  if (query.near) {
    url.add("near", comma_separated(*query.near));
    url.add("radius", number(query.radius_m));
  }
  if (query.box) {
    Eigen::Matrix<double, 6, 1> corners;
    corners << query.box->min(), query.box->max();
    url.add("bbox", comma_separated(corners));
  }
  if (query.session) url.add("session", *query.session);
  if (query.since > 0) url.add("since", std::to_string(query.since));
  url.add("limit", std::to_string(query.limit));
  if (!query.cursor.empty()) url.add("cursor", query.cursor);
  return client::cell_page_from_json(impl_->get_json(map_path(map) + "/cells" + url.text()));
}

std::vector<CellRecord> Client::all_cells(const std::string& map, CellQuery query) {
  query.limit = kPageCells;
  query.cursor.clear();
  std::vector<CellRecord> all;
  do {
    CellPage page = cells(map, query);
    all.insert(all.end(), page.cells.begin(), page.cells.end());
    query.cursor = page.next_cursor;
  } while (!query.cursor.empty());
  return all;
}

FetchedCell Client::cell(const std::string& map, CellId id) {
  HttpRequest request{
      "GET", cell_path(map, id), {{"accept", kCellType}, {"accept-encoding", "zstd"}}, ""};
  request.max_answer_bytes = kMaxCellBytes;
  std::optional<EncodedCell> cached;
  if (auto& cache = impl_->cache) {
    const auto hash = cache->remembered_hash(impl_->cache_key(map), id);
    if (auto bytes = hash ? cache->get(*hash) : std::nullopt) cached = {*hash, std::move(*bytes)};
  }
  if (cached) request.headers["if-none-match"] = '"' + to_hex(cached->hash) + '"';
  const HttpResponse response = impl_->transport.perform(request);
  FetchedCell fetched;
  fetched.id = id;
  fetched.from_cache = response.status == 304 && cached;
  fetched.encoded = fetched.from_cache ? std::move(*cached) : verified(to_bytes(response.body));
  fetched.T_map_cell = pose_from_header(response.header("cellmap-pose"));
  fetched.revision = revision_from_header(response.header("cellmap-revision"));
  if (impl_->cache && !fetched.from_cache) {
    impl_->cache->put(fetched.encoded);
    impl_->cache->remember_hash(impl_->cache_key(map), id, fetched.encoded.hash);
  }
  return fetched;
}

PutCellResult Client::put_cell(const std::string& map, CellId id, const EncodedCell& cell,
                               const std::optional<Pose>& T_map_cell) {
  HttpRequest request{"PUT", cell_path(map, id), {}, ""};
  impl_->set_body(request, cell.bytes, kCellType);
  if (T_map_cell) {
    std::string header;
    for (const double value : to_xyz_qxyzw(*T_map_cell)) {
      header += (header.empty() ? "" : " ") + number(value);
    }
    request.headers["cellmap-pose"] = header;
  }
  const HttpResponse response = impl_->transport.perform(request);
  PutCellResult result = client::put_cell_result_from_json(client::parse_json(response.body));
  result.created = response.status == 201;
  return result;
}

CellBatch Client::cells_batch(const std::string& map, std::span<const CellId> ids) {
  Json list = Json::array();
  for (const CellId id : ids) list.push_back(id.value);
  return impl_->batch(map, {{"ids", list}});
}

CellBatch Client::cells_batch_since(const std::string& map, Revision since) {
  return impl_->batch(map, {{"since", since}});
}

void Client::for_each_cell(
    const std::string& map, std::span<const CellRecord> cells,
    const std::function<void(const CellRecord&, const EncodedCell&)>& on_cell) {
  std::vector<CellRecord> missing;
  for (const CellRecord& cell : cells) {
    auto bytes = impl_->cache ? impl_->cache->get(cell.hash) : std::nullopt;
    if (bytes) {
      on_cell(cell, {cell.hash, std::move(*bytes)});
    } else {
      missing.push_back(cell);
    }
  }
  while (!missing.empty()) {
    std::vector<CellId> ids;
    for (const CellRecord& cell : missing) {
      if (ids.size() < kBatchCells) ids.push_back(cell.id);
    }
    const CellBatch batch = cells_batch(map, ids);
    const std::size_t before = missing.size();
    std::erase_if(missing, [&](const CellRecord& cell) {
      const auto found = batch.cells.find(cell.id);
      if (found == batch.cells.end() || found->second.hash != cell.hash) return false;
      if (impl_->cache) impl_->cache->put(found->second);
      on_cell(cell, found->second);
      return true;
    });
    if (missing.size() == before) {
      throw Error(ErrorCode::kConflict, "CELL " + std::to_string(missing.front().id.value) +
                                            " of map '" + map +
                                            "' changed on the server while it was "
                                            "read; start again");
    }
  }
}

PoseGraph Client::pose_graph(const std::string& map, std::optional<Revision> revision) {
  Query url;
  if (revision) url.add("revision", std::to_string(*revision));
  HttpRequest request{"GET", map_path(map) + "/pose-graph" + url.text(), {}, ""};
  request.headers = {{"accept", "application/vnd.cellmap.pose-graph"}, {"accept-encoding", "zstd"}};
  request.max_answer_bytes = kMaxBatchBytes;
  return decode_pose_graph(to_bytes(impl_->transport.perform(request).body));
}

Changes Client::changes(const std::string& map, Revision since, std::chrono::milliseconds wait) {
  Query url;
  url.add("since", std::to_string(since));
  wait = std::min({wait, kMaxWait, impl_->options.read_timeout / 2});
  if (wait.count() > 0) url.add("wait_s", number(static_cast<double>(wait.count()) / 1000));
  HttpRequest request{"GET", map_path(map) + "/changes" + url.text(), {}, ""};
  request.headers = {{"accept", std::string(kChangesType) + ", application/json;q=0.5"},
                     {"accept-encoding", "zstd"}};
  request.max_answer_bytes = kMaxChangesBytes;
  const HttpResponse response = impl_->transport.perform(request);
  Changes changes;
  if (response.header("content-type").starts_with(kChangesType)) {
    static_cast<MapChanges&>(changes) = decode_changes(as_bytes(response.body));
  } else {
    changes = client::changes_from_json(client::parse_json(response.body));
  }
  if (changes.since != since) {
    throw Error(ErrorCode::kCorruptData, "the server answered with the changes since revision " +
                                             std::to_string(changes.since) + " instead of " +
                                             std::to_string(since));
  }
  const std::string created = response.header("cellmap-created");
  if (!created.empty()) changes.map_created = client::stamp_from_rfc3339(created);
  return changes;
}

bool Client::follow_revisions(
    const std::string& map, std::optional<Revision> known,
    const std::function<bool(const std::optional<RevisionEvent>&)>& on_event,
    std::stop_token stop) {
  client::EventStreamParser parser;
  client::StreamRequest request{map_path(map) + "/events", {{"accept", "text/event-stream"}}};
  if (known) request.headers["last-event-id"] = std::to_string(*known);
  request.max_silence = std::min(kMaxSilence, impl_->options.read_timeout);
  const auto receive = [&](std::string_view piece) {
    std::optional<RevisionEvent> latest;  // of several in one piece only the last matters
    parser.feed(piece, [&](const client::ServerEvent& event) {
      if (event.type != "revision") return;
      latest = client::revision_event_from_json(client::parse_json(event.data));
    });
    return on_event(latest);
  };
  return impl_->transport.stream(request, receive, stop);
}

std::string Client::trajectory_text(const std::string& map, const std::string& session,
                                    TrajectoryFormat format, TrajectoryStage stage) {
  Query url;
  url.add("session", session);
  url.add("format", format == TrajectoryFormat::kKitti ? "kitti" : "tum");
  if (stage == TrajectoryStage::kOdometry) url.add("stage", "odometry");
  return impl_->get_text(map_path(map) + "/trajectory" + url.text());
}

namespace {

HttpRequest relocalise_request(const std::string& map, const std::optional<PosePrior>& prior) {
  Query url;
  if (prior) {
    url.add("prior", comma_separated(to_xyz_qxyzw(prior->T_map_scan)));
    url.add("radius", number(prior->radius_m));
    url.add("yaw_range_deg", number(prior->yaw_range_rad * 180.0 / std::numbers::pi));
  }
  HttpRequest request{"POST", map_path(map) + "/relocalise" + url.text(), {}, ""};
  request.headers["accept"] = "application/json";
  return request;
}

}  // namespace

Relocalisation Client::relocalise(const std::string& map, const EncodedCell& cell,
                                  const std::optional<PosePrior>& prior) {
  HttpRequest request = relocalise_request(map, prior);
  impl_->set_body(request, cell.bytes, kCellType);
  return client::relocalisation_from_json(impl_->send_json(request));
}

Relocalisation Client::relocalise(const std::string& map, const PointCloud& scan,
                                  const std::optional<PosePrior>& prior) {
  HttpRequest request = relocalise_request(map, prior);
  PosedScan posed;
  posed.points = scan;
  impl_->set_body(request, encode_scan(posed), kScanType);
  return client::relocalisation_from_json(impl_->send_json(request));
}

std::vector<Job> Client::jobs(const std::string& map) {
  const Json json = impl_->get_json(map_path(map) + "/jobs");
  std::vector<Job> jobs;
  for (const Json& job : client::member(json, "jobs")) jobs.push_back(client::job_from_json(job));
  return jobs;
}

Job Client::job(JobId id) { return client::job_from_json(impl_->get_json(job_path(id))); }

Job Client::start_ingest(const std::string& map, const IngestRequest& request) {
  HttpRequest post = json_request("POST", map_path(map) + "/jobs", client::to_json(request));
  post.idempotent = !request.session.empty();  // the session names the job
  return client::job_from_json(impl_->send_json(post));
}

PutScanResult Client::put_scan(JobId id, const PosedScan& scan) {
  HttpRequest request{"PUT", job_path(id) + "/scans/" + std::to_string(scan.index), {}, ""};
  impl_->set_body(request, encode_scan(scan), kScanType);
  const HttpResponse response = impl_->transport.perform(request, true);
  if (response.status != 409) return {};
  const Json problem = client::parse_json(response.body);
  if (problem.is_object() && problem.contains("next_scan")) {
    return {false, client::unsigned_member(problem, "next_scan")};
  }
  throw client::problem_to_error(409, response.header("content-type"), response.body,
                                 "PUT " + request.path);
}

Job Client::complete_upload(JobId id, std::optional<std::uint64_t> scans) {
  std::string path = job_path(id) + "/complete";
  if (scans) path += "?scans=" + std::to_string(*scans);
  return client::job_from_json(
      impl_->send_json({"POST", std::move(path), {{"accept", "application/json"}}, ""}));
}

Job Client::cancel_job(JobId id) {
  return client::job_from_json(impl_->send_json({"DELETE", job_path(id), {}, ""}));
}

Job Client::follow_job(JobId id, const std::function<void(const Job&)>& on_progress,
                       std::stop_token stop) {
  constexpr std::chrono::milliseconds kPoll{500}, kStopCheck{50};
  Job latest = job(id);
  const auto take = [&](Job job) {
    latest = std::move(job);
    if (on_progress) on_progress(latest);
  };
  take(latest);
  while (!is_final(latest.state) && !stop.stop_requested()) {
    client::EventStreamParser parser;
    impl_->transport.stream(
        {job_path(id) + "/events", {{"accept", "text/event-stream"}}},
        [&](std::string_view piece) {
          parser.feed(piece, [&](const client::ServerEvent& event) {
            if (event.type == "progress" || event.type == "end") {
              take(client::job_from_json(client::parse_json(event.data)));
            }
          });
          return !is_final(latest.state);
        },
        stop);
    // The stream ended early or never began: ask, which also meets a server that restarts.
    if (is_final(latest.state) || stop.stop_requested()) break;
    for (auto waited = kStopCheck; waited < kPoll && !stop.stop_requested(); waited += kStopCheck) {
      std::this_thread::sleep_for(kStopCheck);
    }
    if (!stop.stop_requested()) take(job(id));
  }
  return latest;
}

}  // namespace cellmap
