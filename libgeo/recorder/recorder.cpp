#include "recorder/recorder.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <opencv2/imgproc.hpp>

#include "base/platform.hpp"
#include "imagery/codecs.hpp"

namespace nadir {
namespace {

constexpr int kMaxSide_px = 320, kQuality = 70;

Bytes small_jpeg(const cv::Mat& picture) {
  if (picture.empty()) return {};
  cv::Mat small = picture;
  const int side = std::max(picture.cols, picture.rows);
  if (side > kMaxSide_px) {
    const double factor = static_cast<double>(kMaxSide_px) / side;
    cv::resize(picture, small, {}, factor, factor, cv::INTER_AREA);
  }
  return encode_image(small, ImageFormat::jpeg, kQuality);
}

}  // namespace

ThumbnailRecord thumbnail_record(const ThumbnailImages& pictures) {
  return {pictures.index, pictures.frame, pictures.verdict, small_jpeg(pictures.seen), small_jpeg(pictures.map)};
}

namespace {

constexpr std::size_t kMinItem = 1024;                      // what a small record costs in memory
constexpr auto kMaxSleep = std::chrono::milliseconds(250);  // then whatever is due is written

// An error here (no memory, an image that cannot be encoded) costs a record, not the flight.
template <typename Work>
bool survive(const Work& work) {
  try {
    work();
    return true;
  } catch (const std::exception&) {
    return false;
  }
}

std::size_t bytes_of(const cv::Mat& picture) { return picture.total() * picture.elemSize(); }

std::size_t bytes_of(const Record& record) {
  const auto* picture = std::get_if<FrameRecord>(&record);
  const auto* fix_input = std::get_if<FixInputRecord>(&record);
  return kMinItem + (picture == nullptr ? 0 : picture->encoded.size()) +
         (fix_input == nullptr ? 0 : fix_input->inputs.size() * sizeof(FixInputRecord::Input));
}

}  // namespace

Topic Recorder::Item::topic() const {
  const auto* record = std::get_if<Record>(&what);
  return record == nullptr ? Topic::thumbnail : topic_of(*record);
}

Recorder::Recorder(RecorderOptions options, SessionRecord session, NanosecondClock clock)
    : options_(std::move(options)),
      clock_(std::move(clock)),
      store_(options_.store, std::move(session)),
      status_(store_.status()),
      thread_([this] { run(); }) {}

Recorder::~Recorder() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  work_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void Recorder::record(Record record) {
  const std::size_t bytes = bytes_of(record);
  push({std::move(record), clock_(), bytes});
}

void Recorder::offer_thumbnail(ThumbnailImages pictures) {
  const std::uint64_t now_ns = clock_();
  {
    const std::lock_guard lock(mutex_);
    if (last_thumbnail_ns_ && now_ns < *last_thumbnail_ns_ + options_.thumbnail_ns) return;
    last_thumbnail_ns_ = now_ns;
  }
  const std::size_t bytes = kMinItem + bytes_of(pictures.seen) + bytes_of(pictures.map);
  push({std::move(pictures), now_ns, bytes});
}

void Recorder::push(Item item) {
  {
    std::unique_lock lock(mutex_);
    if (options_.when_full == WhenFull::wait) {
      progress_.wait(lock,
                     [&] { return stopping_ || queue_.empty() || queued_bytes_ + item.bytes <= options_.queue_bytes; });
    }
    if (stopping_) return;
    if (!make_room(item)) {
      ++dropped_[item.topic()];
      return;
    }
    queued_bytes_ += item.bytes;
    queue_.push_back(std::move(item));
  }
  work_.notify_one();
}

// Under the lock. False when the item itself has to go.
bool Recorder::make_room(const Item& item) {
  if (options_.when_full == WhenFull::wait) return true;
  for (const Topic expendable : {Topic::thumbnail, Topic::picture}) {
    auto at = queue_.begin();
    while (queued_bytes_ + item.bytes > options_.queue_bytes) {
      if (item.topic() == expendable) return false;
      at = std::find_if(at, queue_.end(), [&](const Item& queued) { return queued.topic() == expendable; });
      if (at == queue_.end()) break;
      queued_bytes_ -= at->bytes;
      ++dropped_[expendable];
      at = queue_.erase(at);
    }
  }
  return queued_bytes_ + item.bytes <= options_.queue_bytes;
}

void Recorder::flush() {
  std::unique_lock lock(mutex_);
  if (stopping_) return;
  const std::uint64_t up_to = ++flush_wanted_;
  work_.notify_all();
  progress_.wait(lock, [&] { return stopping_ || flushed_ >= up_to; });
}

void Recorder::close(const std::string& reason) {
  {
    const std::lock_guard lock(mutex_);
    if (stopping_) return;
    stopping_ = true;
    closing_ = reason;
  }
  work_.notify_all();
  thread_.join();
}

StoreStatus Recorder::status() const {
  const std::lock_guard lock(mutex_);
  StoreStatus status = status_;
  for (const auto& [topic, count] : dropped_) status.dropped[topic] += count;
  return status;
}

void Recorder::run() {
  begin_thread("recorder", ThreadPriority::low);
  std::unique_lock lock(mutex_);
  while (true) {
    work_.wait_for(lock, kMaxSleep, [&] { return stopping_ || !queue_.empty() || flushed_ < flush_wanted_; });
    if (!queue_.empty()) {
      const Item item = std::move(queue_.front());
      queue_.pop_front();
      const std::size_t bytes = item.bytes;
      lock.unlock();
      write(item);
      lock.lock();
      queued_bytes_ -= bytes;
    } else if (flushed_ < flush_wanted_) {
      const std::uint64_t up_to = flush_wanted_;
      lock.unlock();
      survive([&] { store_.flush(clock_()); });
      lock.lock();
      flushed_ = up_to;
    } else if (stopping_) {
      break;
    } else {
      lock.unlock();
      survive([&] { store_.tick(clock_()); });
      lock.lock();
    }
    publish();
    progress_.notify_all();
  }
  publish();
  const std::optional<std::string> reason = closing_;
  lock.unlock();
  if (reason) survive([&] { store_.close(*reason, clock_()); });
  lock.lock();
  publish();
}

// Under the lock: passes the losses of the queue to the store and copies its status.
void Recorder::publish() {
  for (const auto& [topic, count] : std::exchange(dropped_, {})) {
    store_.count_dropped(RecorderEventKind::dropped_by_queue, topic, count);
  }
  status_ = store_.status();
}

void Recorder::write(const Item& item) {
  const bool written = survive([&] {
    if (const auto* pictures = std::get_if<ThumbnailImages>(&item.what)) {
      store_.put(thumbnail_record(*pictures), item.at_ns);
    } else {
      store_.put(std::get<Record>(item.what), item.at_ns);
    }
  });
  if (!written) store_.count_dropped(RecorderEventKind::dropped_by_queue, item.topic(), 1);
}

namespace {

bool failed(AnchorVerdict verdict) {
  return verdict != AnchorVerdict::not_tried && verdict != AnchorVerdict::accepted &&
         verdict != AnchorVerdict::awaiting_votes;
}

void record_attempt(Recorder& recorder, std::uint64_t index, std::uint64_t taken_after, const FrameReport& report) {
  AnchorRecord anchor{index, report.estimate.frame, report.estimate.time_s, report.anchor, taken_after};
  anchor.anchor.rectified.release();
  anchor.anchor.matched_map.release();
  recorder.record(std::move(anchor));
  if (!failed(report.anchor.verdict) || report.anchor.rectified.empty()) return;
  recorder.offer_thumbnail(
      {index, report.estimate.frame, report.anchor.verdict, report.anchor.rectified, report.anchor.matched_map});
}

}  // namespace

void record_frame(Recorder& recorder, std::uint64_t index, const FrameReport& report) {
  recorder.record(EstimateRecord{index, report.estimate, report.odometry, report.state});
  if (report.anchor.verdict != AnchorVerdict::not_tried) record_attempt(recorder, index, index, report);
}

void record_anchor(Recorder& recorder, std::uint64_t index, std::uint64_t taken_after, const FrameReport& report) {
  record_attempt(recorder, index, taken_after, report);
  recorder.record(EstimateRecord{taken_after, report.estimate, report.odometry, report.state});
}

void record_input(Recorder& recorder, std::uint64_t index, const Telemetry& telemetry, ByteView encoded) {
  recorder.record(InputRecord{index, telemetry, sha256(encoded), encoded.size()});
  if (!recorder.keeps_pictures()) return;
  recorder.record(FrameRecord{index, telemetry.frame, Bytes(encoded.begin(), encoded.end())});
}

}  // namespace nadir
