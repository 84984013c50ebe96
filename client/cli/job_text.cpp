#include "client/cli/job_text.hpp"

namespace cellmap::cli {

std::string job_line(const Job& job) {
  std::string line =
      format("job %-5u %-9s %-8s %-20s %s", job.id.value, std::string(to_string(job.state)).c_str(),
             job.kind.c_str(), job.session.c_str(), with_commas(job.scans_done).c_str());
  if (job.scans_total > 0) line += "/" + with_commas(job.scans_total);
  line += " scans, " + with_commas(job.cells_done) + " CELLs";
  if (job.scans_per_second > 0) line += format(", %.1f scans/s", job.scans_per_second);
  if (!job.worker.empty()) line += ", by " + job.worker;
  if (job.error_code) line += "\n      " + job.error_message;
  return line + "\n";
}

void show(ProgressBar& bar, const Job& job) {
  std::string note = std::to_string(job.cells_done) + " CELLs";
  if (job.scans_per_second > 0) note += format(", %.1f scans/s", job.scans_per_second);
  bar.update(job.scans_done, job.scans_total, note, job.eta_s);
}

void throw_unless_succeeded(const Job& job) {
  if (job.state == JobState::kCancelled) {
    throw Error(ErrorCode::kCancelled, "job " + std::to_string(job.id.value) +
                                           " was cancelled; whole CELLs stay in map '" + job.map +
                                           "', and the same command goes on from there");
  }
  if (job.state == JobState::kFailed) {
    throw Error(job.error_code.value_or(ErrorCode::kInternal),
                "job " + std::to_string(job.id.value) + " failed: " + job.error_message);
  }
}

}  // namespace cellmap::cli
