#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/client/upload.hpp"
#include "cellmap/codec/scan_batch.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/form_flags.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/job_text.hpp"
#include "client/cli/map_reader.hpp"
#include "client/cli/map_text.hpp"
#include "client/cli/mapper_flags.hpp"

namespace cellmap::cli {
namespace {

struct IngestArguments {
  Place place;
  DriveFlags drive;
  MapperFlags mapper;
  FormFlags form;
  std::string map;
  bool server_path = false, cells = false;
  SessionInfo session;
  std::size_t scans_per_request = UploadOptions{}.scans_per_request;
  double reconnect_s = std::chrono::duration<double>(UploadOptions{}.lost_patience).count();

  UploadOptions upload() const {
    UploadOptions result;
    result.scans_per_request = scans_per_request;
    result.lost_patience = std::chrono::milliseconds(std::llround(reconnect_s * 1000));
    return result;
  }
};

/// CELLs that come from outside are tied by the server's own settings.
void refuse_flags_without_effect(const IngestArguments& options) {
  const MapperFlags& mapper = options.mapper;
  if (!options.cells) return;
  const char* const flag = mapper.no_loops                   ? "--no-loops"
                           : mapper.no_bidirectional         ? "--no-bidirectional"
                           : !mapper.loop_acceptance.empty() ? "--loop-acceptance"
                                                             : nullptr;
  if (!flag) return;
  throw CLI::ValidationError(
      flag,
      "has no effect with --cells: the server ties CELLs that it is sent by settings of its "
      "own; leave it out, or send the scans (without --cells)");
}

IngestRequest ingest_request(const IngestArguments& options) {
  IngestRequest request;
  request.session = options.drive.session_name();
  request.options = options.mapper.ingest_options();
  if (options.mapper.lattice_size) request.lattice = options.mapper.lattice();
  request.form = options.form.form();
  if (options.server_path) {
    request.path = options.drive.dataset;
    request.poses = options.drive.poses;
    request.pose_frame = options.drive.frame();
  }
  return request;
}

void make_map_where_missing(Client& client, const IngestArguments& options) {
  try {
    client.create_map(options.map, options.mapper.lattice(),
                      options.form.form().value_or(CellForm{}));
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kAlreadyExists) throw;
  }
}

/// Builds the CELLs here and sends them instead of the scans.
void send_cells(Client& client, const IngestArguments& options, const Console& console) {
  const Interrupt interrupt;
  make_map_where_missing(client, options);
  const auto source = options.drive.open();
  const std::string session = options.drive.session_name();
  SentCells sent;
  {
    ProgressBar bar(console, "ingest");
    sent = upload_cells(
        client, options.map, session, *source, options.mapper.mapper_options(1),
        [&](const Progress& progress) { bar.update(progress.scans_done, progress.scans_total); },
        interrupt.token());
  }
  if (interrupt.token().stop_requested()) {
    throw Error(
        ErrorCode::kCancelled,
        "stopped sending; what was sent is in the map, run the same command again to go on");
  }
  const Traffic traffic = client.traffic();
  const std::uint64_t raw_bytes = sent.raw_points * 12;  // three float32
  console.print(
      {{"session", session},
       {"scans", sent.scans},
       {"cells", sent.cells},
       {"aligned", sent.aligned},
       {"length_m", sent.length_m},
       {"sent_bytes", traffic.sent_bytes},
       {"received_bytes", traffic.received_bytes},
       {"raw_scan_bytes", raw_bytes}},
      format("Session %s (%s): %s scans, %s CELLs; %s bytes up, %s down; the scans would "
             "have been %s\n",
             session.c_str(), sent.aligned ? "in the map frame" : "not aligned yet",
             with_commas(sent.scans).c_str(), with_commas(sent.cells).c_str(),
             with_commas(traffic.sent_bytes).c_str(), with_commas(traffic.received_bytes).c_str(),
             with_commas(raw_bytes).c_str()));
}

void describe_session(Client& client, const IngestArguments& options) {
  const SessionInfo& said = options.session;
  if (said.robot.empty() && said.sensor.empty()) return;
  make_map_where_missing(client, options);
  SessionInfo session = said;
  session.name = options.drive.session_name();
  client.create_session(options.map, session);
}

void run_ingest(const IngestArguments& options, const Console& console) {
  Client client = connect(options.place);
  describe_session(client, options);
  if (options.cells) return send_cells(client, options, console);
  const Interrupt interrupt;
  Job job;
  {
    ProgressBar bar(console, "ingest");
    const auto on_progress = [&](const Job& latest) { show(bar, latest); };
    if (options.server_path) {
      job = client.start_ingest(options.map, ingest_request(options));
      job = client.follow_job(job.id, on_progress, interrupt.token());
    } else {
      const auto source = options.drive.open();
      job = deliver_drive(client, options.map, ingest_request(options), *source, options.upload(),
                          on_progress, interrupt.token());
    }
  }
  if (!is_final(job.state)) {
    throw Error(ErrorCode::kCancelled,
                options.server_path
                    ? "stopped watching; job " + std::to_string(job.id.value) +
                          " goes on in the server (cellmap jobs follow)"
                    : "stopped sending; run the same command again to go on, or cancel with "
                      "'cellmap jobs cancel " +
                          std::to_string(job.id.value) + "'");
  }
  throw_unless_succeeded(job);
  const MapInfo map = client.map(options.map);
  console.print(
      {{"job", client::to_json(job)}, {"map", client::to_json(map)}},
      format("Session %s: %s scans\n", job.session.c_str(), with_commas(job.scans_done).c_str()) +
          map_text(map));
}

}  // namespace

