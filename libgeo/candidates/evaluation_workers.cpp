#include "candidates/evaluation_workers.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <map>

namespace nadir {
namespace {

constexpr auto kLookAgain = std::chrono::seconds(1);  // for what other processes have brought, or left undone
constexpr std::int64_t kVotes = -1, kPending = -2;    // beside the ids of uploads

// Clients in turn after the last one, each with its uploads.
std::vector<std::vector<std::int64_t>> in_turn(const std::vector<std::pair<std::string, std::int64_t>>& pending,
                                               const std::string& last_client) {
  std::map<std::string, std::vector<std::int64_t>> uploads;
  for (const auto& [client, upload] : pending) uploads[client].push_back(upload);
  std::vector<std::vector<std::int64_t>> turns;
  for (auto at = uploads.upper_bound(last_client); at != uploads.end(); ++at) turns.push_back(at->second);
  for (auto at = uploads.begin(); at != uploads.upper_bound(last_client); ++at) turns.push_back(at->second);
  return turns;
}

}  // namespace

EvaluationWorkers::EvaluationWorkers(TileEvaluation& evaluation, const CatalogueLocation& location,
                                     CatalogueThread* shared, int workers)
    : evaluation_(evaluation) {
  const bool server = location.kind == CatalogueLocation::Kind::postgres;
  std::vector<CatalogueThread*> catalogues;
  for (int i = 0; i < workers; ++i) {
    catalogues.push_back(server ? &connections_.emplace_back(location, CandidateCatalogue::Access::write) : shared);
  }
  for (CatalogueThread* catalogue : catalogues) {  // once all of them are open
    Worker& worker = workers_.emplace_back(Worker{.catalogue = catalogue});
    worker.thread = std::jthread([this, &worker](const std::stop_token& stop) { run(worker, stop); });
  }
}

void EvaluationWorkers::stop() {
  for (Worker& worker : workers_) worker.thread.request_stop();
  workers_.clear();
}

bool EvaluationWorkers::idle() const {
  const std::lock_guard lock(mutex_);
  return std::ranges::all_of(workers_, &Worker::idle);
}

void EvaluationWorkers::run(Worker& worker, const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    std::uint64_t seen = 0;
    {
      const std::lock_guard lock(mutex_);
      seen = wakes_;
    }
    const auto begun = std::chrono::steady_clock::now();
    const bool judged = evaluate(worker, stop), voted = vote(worker);
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begun;
    std::unique_lock lock(mutex_);
    worker.idle = !judged && !voted;
    if (!worker.idle) {
      counts_.busy_s += taken.count();
      continue;
    }
    news_.wait_for(lock, stop, kLookAgain, [this, seen] { return wakes_ != seen; });
  }
}

// One piece of one upload: whether there was any.
bool EvaluationWorkers::evaluate(Worker& worker, const std::stop_token& stop) {
  std::vector<std::pair<std::string, std::int64_t>> pending;
  attempt(kPending, [&] {
    pending = evaluation_.pending(*worker.catalogue);
    return TileEvaluation::Piece();
  });
  for (const std::vector<std::int64_t>& turn : in_turn(pending, worker.last_client)) {
    for (const std::int64_t upload : turn) {
      if (stop.stop_requested()) return false;
      const auto piece = attempt(upload, [&] { return evaluation_.evaluate_some(*worker.catalogue, upload); });
      if (!piece || (piece->tiles == 0 && !piece->finished)) continue;  // others have its last tiles
      const auto client = std::ranges::find(pending, upload, &std::pair<std::string, std::int64_t>::second);
      worker.last_client = client->first;
      return true;
    }
  }
  return false;
}

bool EvaluationWorkers::vote(Worker& worker) {
  const auto piece = attempt(kVotes, [&] { return evaluation_.vote_some(*worker.catalogue); });
  return piece && piece->addresses > 0;
}

// Nothing: it failed, now or since the last retry().
template <typename Work>
std::optional<TileEvaluation::Piece> EvaluationWorkers::attempt(std::int64_t what, const Work& work) {
  if (resting(what)) return std::nullopt;
  try {
    const TileEvaluation::Piece piece = work();
    const std::lock_guard lock(mutex_);
    counts_.tiles += piece.tiles, counts_.addresses += piece.addresses, counts_.promoted += piece.promoted;
    return piece;
  } catch (const std::exception& error) {
    const std::lock_guard lock(mutex_);
    fault_ = error.what();
    resting_.insert(what);
    ++counts_.failures;
    return std::nullopt;
  }
}

bool EvaluationWorkers::resting(std::int64_t what) const {
  const std::lock_guard lock(mutex_);
  return resting_.contains(what);
}

void EvaluationWorkers::wake() {
  const std::lock_guard lock(mutex_);
  ++wakes_;
  news_.notify_all();
}

std::string EvaluationWorkers::fault() const {
  const std::lock_guard lock(mutex_);
  return fault_;
}

void EvaluationWorkers::retry() {
  const std::lock_guard lock(mutex_);
  if (resting_.empty()) return;
  fault_.clear();
  resting_.clear();
  ++wakes_;
  news_.notify_all();
}

WorkerCounts EvaluationWorkers::counts() const {
  const std::lock_guard lock(mutex_);
  WorkerCounts counts = counts_;
  for (const CatalogueThread& connection : connections_) counts.catalogue_s += connection.waited_s();
  return counts;
}

}  // namespace nadir
