#include "server/metrics.hpp"

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include <functional>
#include <map>
#include <mutex>
#include <sstream>
#include <tuple>

#include "server/process_figures.hpp"

namespace cellmap::server {
namespace {

using prometheus::Counter;
using prometheus::Family;
using prometheus::Gauge;

const prometheus::Histogram::BucketBoundaries kLatencyBuckets_s{
    0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30};

/// Made anew for every reading, of values that were read a moment ago.
class Reading {
 public:
  void gauge(const std::string& name, const std::string& help, double value,
             const prometheus::Labels& labels = {}) {
    prometheus::BuildGauge().Name(name).Help(help).Register(registry_).Add(labels).Set(value);
  }
  void counter(const std::string& name, const std::string& help, double value) {
    prometheus::BuildCounter().Name(name).Help(help).Register(registry_).Add({}).Increment(value);
  }
  std::vector<prometheus::MetricFamily> collect() const { return registry_.Collect(); }

 private:
  prometheus::Registry registry_{prometheus::Registry::InsertBehavior::Merge};
};

// Names as Prometheus' own client libraries have them.
void add_process(Reading& reading) {
  const ProcessFigures process = read_process_figures();
  reading.counter("process_cpu_seconds_total", "Processor time of user and system", process.cpu_s);
  reading.gauge("process_resident_memory_bytes", "Resident memory", process.resident_bytes);
  reading.gauge("process_virtual_memory_bytes", "Virtual memory", process.virtual_bytes);
  reading.gauge("process_open_fds", "Open file descriptors", process.open_descriptors);
  reading.gauge("process_max_fds", "Most file descriptors allowed", process.max_descriptors);
  reading.gauge("process_threads", "Threads", process.threads);
  reading.gauge("process_start_time_seconds", "Start of the process, Unix time",
                process.start_unix_s);
}

double number(auto value) { return static_cast<double>(value); }

void add_store(Reading& reading, const StoreCounts& store) {
  reading.gauge("cellmap_maps", "Maps in the store", number(store.maps));
  reading.gauge("cellmap_cells", "CELLs in all maps", number(store.cells));
  reading.gauge("cellmap_scans", "Scans of all CELLs", number(store.scans));
  reading.gauge("cellmap_cell_bytes", "Bytes of CELLs as stored", number(store.cell_bytes));
  reading.gauge("cellmap_jobs", "Unfinished jobs by state", number(store.queued_jobs),
                {{"state", "queued"}});
  reading.gauge("cellmap_jobs", "Unfinished jobs by state", number(store.running_jobs),
                {{"state", "running"}});
}

void add_snapshot(Reading& reading, const MetricsSnapshot& snapshot) {
  reading.gauge("cellmap_build_info", "1, with the version of this server", 1,
                {{"version", CELLMAP_VERSION}});
  reading.gauge("cellmap_store_up", "1 where the store answers, else 0", snapshot.store ? 1 : 0);
  if (snapshot.store) add_store(reading, *snapshot.store);
  reading.gauge("cellmap_store_bytes", "Bytes of the store's files", number(snapshot.store_bytes));
  reading.gauge("cellmap_place_bytes", "Memory for what relocalisation knows of CELLs",
                number(snapshot.place_bytes));
  reading.gauge("cellmap_tokens", "Tokens that the server knows", number(snapshot.tokens));
}

}  // namespace

struct Metrics::Impl {
  Family<Counter>& counters(const char* name, const char* help) {
    return prometheus::BuildCounter().Name(name).Help(help).Register(registry);
  }

  /// What is counted for every request of a route. They stay where they are.
  struct Series {
    Counter* requests;
    prometheus::Histogram* latency;
  };
  using SeriesKey = std::tuple<std::string_view, std::string_view, int>;
  struct BySeriesKey {
    using is_transparent = void;
    bool operator()(const SeriesKey& a, const SeriesKey& b) const { return a < b; }
  };
  /// Kept beside the families, which make labels and a series anew to find the one that is there.
  Series series_of(std::string_view route, std::string_view method, int status) {
    const std::lock_guard lock(mutex);
    const auto found = series.find(SeriesKey(route, method, status));
    if (found != series.end()) return found->second;
    const Series made{&requests.Add({{"route", std::string(route)},
                                     {"method", std::string(method)},
                                     {"code", std::to_string(status)}}),
                      &latency.Add({{"route", std::string(route)}, {"method", std::string(method)}},
                                   kLatencyBuckets_s)};
    series.emplace(std::tuple(route, method, status), made);
    return made;
  }

