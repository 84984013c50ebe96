#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/command_line.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/job_text.hpp"
#include "client/cli/map_reader.hpp"

namespace cellmap::cli {
namespace {

struct JobsArguments {
  Place place;
  std::string map;
  std::uint32_t job = 0;
};

void list_jobs(const JobsArguments& options, const Console& console) {
  client::Json json = client::Json::array();
  std::string text;
  for (const Job& job : connect(options.place).jobs(options.map)) {
    json.push_back(client::to_json(job));
    text += job_line(job);
  }
  console.print({{"jobs", json}}, text.empty() ? "No jobs.\n" : text);
}

void print(const Job& job, const Console& console) {
  console.print(client::to_json(job), job_line(job));
}

void show_one(const JobsArguments& options, const Console& console) {
  print(connect(options.place).job(JobId{options.job}), console);
}

void cancel(const JobsArguments& options, const Console& console) {
  print(connect(options.place).cancel_job(JobId{options.job}), console);
}

void follow_job(const JobsArguments& options, const Console& console) {
  const Interrupt interrupt;
  Client client = connect(options.place);
  Job job;
  {
    ProgressBar bar(console, "job " + std::to_string(options.job));
    job = client.follow_job(
        JobId{options.job}, [&](const Job& latest) { show(bar, latest); }, interrupt.token());
  }
  throw_unless_succeeded(job);
  print(job, console);
}

}  // namespace

void add_jobs(CLI::App& app, Verbs& verbs) {
  CLI::App* group = app.add_subcommand("jobs", "List, show, follow and cancel jobs of a server");
  group->require_subcommand(1);
  const auto on_job = [&](const char* name, const char* description, const char* example,
                          void (*action)(const JobsArguments&, const Console&)) {
    const auto options = std::make_shared<JobsArguments>();
    CLI::App* verb = verbs.add(*group, name, description, example,
                               [options, action](const Console& c) { action(*options, c); });
    verb->add_option("JOB", options->job, "Number of the job")->required();
    add_place_options(*verb, options->place, false);
  };
  const auto listed = std::make_shared<JobsArguments>();
  CLI::App* all = verbs.add(*group, "list", "The jobs of a map, oldest first",
                            "  cellmap jobs list town --server http://127.0.0.1:8080\n",
                            [listed](const Console& console) { list_jobs(*listed, console); });
  all->add_option("MAP", listed->map, "Name of the map")->required();
  add_place_options(*all, listed->place, false);
  on_job("show", "How far a job is", "  cellmap jobs show 1 --server URL\n", show_one);
  on_job("follow", "Wait for a job with a progress bar; its failure is the exit code",
         "  cellmap jobs follow 1 --server URL\n", follow_job);
  on_job("cancel", "Cancel a job; whole CELLs stay in the map",
         "  cellmap jobs cancel 1 --server URL\n", cancel);
}

}  // namespace cellmap::cli
