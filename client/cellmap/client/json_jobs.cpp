#include "cellmap/client/json_reading.hpp"

namespace cellmap::client {

Json to_json(const Job& job) {
  const auto optional = [](const std::optional<double>& value) {
    return value ? Json(*value) : Json(nullptr);
  };
  Json error = nullptr;
  if (job.error_code) {
    error = {{"code", to_string(*job.error_code)}, {"message", job.error_message}};
  }
  const bool is_held = !job.worker.empty();
  return {{"id", job.id.value},
          {"map", job.map},
          {"kind", job.kind},
          {"state", to_string(job.state)},
          {"session", job.session.empty() ? Json() : Json(job.session)},
          {"scans_done", job.scans_done},
          {"scans_total", job.scans_total},
          {"cells_done", job.cells_done},
          {"progress", optional(job.progress)},
          {"scans_per_second", job.scans_per_second},
          {"eta_s", optional(job.eta_s)},
          {"next_scan", job.next_scan ? Json(*job.next_scan) : Json(nullptr)},
          {"worker", is_held ? Json(job.worker) : Json(nullptr)},
          {"lease_ends", is_held ? Json(to_rfc3339(job.lease_ends)) : Json(nullptr)},
          {"error", error},
          {"created", to_rfc3339(job.created)},
          {"updated", to_rfc3339(job.updated)}};
}

Job job_from_json(const Json& json) {
  return decoded("job", [&] {
    const auto optional = [&](const char* key) -> std::optional<double> {
      const auto found = json.find(key);
      if (found == json.end() || found->is_null()) return std::nullopt;
      return found->get<double>();
    };
    const auto count_or_zero = [&](const char* key) {
      return json.contains(key) && !json.at(key).is_null() ? count(json, key) : 0;
    };
    Job job;
    job.id = id<JobId>(json.at("id"));
    job.map = json.at("map");
    job.kind = json.at("kind");
    job.state = job_state_from_string(json.at("state").get<std::string>());
    if (!json.at("session").is_null()) job.session = json.at("session");
    job.scans_done = count(json, "scans_done");
    job.scans_total = count_or_zero("scans_total");
    job.cells_done = count(json, "cells_done");
    job.progress = optional("progress");
    job.scans_per_second = number_or(json, "scans_per_second", 0);
    job.eta_s = optional("eta_s");
    if (json.contains("next_scan") && !json.at("next_scan").is_null()) {
      job.next_scan = count(json, "next_scan");
    }
    if (json.contains("error") && !json.at("error").is_null()) {
      job.error_code = error_code_from_string(json.at("error").at("code").get<std::string>());
      job.error_message = json.at("error").at("message");
    }
    if (json.contains("worker") && !json.at("worker").is_null()) {
      job.worker = json.at("worker");
      job.lease_ends = stamp_from_rfc3339(json.at("lease_ends"));
    }
    job.created = stamp_from_rfc3339(json.at("created"));
    job.updated = stamp_from_rfc3339(json.at("updated"));
    return job;
  });
}

namespace {

std::string_view name_of(PoseFrame frame) {
  switch (frame) {
    case PoseFrame::kCamera:
      return "camera";
    case PoseFrame::kSensor:
      return "sensor";
    case PoseFrame::kAuto:
      break;
  }
  return "auto";
}

Json to_json(const IngestOptions& options) {
  Json json = Json::object();
  const auto set = [&](const char* key, const auto& value) {
    if (value) json[key] = *value;
  };
  set("cell_distance_m", options.cell_distance_m);
  set("min_range_m", options.min_range_m);
  set("max_range_m", options.max_range_m);
  set("vertical_angle_correction_deg", options.vertical_angle_correction_deg);
  set("bidirectional", options.bidirectional);
  set("loop_closures", options.loop_closures);
  if (options.loop_acceptance) json["loop_acceptance"] = to_string(*options.loop_acceptance);
  set("min_points", options.min_points);
  set("max_range_gap_m", options.max_range_gap_m);
  if (options.fit) json["fit"] = to_string(*options.fit);
  return json;
}

}  // namespace

Json to_json(const IngestRequest& request) {
  Json json = {{"kind", "ingest"}, {"create_map", request.create_map}};
  if (!request.session.empty()) json["session"] = request.session;
  if (request.path.empty()) {
    json["upload"] = true;
  } else {
    json["path"] = request.path;
    json["pose_frame"] = name_of(request.pose_frame);
  }
  if (!request.poses.empty()) json["poses"] = request.poses;
  if (request.scans_total > 0) json["scans_total"] = request.scans_total;
  if (request.lattice) {
    json["lattice"] = {{"kind", to_string(request.lattice->kind)}, {"size", request.lattice->size}};
  }
  if (request.form) put_form(json, *request.form);
  if (Json options = to_json(request.options); !options.empty()) json["options"] = options;
  return json;
}

}  // namespace cellmap::client
