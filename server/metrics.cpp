#include "server/metrics.hpp"

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include <sstream>

namespace cellmap::server {
namespace {

const prometheus::Histogram::BucketBoundaries kLatencyBuckets_s{
    0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30};

}  // namespace

struct Metrics::Impl {
  prometheus::Registry registry;
  prometheus::Family<prometheus::Counter>& requests = prometheus::BuildCounter()
                                                          .Name("cellmap_http_requests_total")
                                                          .Help("Requests answered")
                                                          .Register(registry);
  prometheus::Family<prometheus::Histogram>& latency =
      prometheus::BuildHistogram()
          .Name("cellmap_http_request_duration_seconds")
          .Help("Time from the whole request to the response, without sending it")
          .Register(registry);
  prometheus::Counter& bytes_out = prometheus::BuildCounter()
                                       .Name("cellmap_http_response_bytes_total")
                                       .Help("Bytes of response bodies, without streams")
                                       .Register(registry)
                                       .Add({});
  prometheus::Family<prometheus::Counter>& relocalisations =
      prometheus::BuildCounter()
          .Name("cellmap_relocalisations_total")
          .Help("Relocalisations by outcome")
          .Register(registry);
  prometheus::Counter& cells = prometheus::BuildCounter()
                                   .Name("cellmap_cells_committed_total")
                                   .Help("CELLs that jobs and clients added")
                                   .Register(registry)
                                   .Add({});
  prometheus::Family<prometheus::Counter>& jobs = prometheus::BuildCounter()
                                                      .Name("cellmap_jobs_ended_total")
                                                      .Help("Jobs by final state")
                                                      .Register(registry);
  prometheus::Gauge& running_jobs = prometheus::BuildGauge()
                                        .Name("cellmap_jobs_running")
                                        .Help("Jobs that run now")
                                        .Register(registry)
                                        .Add({});
  prometheus::Gauge& followers = prometheus::BuildGauge()
                                     .Name("cellmap_event_followers")
                                     .Help("Clients that follow jobs now")
                                     .Register(registry)
                                     .Add({});
};

Metrics::Metrics() : impl_(std::make_unique<Impl>()) {}
Metrics::~Metrics() = default;

void Metrics::request(const std::string& route, const std::string& method, int status,
                      double seconds, std::size_t bytes_out) {
  impl_->requests.Add({{"route", route}, {"method", method}, {"status", std::to_string(status)}})
      .Increment();
  impl_->latency.Add({{"route", route}}, kLatencyBuckets_s).Observe(seconds);
  impl_->bytes_out.Increment(static_cast<double>(bytes_out));
}

void Metrics::relocalisation(bool found) {
  impl_->relocalisations.Add({{"outcome", found ? "found" : "not_found"}}).Increment();
}

void Metrics::cells_committed(std::size_t count) {
  impl_->cells.Increment(static_cast<double>(count));
}

void Metrics::job_ended(const std::string& state) {
  impl_->jobs.Add({{"state", state}}).Increment();
}

void Metrics::set_running_jobs(int count) { impl_->running_jobs.Set(count); }
void Metrics::set_followers(int count) { impl_->followers.Set(count); }

std::string Metrics::text() const {
  std::ostringstream text;
  prometheus::TextSerializer().Serialize(text, impl_->registry.Collect());
  return text.str();
}

}  // namespace cellmap::server
