#include "recorder/segment_store.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "base/error.hpp"
#include "recorder/record_codec.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr std::uint64_t kSegmentsPerBudget = 8;  // so that there is something to delete
constexpr std::uint64_t kMinBudget = std::uint64_t{1} << 20;
constexpr std::size_t kMaxPendingEvents = 1000;

bool means_no_room(int error) { return error == ENOSPC || error == EDQUOT || error == EFBIG; }

int lock_folder(const fs::path& folder) {
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0)
    throw Error({.what = "cannot open the recording folder", .where = folder, .found = system_error_text(errno)});
  if (::flock(fd, LOCK_EX | LOCK_NB) == 0) return fd;
  ::close(fd);
  throw Error({.what = "another recorder is writing to this folder",
               .where = folder,
               .fix = "give each recorder its own folder"});
}

Topic topic_of_channel(std::uint16_t channel) { return static_cast<Topic>(channel - 1); }

}  // namespace

SegmentStore::SegmentStore(StoreOptions options, SessionRecord session)
    : options_(std::move(options)), session_(std::move(session)) {
  if (options_.budget_bytes < kMinBudget) {
    throw UsageError({.what = "the recording budget is too small",
                      .where = options_.folder,
                      .expected = fmt::format("at least {} bytes", kMinBudget),
                      .found = fmt::format("{} bytes", options_.budget_bytes)});
  }
  options_.segment_bytes = std::min(options_.segment_bytes, options_.budget_bytes / kSegmentsPerBudget);
  std::error_code error;
  fs::create_directories(options_.folder, error);
  if (error) {
    throw Error({.what = "cannot create the recording folder", .where = options_.folder, .found = error.message()});
  }
  folder_lock_ = lock_folder(options_.folder);
  closed_ = segments_in(options_.folder);
  if (!closed_.empty()) next_number_ = closed_.back().number + 1;
  measure();
}

SegmentStore::~SegmentStore() {
  for (const Stream stream : kStreams) finish(stream);
  ::close(folder_lock_);
}

void SegmentStore::put(const Record& record, std::uint64_t at_ns) {
  write_events(at_ns);
  write(record, at_ns);
  tick(at_ns);
}

void SegmentStore::tick(std::uint64_t now_ns) {
  for (const Stream stream : kStreams) {
    const auto open = open_.find(stream);
    if (open == open_.end() || open->second.writer->empty()) continue;
    const bool due = open->second.writer->chunk_bytes() >= options_.chunk_bytes ||
                     now_ns - open->second.chunk_since_ns >= options_.chunk_ns;
    if (due && now_ns >= open->second.next_try_ns) write_chunk(stream, now_ns);
  }
}

void SegmentStore::flush(std::uint64_t now_ns) {
  write_events(now_ns);
  for (const Stream stream : kStreams) write_chunk(stream, now_ns);
}

void SegmentStore::close(const std::string& reason, std::uint64_t now_ns) {
  flush(now_ns);
  write_events(now_ns);  // events of the flush
  std::uint64_t dropped = 0;
  for (const auto& [topic, count] : status_.dropped) dropped += count;
  write(EndRecord{.clean_shutdown = true, .records = status_.records, .dropped = dropped, .reason = reason}, now_ns);
  for (const Stream stream : {Stream::thumbnails, Stream::pictures, Stream::flight}) finish(stream);
}

void SegmentStore::count_dropped(RecorderEventKind kind, Topic topic, std::uint64_t count) {
  status_.dropped[topic] += count;
  unreported_drops_[{kind, topic}] += count;
}

// While recording is stopped, losses are only counted.
void SegmentStore::write_events(std::uint64_t now_ns) {
  if (status_.stopped || (pending_events_.empty() && unreported_drops_.empty())) return;
  const std::vector<RecorderRecord> events = std::exchange(pending_events_, {});
  const auto drops = std::exchange(unreported_drops_, {});
  for (const RecorderRecord& event : events) write(event, now_ns);
  for (const auto& [what, count] : drops) {
    write(RecorderRecord{what.first, std::string(name_of(what.second)), count, {}}, now_ns);
  }
}

void SegmentStore::write(const Record& record, std::uint64_t at_ns) {
  const Topic topic = topic_of(record);
  const Stream stream = stream_of(topic);
  if (!open_.contains(stream) && !open(stream, at_ns)) {
    count_dropped(RecorderEventKind::dropped_by_disk, topic, 1);
    return;
  }
  Open& segment = open_.at(stream);
  if (segment.writer->chunk_bytes() >= options_.waiting_bytes) drop_chunk(segment);
  if (segment.writer->empty()) segment.chunk_since_ns = at_ns;
  const Bytes payload = encode(record);
  segment.writer->write({mcap_channel(topic).id, sequence_[topic]++, at_ns, at_ns, payload});
  ++status_.records;
}