  std::mutex mutex;  ///< of `series`
  std::map<std::tuple<std::string, std::string, int>, Series, BySeriesKey> series;
  prometheus::Registry registry;
  Family<Counter>& requests = counters("http_requests_total", "Requests answered");
  Family<prometheus::Histogram>& latency =
      prometheus::BuildHistogram()
          .Name("http_request_duration_seconds")
          .Help("Time from the whole request to the response, without sending it")
          .Register(registry);
  Counter& bytes_out =
      counters("http_response_bytes_total", "Bytes of response bodies, without streams").Add({});
  Family<Counter>& relocalisations =
      counters("cellmap_relocalisations_total", "Relocalisations by outcome");
  Family<Counter>& place_servers =
      counters("cellmap_place_searches_total",
               "Searches of regions by other servers, by server and outcome");
  Counter& regions_taken_over =
      counters("cellmap_place_regions_taken_over_total",
               "Regions that were searched here because their server did not")
          .Add({});
  Counter& cells =
      counters("cellmap_cells_committed_total", "CELLs that jobs and clients added").Add({});
  Counter& parts =
      counters("cellmap_parts_made_total", "Parts of drives made for other workers").Add({});
  Family<Counter>& jobs = counters("cellmap_jobs_ended_total", "Jobs by final state");
  Counter& audit_failures =
      counters("cellmap_audit_failures_total", "Writes that the audit log could not be told")
          .Add({});
  Family<Counter>& reloads =
      counters("cellmap_token_reloads_total", "Readings of the token file, by result");
  Gauge& followers = prometheus::BuildGauge()
                         .Name("cellmap_event_followers")
                         .Help("Clients that follow jobs or maps now")
                         .Register(registry)
                         .Add({});
};

Metrics::Metrics() : impl_(std::make_unique<Impl>()) {}
Metrics::~Metrics() = default;

void Metrics::request(std::string_view route, std::string_view method, int status, double seconds,
                      std::size_t bytes_out) {
  const Impl::Series series = impl_->series_of(route, method, status);
  series.requests->Increment();
  series.latency->Observe(seconds);
  impl_->bytes_out.Increment(static_cast<double>(bytes_out));
}

void Metrics::relocalisation(bool found) {
  impl_->relocalisations.Add({{"outcome", found ? "found" : "not_found"}}).Increment();
}

void Metrics::place_server_asked(const std::string& server, const std::string& outcome) {
  impl_->place_servers.Add({{"server", server}, {"outcome", outcome}}).Increment();
}

void Metrics::place_regions_taken_over(std::size_t count) {
  impl_->regions_taken_over.Increment(static_cast<double>(count));
}

void Metrics::cells_committed(std::size_t count) {
  impl_->cells.Increment(static_cast<double>(count));
}

void Metrics::part_made() { impl_->parts.Increment(); }

void Metrics::job_ended(const std::string& state) {
  impl_->jobs.Add({{"state", state}}).Increment();
}

void Metrics::set_followers(int count) { impl_->followers.Set(count); }

void Metrics::audit_failed() { impl_->audit_failures.Increment(); }

void Metrics::tokens_reloaded(bool good) {
  impl_->reloads.Add({{"result", good ? "good" : "bad"}}).Increment();
}

std::string Metrics::text(const MetricsSnapshot& snapshot) const {
  Reading reading;
  add_snapshot(reading, snapshot);
  add_process(reading);
  auto families = impl_->registry.Collect();
  for (auto& family : reading.collect()) families.push_back(std::move(family));
  std::ostringstream text;
  prometheus::TextSerializer().Serialize(text, families);
  return text.str();
}

}  // namespace cellmap::server
