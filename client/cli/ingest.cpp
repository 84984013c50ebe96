#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/client/upload.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/job_text.hpp"
#include "client/cli/map_reader.hpp"
#include "client/cli/map_text.hpp"
#include "client/cli/mapper_flags.hpp"

namespace cellmap::cli {
namespace {

struct Options {
  Place place;
  DriveFlags drive;
  MapperFlags mapper;
  std::string map;
  bool server_path = false;
};

IngestRequest request_of(const Options& options) {
  IngestRequest request;
  request.session = options.drive.session_name();
  request.options = options.mapper.ingest_options();
  if (options.mapper.lattice_size) request.lattice = options.mapper.lattice();
  if (options.server_path) {
    request.path = options.drive.dataset;
    request.poses = options.drive.poses;
    request.pose_frame = options.drive.frame();
  }
  return request;
}

void run(const Options& options, const Console& console) {
  const Interrupt interrupt;
  Client client = connect(options.place);
  Job job;
  {
    ProgressBar bar(console, "ingest");
    const auto on_progress = [&](const Job& latest) { show(bar, latest); };
    if (options.server_path) {
      job = client.start_ingest(options.map, request_of(options));
    } else {
      const auto source = options.drive.open();
      job = upload_drive(client, options.map, request_of(options), *source, {}, on_progress,
                         interrupt.token());
    }
    job = client.follow_job(job.id, on_progress, interrupt.token());
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
  const auto options = std::make_shared<Options>();
  CLI::App* verb = verbs.add(
      app, "ingest", "Send a drive to a server and follow the job that maps it",
      "  cellmap ingest drive --server http://127.0.0.1:8080 --map town\n"
      "  cellmap ingest kitti/00 --poses odometry.txt --pose-frame camera --angle-correction 0.205 "
      "--server http://127.0.0.1:8080 --map kitti00\n"
      "  cellmap ingest /drives/07 --server-path --server http://127.0.0.1:8080 --map seven\n"
      "The same command again goes on where it was broken off.\n",
      [options](const Console& console) { run(*options, console); });
  add_drive_flags(*verb, options->drive);
  add_place_options(*verb, options->place, false);
  verb->add_option("--map", options->map, "Name of the map; made where it is missing")->required();
  verb->add_flag("--server-path", options->server_path,
                 "DATASET and --poses are paths on the server, under one of its data roots");
  add_mapper_flags(*verb, options->mapper);
}

}  // namespace cellmap::cli