void add_ingest(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<IngestArguments>();
  CLI::App* verb = verbs.add(
      app, "ingest", "Send a drive to a server and follow the job that maps it",
      "  cellmap ingest drive --server http://127.0.0.1:8080 --map town\n"
      "  cellmap ingest kitti/00 --poses odometry.txt --pose-frame camera --angle-correction 0.205 "
      "--server http://127.0.0.1:8080 --map kitti00\n"
      "  cellmap ingest /drives/07 --server-path --server http://127.0.0.1:8080 --map seven\n"
      "  cellmap ingest drive --cells --robot cart-7 --server http://127.0.0.1:8080 --map town\n"
      "The same command again goes on where it was broken off.\n",
      [options](const Console& console) { run_ingest(*options, console); });
  add_drive_flags(*verb, options->drive);
  add_place_options(*verb, options->place, false);
  verb->add_option("--map", options->map, "Name of the map; made where it is missing")->required();
  auto* cells = verb->add_flag(
      "--cells", options->cells,
      "Build the CELLs here and send them as they are finished, instead of the scans");
  verb->add_option("--robot", options->session.robot, "Who drives, for the list of sessions");
  verb->add_option("--sensor", options->session.sensor, "With what, for example OS1-64");
  verb->add_flag("--server-path", options->server_path,
                 "DATASET and --poses are paths on the server, under one of its data roots")
      ->excludes(cells);
  const std::string group = "Sending scans";
  verb->add_option("--scans-per-request", options->scans_per_request,
                   "Scans sent together; each request costs a round trip")
      ->check(CLI::Range(std::size_t{1}, kMaxBatchScans))
      ->capture_default_str()
      ->group(group);
  verb->add_option("--reconnect", options->reconnect_s,
                   "How long a server that was lost is tried again, seconds")
      ->check(CLI::Range(0.0, 86'400.0))
      ->capture_default_str()
      ->group(group);
  add_form_flags(*verb, options->form,
                 "How the server keeps the CELLs; without it as the map says, or raw");
  add_mapper_flags(*verb, options->mapper);
  verb->parse_complete_callback([options] { refuse_flags_without_effect(*options); });
}

}  // namespace cellmap::cli