// A segment begins with a separate chunk that holds the session and the definitions that later chunks refer to.
bool SegmentStore::open(Stream stream, std::uint64_t now_ns) {
  if (now_ns < next_open_ns_[stream]) return false;
  next_open_ns_[stream] = now_ns + options_.chunk_ns;
  Open made;
  made.number = next_number_;
  made.file = std::make_unique<SegmentFile>(segment_path(options_.folder, made.number, stream), options_.sync);
  if (!made.file->ok()) {
    failed(*made.file);
    return false;
  }
  ++next_number_;
  made.writer = std::make_unique<McapWriter>(
      *made.file,
      McapWriterOptions{.profile = "nadir", .library = session_.program, .zstd_level = options_.zstd_level});
  for (std::size_t i = 0; i < kTopics; ++i) {
    const auto topic = static_cast<Topic>(i);
    if (stream_of(topic) != stream && topic != Topic::session) continue;
    made.writer->add(mcap_schema(topic));
    made.writer->add(mcap_channel(topic));
  }
  session_.segment = made.number;
  const Bytes payload = encode(Record(session_));
  made.writer->write({mcap_channel(Topic::session).id, sequence_[Topic::session]++, now_ns, now_ns, payload});
  made.since_ns = made.chunk_since_ns = now_ns;
  open_.insert_or_assign(stream, std::move(made));
  write_chunk(stream, now_ns);
  if (open_.contains(stream) && open_.at(stream).file->size() != 0) {
    next_open_ns_[stream] = 0;
    return true;
  }
  leave(stream, false);  // not even that was written: remove the empty file
  return false;
}

void SegmentStore::write_chunk(Stream stream, std::uint64_t now_ns) {
  const auto found = open_.find(stream);
  if (found == open_.end()) return;
  Open& segment = found->second;
  while (!segment.writer->flush()) {
    failed(*segment.file);
    if (means_no_room(segment.file->error()) && make_room(stream)) continue;
    segment.next_try_ns = now_ns + options_.chunk_ns;
    return;
  }
  if (status_.stopped) {
    status_.stopped = false;
    status_.error.clear();
    if (pending_events_.size() < kMaxPendingEvents) pending_events_.push_back({RecorderEventKind::resumed, {}, 0, {}});
  }
  if (segment.file->size() >= options_.segment_bytes || now_ns - segment.since_ns >= options_.segment_ns)
    finish(stream);
  keep_budget();
  measure();
}

void SegmentStore::measure() {
  status_.bytes = folder_bytes();
  std::error_code unknown;
  const std::filesystem::space_info disk = std::filesystem::space(options_.folder, unknown);
  status_.free_bytes = unknown ? 0 : disk.available;
}

void SegmentStore::finish(Stream stream) {
  const auto found = open_.find(stream);
  if (found == open_.end()) return;
  if (!found->second.writer->finish()) drop_chunk(found->second);
  leave(stream, found->second.file->size() != 0);
}

void SegmentStore::leave(Stream stream, bool keep) {
  const auto found = open_.find(stream);
  if (found == open_.end()) return;
  const Open& segment = found->second;
  if (keep) {
    closed_.push_back({segment.file->path(), segment.number, stream, segment.file->size()});
    ++status_.segments;
  } else {
    std::error_code ignored;
    fs::remove(segment.file->path(), ignored);
  }
  open_.erase(found);
}

// Deletes only what is more expendable than this stream.
bool SegmentStore::make_room(Stream stream) {
  if (stream == Stream::thumbnails) return false;
  const Stream up_to = stream == Stream::flight ? Stream::pictures : Stream::thumbnails;
  auto segment = most_expendable(closed_, up_to);
  if (segment == closed_.end()) {
    for (const Stream other : {Stream::thumbnails, Stream::pictures}) {
      const auto open = open_.find(other);
      if (other <= stream || open == open_.end()) continue;
      drop_chunk(open->second);
      leave(other, true);
      segment = most_expendable(closed_, up_to);
      break;
    }
  }
  if (segment == closed_.end()) return false;
  remove(segment);
  return true;
}

void SegmentStore::keep_budget() {
  while (folder_bytes() > options_.budget_bytes) {
    const auto segment = most_expendable(closed_, Stream::flight);
    if (segment == closed_.end()) return;
    remove(segment);
  }
}

void SegmentStore::remove(std::vector<Segment>::const_iterator segment) {
  std::error_code ignored;
  fs::remove(segment->path, ignored);  // if it cannot be deleted, it is not counted any more either: no endless loop
  ++status_.deleted_segments;
  if (pending_events_.size() < kMaxPendingEvents) {
    pending_events_.push_back(
        {RecorderEventKind::segment_deleted, {}, segment->bytes, segment->path.filename().string()});
  }
  closed_.erase(segment);
}

void SegmentStore::failed(const SegmentFile& file) {
  status_.error = fmt::format("{}: {}", file.path().filename().string(), system_error_text(file.error()));
  if (status_.stopped) return;
  status_.stopped = true;
  if (pending_events_.size() < kMaxPendingEvents)
    pending_events_.push_back({RecorderEventKind::stopped, {}, 0, status_.error});
}

void SegmentStore::drop_chunk(Open& open) {
  for (const auto& [channel, count] : open.writer->drop_chunk()) {
    count_dropped(RecorderEventKind::dropped_by_disk, topic_of_channel(channel), count);
    status_.records -= count;
  }
}

std::uint64_t SegmentStore::folder_bytes() const {
  std::uint64_t bytes = 0;
  for (const Segment& segment : closed_) bytes += segment.bytes;
  for (const auto& [stream, open] : open_) bytes += open.file->size();
  return bytes;
}

}  // namespace nadir
