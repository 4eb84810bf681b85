#include "candidates/catalogue_thread.hpp"

namespace nadir {

CatalogueThread::CatalogueThread(CatalogueLocation location, CandidateCatalogue::Access access)
    : location_(std::move(location)), access_(access), thread_([this](const std::stop_token& stop) { run(stop); }) {
  call([](CandidateCatalogue&) {});
}

CatalogueThread::~CatalogueThread() = default;

void CatalogueThread::enqueue(Job job) {
  const std::lock_guard lock(mutex_);
  jobs_.push_back(std::move(job));
  news_.notify_one();
}

void CatalogueThread::run(const std::stop_token& stop) {
  std::optional<CandidateCatalogue> catalogue;  // belongs to this thread: GDAL's messages do
  for (;;) {
    std::unique_lock lock(mutex_);
    if (!news_.wait(lock, stop, [this] { return !jobs_.empty(); })) return;
    const Job job = std::move(jobs_.front());
    jobs_.pop_front();
    lock.unlock();
    std::exception_ptr failure;
    try {
      if (!catalogue) catalogue.emplace(location_, access_);
    } catch (...) {
      failure = std::current_exception();
    }
    if (!job(catalogue ? &*catalogue : nullptr, failure)) catalogue.reset();
  }
}

}  // namespace nadir
