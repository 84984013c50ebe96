#include "server/jobs/ingest.hpp"

#include <mutex>

#include "cellmap/core/error.hpp"
#include "cellmap/pipeline/make_cells.hpp"
#include "cellmap/pipeline/mapper.hpp"
#include "server/jobs/redo.hpp"

namespace cellmap::server {
namespace {

/// One run: what it shares with the store, and the two ends of the pipeline. The front end works on
/// its own; only while the back end ties a CELL to the map do other writers wait.
class Ingest {
 public:
  Ingest(Maps& maps, Store& store, const std::string& map, const IngestRequest& request,
         ScanSource& source, const std::stop_token& stop, const IngestHooks& hooks,
         const std::optional<SharedJob>& shared)
      : store_(store),
        state_(maps.open(map)),
        request_(request),
        source_(source),
        stop_(stop),
        hooks_(hooks),
        shared_(shared),
        front_end_(request.options, request.session, state_->lattice()),
        back_end_(request.options, MapState::access(state_)) {
    progress_.scans_total = source.size();
  }

  void run() {
    const auto resume = find_resume_point(store_, state_->name(), request_.session);
    if (resume) {
      progress_.scans_done = resume->next_scan();
      progress_.cells_done = resume->record.sequence + std::size_t{1};
      if (hooks_.progress) hooks_.progress(progress_);
      if (source_.size() > 0 && resume->next_scan() >= source_.size()) return;
    }
    if (!go_on_after(resume)) return;
    if (shared_ && !source_.odometry().empty()) return make_cells_with_others(resume);
    const CellSink sink{[this](FinishedCell&& cell) { extend_map(std::move(cell)); },
                        [this](const PosedScan&) { count_scans(1); }};
    make_cells(source_, front_end_, works_ahead(), sink, stop_);
    throw_if_stopped(stop_);
    if (auto cell = front_end_.finish()) extend_map(std::move(*cell));
  }

 private:
  bool works_ahead() const { return request_.options.build.threads != 1; }

  void make_cells_with_others(const std::optional<ResumePoint>& resume) {
    SharedDrive drive(*shared_, request_, state_->lattice(), source_,
                      resume ? resume->next_scan() : 0, resume ? resume->cell->sequence + 1 : 0,
                      stop_);
    const CellFeed feed = [&](const HandOn& hand_on) {
      drive.make_all([&](FinishedCell&& cell) {
        count_scans(cell.cell().scan_count);
        return hand_on(std::move(cell));
      });
    };
    feed_cells(
        feed, works_ahead(), [this](FinishedCell&& cell) { extend_map(std::move(cell)); },
        [this] { source_.interrupt(); });
  }

  /// False where the drive ended before the stored part was read again.
  bool go_on_after(const std::optional<ResumePoint>& resume) {
    if (!resume) return true;
    source_.seek(resume->cell->first_scan);
    const auto base_scan = source_.next();
    if (!base_scan) return false;
    front_end_.resume_after(*resume->cell);
    back_end_.resume_after(
        resume->record.id,
        last_of_session(resume->cell, *base_scan, state_->lattice(), request_.options.filter));
    source_.seek(resume->next_scan());
    return true;
  }

  void extend_map(FinishedCell&& cell) {
    const CellForm form = request_.form ? *request_.form : store_.map(state_->name()).form;
    KeptCell kept = keep_cell({cell.target, &cell.cell()}, form);
    if (kept.coded) {
      // Constraints are those of the CELL that is kept, and of one read again after a restart.
      cell.target = std::make_shared<const RegistrationTarget>(kept.cell, state_->lattice());
    }
    {
      const std::lock_guard lock(state_->writer());
      redo_until_current(stop_, [&] { return extend(store_, *state_, back_end_, cell, kept); });
    }
    const std::lock_guard lock(progress_mutex_);
    ++progress_.cells_done;
    if (hooks_.committed) hooks_.committed(progress_);
  }

  void count_scans(std::uint64_t count) {
    const std::lock_guard lock(progress_mutex_);
    progress_.scans_done += count;
    if (hooks_.progress) hooks_.progress(progress_);
  }

  Store& store_;
  std::shared_ptr<const MapState> state_;
  const IngestRequest& request_;
  ScanSource& source_;
  const std::stop_token& stop_;
  const IngestHooks& hooks_;
  const std::optional<SharedJob>& shared_;
  FrontEnd front_end_;
  BackEnd back_end_;
  std::mutex progress_mutex_;  ///< scans are counted while CELLs are committed
  Progress progress_;
};

}  // namespace

CommitResult extend(Store& store, const MapState& state, BackEnd& back_end,
                    const FinishedCell& cell, const KeptCell& kept) {
  PoseGraph graph = *state.graph();
  const std::size_t known = graph.constraints.size();
  BackEnd extended = back_end;
  MapUpdate update = to_map_update(extended.integrate(cell, graph), kept);
  update.expected_revision = graph.revision;
  const CommitResult result = store.commit(state.name(), update);
  back_end = std::move(extended);
  for (std::size_t i = 0; i < result.constraint_ids.size(); ++i) {
    graph.constraints[known + i].id = result.constraint_ids[i];
  }
  graph.revision = result.revision;
  state.publish(std::move(graph));
  return result;
}

std::optional<ResumePoint> find_resume_point(const Store& store, const std::string& map,
                                             const std::string& session) {
  const auto record = store.last_cell(map, session);
  if (!record) return std::nullopt;
  return ResumePoint{*record, std::make_shared<const Cell>(load_cell(store, map, record->id))};
}

void run_ingest(Maps& maps, Store& store, const std::string& map, const IngestRequest& request,
                ScanSource& source, const std::stop_token& stop, const IngestHooks& hooks,
                const std::optional<SharedJob>& shared) {
  Ingest(maps, store, map, request, source, stop, hooks, shared).run();
}

}  // namespace cellmap::server
