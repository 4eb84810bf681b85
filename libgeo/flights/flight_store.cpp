#include "flights/flight_store.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/plural.hpp"
#include "base/printable.hpp"
#include "imagery/sqlite_database.hpp"
#include "recorder/record_codec.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse_damaged(const fs::path& where, std::string found) {
  throw Error({.what = "the stored flight is damaged",
               .where = where.string(),
               .expected = "rows as they were stored",
               .found = std::move(found),
               .fix = "get the flight from a backup, or process its pictures again"});
}

std::string json_text(const nlohmann::json& body) {
  return body.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

Bytes session_bytes(SessionRecord session) {
  session.id.clear();
  session.segment = 0;
  session.started_ns = 0;
  return encode(Record(std::move(session)));
}

std::string text_of(const PictureRefusal& refusal) {
  return fmt::format("{}: {}", name_of(refusal.problem), refusal.reason);
}

// Of the event pictures_accepted.
std::string accepted_text(const std::map<std::size_t, NewPicture>& added, std::span<const PictureAnswer> answers) {
  nlohmann::json refused = nlohmann::json::array();
  for (const PictureAnswer& answer : answers) {
    if (!answer.refusal) continue;
    refused.push_back({{"name", printable(answer.name)}, {"problem", name_of(answer.refusal->problem)}});
  }
  nlohmann::json body{{"accepted", added.size()}, {"refused", refused}};
  if (!added.empty()) body["first_frame"] = added.begin()->first;
  return json_text(body);
}

bool plain_file_name(const fs::path& file) {
  return !file.empty() && file.filename() == file && file != "." && file != "..";
}

}  // namespace

std::string_view name_of(PictureState state) {
  switch (state) {
    case PictureState::accepted: return "accepted";
    case PictureState::processed: return "processed";
    case PictureState::refused: return "refused";
  }
  return {};
}

std::string_view name_of(EstimateKind kind) {
  switch (kind) {
    case EstimateKind::online: return "online";
    case EstimateKind::refined: return "refined";
    case EstimateKind::adjusted: return "adjusted";
  }
  return {};
}

bool same_flight(const FlightDescription& one, const FlightDescription& other) {
  return session_bytes(one.session) == session_bytes(other.session);
}

struct FlightStore::Impl {
  Impl(fs::path flight_folder, FlightStoreOptions store_options, std::unique_ptr<FlightDatabase> flight_database)
      : folder(std::move(flight_folder)),
        options(std::move(store_options)),
        file(std::move(flight_database)),
        database(&file->sql()),
        annotations(*database) {}

  // The following expect `mutex` to be held.
  template <typename Work>
  void transaction(std::string_view name, const Work& work) {
    file->transaction(name, work);
  }
  void insert_flight(const FlightDescription& flight, UtcMillis now);
  void load();
  void remove_unknown_pictures() const;
  void insert_pictures(const std::map<std::size_t, NewPicture>& added);
  void insert_refusals(std::span<const PictureAnswer> answers);
  void insert_event(const StoredFlightEvent& event, UtcMillis now);
  void insert_segment(const FlightSegment& segment);
  void insert_estimate(EstimateKind kind, const EstimateRecord& record, const AnchorReport* anchor);
  std::int64_t scalar(std::string_view sql) const;
  PictureRow picture_row(const SqliteStatement& row) const;
  PictureRow picture(std::size_t frame) const;
  std::string file_of(std::size_t frame) const;
  void insert_object_event(std::int64_t object, UtcMillis now);
  // What is said now is for the frame after the one that is being processed.
  std::size_t next_frame() const { return begun ? *begun + 1 : processed; }

  StoredPictures stored_pictures() const;  // expects only `intake` to be held

  fs::path folder;  // empty: in memory
  FlightStoreOptions options;
  std::mutex intake;         // one batch at a time; taken before `mutex`
  mutable std::mutex mutex;  // of all that follows
  std::unique_ptr<FlightDatabase> file;
  const SqliteDatabase* database;
  FlightAnnotations annotations;
  FlightDescription description;
  std::optional<fs::path> outside;  // where the pictures lie that are not kept here
  std::size_t accepted = 0, processed = 0;
  std::optional<std::size_t> begun;
};

namespace {

constexpr const char* kPictureColumns =
    "SELECT frame, name, state, reason, sha256, bytes, width, height, telemetry FROM picture";

// Frame numbers and sizes are never so large that this loses anything.
std::int64_t signed_of(std::uint64_t number) { return static_cast<std::int64_t>(number); }

}  // namespace

// ---- Opening

FlightStore::FlightStore(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
FlightStore::~FlightStore() = default;

bool FlightStore::exists(const fs::path& folder) { return FlightDatabase::exists(folder); }

std::unique_ptr<FlightStore> FlightStore::create(const fs::path& folder, const FlightDescription& description,
                                                 UtcMillis now, const FlightStoreOptions& options) {
  std::error_code code;
  fs::create_directories(folder / kPicturesFolder, code);
  if (code) {
    throw Error({.what = "cannot create the flight",
                 .where = folder.string(),
                 .found = code.message(),
                 .fix = "check the owner of the folder above it, and its disk"});
  }
  auto file = std::make_unique<FlightDatabase>(folder, FlightDatabase::Access::create, options.sync, options.hook);
  auto impl = std::make_unique<Impl>(folder, options, std::move(file));
  impl->insert_flight(description, now);
  sync_to_disk(folder);
  impl->load();
  return std::unique_ptr<FlightStore>(new FlightStore(std::move(impl)));
}

std::unique_ptr<FlightStore> FlightStore::open(const fs::path& folder, const FlightStoreOptions& options) {
  auto file = std::make_unique<FlightDatabase>(folder, FlightDatabase::Access::open, options.sync, options.hook);
  auto impl = std::make_unique<Impl>(folder, options, std::move(file));
  impl->load();
  impl->remove_unknown_pictures();
  return std::unique_ptr<FlightStore>(new FlightStore(std::move(impl)));
}

std::unique_ptr<FlightStore> FlightStore::in_memory(const FlightDescription& description, UtcMillis now) {
  auto impl = std::make_unique<Impl>(fs::path(), FlightStoreOptions{}, std::make_unique<FlightDatabase>());
  impl->insert_flight(description, now);
  impl->load();
  return std::unique_ptr<FlightStore>(new FlightStore(std::move(impl)));
}

// With the tables, in one transaction: a kill leaves an empty file, in which the flight can be created again.
void FlightStore::Impl::insert_flight(const FlightDescription& flight, UtcMillis now) {
  transaction("create", [&] {
    file->create_tables();
    const Bytes session = encode(Record(flight.session));
    const std::optional<LonLat>& start = flight.session.start;
    auto insert = database->prepare(
        "INSERT INTO flight (id, name, package, camera, start_lat_deg, start_lon_deg, created_ms, session) "
        "VALUES (1, ?, ?, ?, ?, ?, ?, ?)");
    insert.bind(1, flight.name).bind(2, flight.package).bind(3, flight.camera_text);
    insert.bind_real(4, start ? std::optional(start->lat_deg) : std::nullopt);
    insert.bind_real(5, start ? std::optional(start->lon_deg) : std::nullopt);
    insert.bind(6, now.unix_ms).bind(7, ByteView(session)).run();
    insert_event({FlightEventKind::flight_created, std::nullopt, json_text({{"name", flight.name}})}, now);
  });
}

void FlightStore::Impl::load() {
  auto row = database->prepare("SELECT name, package, camera, outside, session FROM flight");
  if (!row.step()) refuse_damaged(database->path(), "no row in the table flight");
  description.name = row.text(0);
  description.package = row.text(1);
  description.camera_text = row.text(2);
  if (!row.is_null(3) && !options.outside) {
    throw UsageError({.what = "the pictures of this flight lie outside of it",
                      .where = folder.string(),
                      .expected = "the folder of the pictures",
                      .found = printable(row.text(3)),
                      .fix = "say where they are"});
  }
  if (!row.is_null(3)) outside = fs::absolute(*options.outside);
  const auto record = decode(Topic::session, row.blob(4));
  if (!record) refuse_damaged(database->path(), "a session that cannot be read");
  description.session = std::get<SessionRecord>(*record);
  accepted = static_cast<std::size_t>(scalar("SELECT count(*) FROM picture WHERE frame IS NOT NULL"));
  processed = static_cast<std::size_t>(scalar("SELECT count(*) FROM picture WHERE state = 'processed'"));
  const std::int64_t last = scalar("SELECT ifnull(max(frame), -1) FROM picture");
  const std::int64_t done = scalar("SELECT ifnull(max(frame), -1) FROM picture WHERE state = 'processed'");
  if (last + 1 != signed_of(accepted) || done + 1 != signed_of(processed)) {
    refuse_damaged(database->path(), "frames that do not count from 0 without gaps");
  }
}

// Of a batch that was being stored when its process died.
void FlightStore::Impl::remove_unknown_pictures() const {
  std::error_code code;
  fs::create_directories(folder / kPicturesFolder, code);
  std::set<std::string> known;
  auto rows = database->prepare("SELECT file FROM picture WHERE frame IS NOT NULL");
  while (rows.step()) known.insert(std::string(rows.text(0)));
  for (const auto& entry : fs::directory_iterator(folder / kPicturesFolder)) {
    if (!known.contains(entry.path().filename().string())) fs::remove(entry.path(), code);
  }
}

std::int64_t FlightStore::Impl::scalar(std::string_view sql) const {
  auto statement = database->prepare(sql);
  return statement.step() ? statement.integer(0) : 0;
}

const FlightDescription& FlightStore::description() const { return impl_->description; }

// ---- Pictures

std::vector<PictureAnswer> FlightStore::accept(std::span<const PictureOffer> batch, UtcMillis now) {
  Impl& s = *impl_;
  const PictureLimits& limits = s.options.limits;
  if (batch.size() > limits.batch_pictures) {
    throw UsageError({.what = "the batch is too large",
                      .expected = fmt::format("at most {}", count(limits.batch_pictures, "picture")),
                      .found = count(batch.size(), "picture"),
                      .fix = "send it in parts"});
  }
  const std::scoped_lock one_batch(s.intake);
  if (s.folder.empty() || s.outside) {
    throw UsageError({.what = "the pictures of this flight lie outside of it",
                      .where = s.outside ? s.outside->string() : std::string(),
                      .fix = "create another flight for further pictures"});
  }
  PictureIntake intake(s.stored_pictures(), s.description.session.camera.camera, limits, s.folder / kPicturesFolder);
  std::vector<PictureAnswer> answers;
  for (const PictureOffer& offer : batch) answers.push_back(intake.judge(offer));
  intake.name_files();
  const bool any_refused =
      std::any_of(answers.begin(), answers.end(), [](const auto& answer) { return answer.refusal; });
  if (intake.added().empty() && !any_refused) return answers;
  const std::scoped_lock guard(s.mutex);
  s.transaction("accept", [&] {
    s.insert_pictures(intake.added());
    s.insert_refusals(answers);
    s.insert_event({FlightEventKind::pictures_accepted, std::nullopt, accepted_text(intake.added(), answers)}, now);
  });
  intake.keep_files();
  s.accepted += intake.added().size();
  return answers;
}

StoredPictures FlightStore::Impl::stored_pictures() const {
  StoredPictures stored;
  stored.of_name = [this](std::string_view name) -> std::optional<StoredPictures::Named> {
    const std::scoped_lock guard(mutex);
    auto row = database->prepare("SELECT frame FROM picture WHERE name = ? AND frame IS NOT NULL");
    if (!row.bind(1, name).step()) return std::nullopt;
    const auto frame = static_cast<std::size_t>(row.integer(0));
    return StoredPictures::Named{frame, picture(frame).sha256.value_or(Sha256{})};
  };
  stored.of_content = [this](const Sha256& content) -> std::optional<std::size_t> {
    const std::scoped_lock guard(mutex);
    auto row = database->prepare("SELECT frame FROM picture WHERE sha256 = ? AND frame IS NOT NULL");
    if (!row.bind(1, ByteView(content.bytes)).step()) return std::nullopt;
    return static_cast<std::size_t>(row.integer(0));
  };
  const std::scoped_lock guard(mutex);
  stored.frames = accepted;
  if (accepted > 0) stored.last_time_s = picture(accepted - 1).telemetry.time_s;
  stored.bytes = static_cast<std::uint64_t>(scalar("SELECT ifnull(sum(bytes), 0) FROM picture"));
  return stored;
}

void FlightStore::Impl::insert_pictures(const std::map<std::size_t, NewPicture>& added) {
  auto insert = database->prepare(
      "INSERT INTO picture (frame, name, file, sha256, bytes, width, height, time_s, telemetry, state, reason) "
      "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, 'accepted', '')");
  for (const auto& [frame, picture] : added) {
    const PictureFacts& facts = picture.facts;
    const Bytes telemetry = encode(Record(InputRecord{frame, picture.telemetry, facts.sha256, facts.bytes}));
    insert.bind(1, signed_of(frame)).bind(2, picture.telemetry.frame).bind(3, picture.file);
    insert.bind(4, ByteView(facts.sha256.bytes)).bind(5, signed_of(facts.bytes));
    insert.bind(6, std::int64_t{facts.width}).bind(7, std::int64_t{facts.height});
    insert.bind_real(8, picture.telemetry.time_s).bind(9, ByteView(telemetry)).run();
  }
}

void FlightStore::Impl::insert_refusals(std::span<const PictureAnswer> answers) {
  auto stored = static_cast<std::size_t>(scalar("SELECT count(*) FROM picture WHERE state = 'refused'"));
  auto insert = database->prepare("INSERT INTO picture (name, file, state, reason) VALUES (?, '', 'refused', ?)");
  for (const PictureAnswer& answer : answers) {
    if (!answer.refusal || stored++ >= options.limits.stored_refusals) continue;
    insert.bind(1, printable(answer.name.substr(0, 255))).bind(2, text_of(*answer.refusal)).run();
  }
}

void FlightStore::refer(const fs::path& folder, std::span<const Telemetry> frames, std::span<const std::string> files,
                        UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock one_batch(s.intake);
  const std::scoped_lock guard(s.mutex);
  if (s.accepted != 0) {
    throw UsageError({.what = "the flight has pictures already",
                      .where = s.folder.string(),
                      .expected = "a flight without pictures",
                      .found = count(s.accepted, "picture")});
  }
  const fs::path absolute = fs::absolute(folder);
  s.transaction("refer", [&] {
    s.database->prepare("UPDATE flight SET outside = ?").bind(1, absolute.string()).run();
    auto insert = s.database->prepare(
        "INSERT INTO picture (frame, name, file, time_s, telemetry, state, reason) "
        "VALUES (?, ?, ?, ?, ?, 'accepted', '')");
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const Bytes telemetry = encode(Record(InputRecord{i, frames[i], Sha256{}, 0}));
      insert.bind(1, signed_of(i)).bind(2, frames[i].frame).bind(3, files.empty() ? frames[i].frame : files[i]);
      insert.bind_real(4, frames[i].time_s).bind(5, ByteView(telemetry)).run();
    }
    s.insert_event({FlightEventKind::pictures_accepted, std::nullopt,
                    json_text({{"accepted", frames.size()}, {"refused", nlohmann::json::array()}, {"first_frame", 0}})},
                   now);
  });
  s.outside = absolute;
  s.accepted = frames.size();
}

std::size_t FlightStore::accepted() const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->accepted;
}

std::size_t FlightStore::processed() const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->processed;
}

PictureRow FlightStore::Impl::picture_row(const SqliteStatement& row) const {
  PictureRow picture;
  if (!row.is_null(0)) picture.frame = static_cast<std::size_t>(row.integer(0));
  picture.name = row.text(1);
  for (const PictureState state : {PictureState::accepted, PictureState::processed, PictureState::refused}) {
    if (row.text(2) == name_of(state)) picture.state = state;
  }
  picture.reason = row.text(3);
  if (const ByteView digest = row.blob(4); digest.size() == picture.sha256.emplace().bytes.size()) {
    std::copy(digest.begin(), digest.end(), picture.sha256->bytes.begin());
  } else {
    picture.sha256.reset();
  }
  picture.bytes = static_cast<std::uint64_t>(row.integer(5));
  picture.width = static_cast<int>(row.integer(6));
  picture.height = static_cast<int>(row.integer(7));
  if (!picture.frame) return picture;
  const auto input = decode(Topic::input, row.blob(8));
  if (!input) refuse_damaged(database->path(), fmt::format("frame {} without its telemetry", *picture.frame));
  picture.telemetry = std::get<InputRecord>(*input).telemetry;
  return picture;
}

PictureRow FlightStore::Impl::picture(std::size_t frame) const {
  auto row = database->prepare(fmt::format("{} WHERE frame = ?", kPictureColumns));
  if (!row.bind(1, signed_of(frame)).step()) refuse_damaged(database->path(), fmt::format("no frame {}", frame));
  return picture_row(row);
}

std::string FlightStore::Impl::file_of(std::size_t frame) const {
  auto row = database->prepare("SELECT file FROM picture WHERE frame = ?");
  if (!row.bind(1, signed_of(frame)).step()) refuse_damaged(database->path(), fmt::format("no frame {}", frame));
  return std::string(row.text(0));
}

PictureRow FlightStore::picture(std::size_t frame) const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->picture(frame);
}

std::vector<PictureRow> FlightStore::refused() const {
  const std::scoped_lock guard(impl_->mutex);
  std::vector<PictureRow> refused;
  auto rows = impl_->database->prepare(fmt::format("{} WHERE frame IS NULL ORDER BY id", kPictureColumns));
  while (rows.step()) refused.push_back(impl_->picture_row(rows));
  return refused;
}

Bytes FlightStore::read_picture(std::size_t frame) const {
  PictureRow picture;
  std::string file;
  std::optional<fs::path> outside;
  {
    const std::scoped_lock guard(impl_->mutex);
    picture = impl_->picture(frame);
    file = impl_->file_of(frame);
    outside = impl_->outside;
  }
  if (outside) {
    if (!plain_file_name(file))
      refuse_damaged(impl_->database->path(), fmt::format("a path as the file of frame {}", frame));
    Bytes bytes;
    try {
      bytes = read_file(*outside / file);
    } catch (const Error&) {
    }
    if (picture.state != PictureState::processed || bytes.size() == picture.bytes) return bytes;
    throw Error({.what = fmt::format("the picture of frame {} is not the one that was processed", frame),
                 .where = (*outside / file).string(),
                 .expected = fmt::format("{} bytes", picture.bytes),
                 .found = fmt::format("{} bytes", bytes.size()),
                 .fix = "restore the picture, or process the flight from the start"});
  }
  const Directory pictures(impl_->folder / kPicturesFolder);
  Bytes bytes = pictures.open(file).read(picture.bytes);
  if (sha256(bytes) == picture.sha256) return bytes;
  throw Error({.what = fmt::format("the picture of frame {} is not the one that was accepted", frame),
               .where = (impl_->folder / kPicturesFolder / file).string(),
               .expected = "SHA-256 " + picture.sha256.value_or(Sha256{}).hex(),
               .found = sha256(bytes).hex(),
               .fix = "restore the picture from a backup"});
}

// ---- Processing

std::vector<UserFix> FlightStore::fixes_before(std::size_t frame) const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->annotations.fixes_before(frame);
}

std::vector<UserFix> FlightStore::fixes() const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->annotations.fixes();
}

std::optional<BegunFrame> FlightStore::begin_frame() {
  BegunFrame begun;
  {
    const std::scoped_lock guard(impl_->mutex);
    if (impl_->begun || impl_->processed == impl_->accepted) return std::nullopt;
    begun.frame = impl_->processed;
    begun.telemetry = impl_->picture(begun.frame).telemetry;
    impl_->begun = begun.frame;
  }
  begun.fixes = fixes_before(begun.frame);
  return begun;
}

void FlightStore::abandon_frame() {
  const std::scoped_lock guard(impl_->mutex);
  impl_->begun.reset();
}

void FlightStore::Impl::insert_event(const StoredFlightEvent& event, UtcMillis now) {
  auto insert = database->prepare("INSERT INTO event (time_ms, kind, frame, body) VALUES (?, ?, ?, ?)");
  insert.bind(1, now.unix_ms).bind(2, name_of(event.kind));
  if (event.frame) {
    insert.bind(3, signed_of(*event.frame));
  } else {
    insert.bind_null(3);
  }
  insert.bind(4, event.body).run();
}

void FlightStore::Impl::insert_segment(const FlightSegment& segment) {
  auto insert = database->prepare(
      "INSERT OR REPLACE INTO segment (segment, first_frame, last_frame, state, anchored_frame) "
      "VALUES (?, ?, ?, ?, ?)");
  insert.bind(1, std::int64_t{segment.number}).bind(2, signed_of(segment.first_frame));
  insert.bind(3, signed_of(segment.last_frame)).bind(4, name_of(segment.state));
  if (segment.anchored_frame) {
    insert.bind(5, signed_of(*segment.anchored_frame));
  } else {
    insert.bind_null(5);
  }
  insert.run();
}

void FlightStore::Impl::insert_estimate(EstimateKind kind, const EstimateRecord& record, const AnchorReport* anchor) {
  const Estimate& estimate = record.estimate;
  const Bytes bytes = encode(Record(record));
  Bytes anchor_bytes;
  auto insert = database->prepare(
      "INSERT INTO estimate (frame, kind, lat_deg, lon_deg, sigma_m, cov_ee_m2, cov_en_m2, cov_nn_m2, hpl_m, source, "
      "segment, verdict, latency_ms, record, anchor) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  insert.bind(1, signed_of(record.index)).bind(2, name_of(kind));
  if (estimate.position) {
    insert.bind_real(3, estimate.position->lat_deg).bind_real(4, estimate.position->lon_deg);
    insert.bind_real(5, estimate.sigma_m).bind_real(6, estimate.covariance_m2(0, 0));
    insert.bind_real(7, estimate.covariance_m2(0, 1)).bind_real(8, estimate.covariance_m2(1, 1));
  }
  insert.bind_real(9, estimate.hpl_m).bind(10, name_of(estimate.source)).bind(11, std::int64_t{estimate.segment});
  insert.bind(12, name_of(anchor != nullptr ? anchor->verdict : AnchorVerdict::not_tried));
  insert.bind_real(13, estimate.latency_ms).bind(14, ByteView(bytes));
  if (anchor != nullptr) {
    anchor_bytes = encode(Record(AnchorRecord{record.index, estimate.frame, estimate.time_s, *anchor, record.index}));
    insert.bind(15, ByteView(anchor_bytes));
  }
  insert.run();
}

void FlightStore::put_frame(const ProcessedFrame& frame, UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  if (s.begun != frame.frame) {
    throw Error({.what = "a frame is stored that was not begun",
                 .expected = s.begun ? fmt::format("frame {}", *s.begun) : "none",
                 .found = fmt::format("frame {}", frame.frame)});
  }
  s.transaction("frame", [&] {
    auto update =
        s.database->prepare("UPDATE picture SET state = 'processed', bytes = coalesce(?, bytes) WHERE frame = ?");
    if (frame.picture_bytes) update.bind(1, signed_of(*frame.picture_bytes));
    update.bind(2, signed_of(frame.frame)).run();
    s.database->prepare("INSERT INTO measurement (frame, answers) VALUES (?, ?)")
        .bind(1, signed_of(frame.frame))
        .bind(2, ByteView(frame.answers))
        .run();
    if (!frame.seen.empty() || !frame.map.empty()) {
      s.database->prepare("INSERT INTO look (frame, seen, map) VALUES (?, ?, ?)")
          .bind(1, signed_of(frame.frame))
          .bind(2, ByteView(frame.seen))
          .bind(3, ByteView(frame.map))
          .run();
    }
    s.insert_estimate(EstimateKind::online, frame.online, &frame.anchor);
    for (const FlightSegment& segment : frame.segments) s.insert_segment(segment);
    for (const StoredFlightEvent& event : frame.events) s.insert_event(event, now);
  });
  s.begun.reset();
  s.processed = frame.frame + 1;
}

StoredFrame FlightStore::stored_frame(std::size_t frame) const {
  const Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  auto row = s.database->prepare(
      "SELECT e.record, m.answers, l.seen, l.map FROM estimate e JOIN measurement m ON m.frame = e.frame "
      "LEFT JOIN look l ON l.frame = e.frame WHERE e.frame = ? AND e.kind = 'online'");
  if (!row.bind(1, signed_of(frame)).step()) {
    refuse_damaged(s.database->path(), fmt::format("no results of frame {}", frame));
  }
  const auto record = decode(Topic::estimate, row.blob(0));
  if (!record) refuse_damaged(s.database->path(), fmt::format("no readable estimate of frame {}", frame));
  const auto bytes = [&row](int column) {
    const ByteView blob = row.blob(column);
    return Bytes(blob.begin(), blob.end());
  };
  return {std::get<EstimateRecord>(*record), bytes(1), bytes(2), bytes(3)};
}

AnchorReport FlightStore::look_of(std::size_t frame) const {
  const std::scoped_lock guard(impl_->mutex);
  auto row = impl_->database->prepare("SELECT anchor FROM estimate WHERE frame = ? AND kind = 'online'");
  const bool found = row.bind(1, signed_of(frame)).step();
  const auto record = found ? decode(Topic::anchor, row.blob(0)) : std::nullopt;
  if (!record) refuse_damaged(impl_->database->path(), fmt::format("no readable look of frame {}", frame));
  return std::get<AnchorRecord>(*record).anchor;
}

// ---- What people say

UserFix FlightStore::add_fix(UserFix said, UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  said.before_frame = s.next_frame();
  said.by = printable(said.by.substr(0, 255));
  said.time = now;
  s.transaction("fix", [&] {
    said.id = s.annotations.insert_fix(said);
    nlohmann::json body{{"fix", said.id},
                        {"lat_deg", said.place.lat_deg},
                        {"lon_deg", said.place.lon_deg},
                        {"radius_m", said.radius_m},
                        {"by", said.by}};
    if (said.frame) body["of_frame"] = *said.frame;
    s.insert_event({FlightEventKind::user_fix, said.before_frame, json_text(body)}, now);
  });
  return said;
}

UserFix FlightStore::add_fix(const LonLat& place, double radius_m, std::string_view by, UtcMillis now) {
  UserFix said;
  said.place = place;
  said.radius_m = radius_m;
  said.sigma_m = radius_m / kHintRadiusSigmas;
  said.hint = {place, radius_m};
  said.by = by;
  return add_fix(std::move(said), now);
}

std::optional<UserFix> FlightStore::withdraw_fix(std::int64_t id, UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  s.transaction("withdraw", [&] {
    if (!s.annotations.withdraw_fix(id, s.next_frame(), now)) return;
    s.insert_event({FlightEventKind::fix_withdrawn, std::nullopt, json_text({{"fix", id}})}, now);
  });
  for (UserFix& fix : s.annotations.fixes()) {
    if (fix.id == id) return std::move(fix);
  }
  return std::nullopt;
}

void FlightStore::Impl::insert_object_event(std::int64_t object, UtcMillis now) {
  insert_event({FlightEventKind::objects_changed, std::nullopt, json_text({{"object", object}})}, now);
}

MarkedObject FlightStore::add_object(std::string_view name, const MarkedSighting& first, std::string_view by,
                                     UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  MarkedObject object{.id = 0,
                      .name = printable(name.substr(0, kMaxObjectName)),
                      .by = printable(by.substr(0, 255)),
                      .time = now,
                      .sightings = {first}};
  s.transaction("object", [&] {
    object.id = s.annotations.insert_object(object);
    s.insert_object_event(object.id, now);
  });
  return s.annotations.object(object.id).value_or(std::move(object));
}

std::optional<MarkedObject> FlightStore::add_sighting(std::int64_t object, const MarkedSighting& sighting,
                                                      UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  if (!s.annotations.object(object)) return std::nullopt;
  s.transaction("sighting", [&] {
    s.annotations.insert_sighting(object, sighting);
    s.insert_object_event(object, now);
  });
  return s.annotations.object(object);
}

std::optional<MarkedObject> FlightStore::rename_object(std::int64_t id, std::string_view name, UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  s.transaction("rename", [&] {
    if (s.annotations.rename_object(id, printable(name.substr(0, kMaxObjectName)))) s.insert_object_event(id, now);
  });
  return s.annotations.object(id);
}

bool FlightStore::remove_object(std::int64_t id, UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  bool removed = false;
  s.transaction("remove", [&] {
    removed = s.annotations.remove_object(id);
    if (removed) s.insert_object_event(id, now);
  });
  return removed;
}

bool FlightStore::remove_sighting(std::int64_t object, std::int64_t sighting, UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  bool removed = false;
  s.transaction("remove", [&] {
    removed = s.annotations.remove_sighting(object, sighting);
    if (removed) s.insert_object_event(object, now);
  });
  return removed;
}

std::vector<MarkedObject> FlightStore::objects() const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->annotations.objects();
}

std::optional<MarkedObject> FlightStore::object(std::int64_t id) const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->annotations.object(id);
}

// ---- Estimates after the fact

void FlightStore::put_estimates(EstimateKind kind, std::span<const Estimate> estimates,
                                std::span<const StoredFlightEvent> events, UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  if (kind == EstimateKind::online || estimates.size() > s.processed) {
    throw Error({.what = "estimates are stored that belong to no processed frames",
                 .expected = fmt::format("refined or adjusted ones of at most {}", count(s.processed, "frame")),
                 .found = fmt::format("{} of {}", name_of(kind), count(estimates.size(), "frame"))});
  }
  s.transaction("estimates", [&] {
    s.database->prepare("DELETE FROM estimate WHERE kind = ?").bind(1, name_of(kind)).run();
    for (std::size_t i = 0; i < estimates.size(); ++i) s.insert_estimate(kind, {i, estimates[i], {}, {}}, nullptr);
    for (const StoredFlightEvent& event : events) s.insert_event(event, now);
  });
}

void FlightStore::append_event(const StoredFlightEvent& event, UtcMillis now) {
  const std::scoped_lock guard(impl_->mutex);
  impl_->transaction("event", [&] { impl_->insert_event(event, now); });
}

// ---- Reading

std::vector<Estimate> FlightStore::estimates(EstimateKind kind, std::size_t first, std::size_t most) const {
  const std::scoped_lock guard(impl_->mutex);
  std::vector<Estimate> estimates;
  auto rows =
      impl_->database->prepare("SELECT record FROM estimate WHERE kind = ? AND frame >= ? ORDER BY frame LIMIT ?");
  rows.bind(1, name_of(kind)).bind(2, signed_of(std::min(first, std::size_t{INT32_MAX})));
  rows.bind(3, signed_of(std::min(most, std::size_t{INT32_MAX})));
  while (rows.step()) {
    const auto record = decode(Topic::estimate, rows.blob(0));
    if (!record) refuse_damaged(impl_->database->path(), "an estimate that cannot be read");
    estimates.push_back(std::get<EstimateRecord>(*record).estimate);
  }
  return estimates;
}

std::vector<FlightSegment> FlightStore::segments() const {
  const std::scoped_lock guard(impl_->mutex);
  std::vector<FlightSegment> segments;
  auto rows = impl_->database->prepare(
      "SELECT segment, first_frame, last_frame, state, anchored_frame FROM segment ORDER BY segment");
  while (rows.step()) {
    FlightSegment& segment = segments.emplace_back();
    segment.number = static_cast<int>(rows.integer(0));
    segment.first_frame = static_cast<std::size_t>(rows.integer(1));
    segment.last_frame = static_cast<std::size_t>(rows.integer(2));
    for (const SegmentState state : {SegmentState::floating, SegmentState::anchored, SegmentState::merged}) {
      if (rows.text(3) == name_of(state)) segment.state = state;
    }
    if (!rows.is_null(4)) segment.anchored_frame = static_cast<std::size_t>(rows.integer(4));
  }
  return segments;
}

std::int64_t FlightStore::last_event() const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->scalar("SELECT ifnull(max(id), 0) FROM event");
}

std::vector<EventRow> FlightStore::events_after(std::int64_t id, std::size_t most) const {
  const std::scoped_lock guard(impl_->mutex);
  std::vector<EventRow> events;
  auto rows =
      impl_->database->prepare("SELECT id, time_ms, kind, frame, body FROM event WHERE id > ? ORDER BY id LIMIT ?");
  rows.bind(1, id).bind(2, signed_of(most));
  while (rows.step()) {
    const auto kind = parse_flight_event(rows.text(2));
    if (!kind) refuse_damaged(impl_->database->path(), "an unknown event");
    EventRow& row = events.emplace_back();
    row.id = rows.integer(0);
    row.time = {rows.integer(1)};
    row.event.kind = *kind;
    if (!rows.is_null(3)) row.event.frame = static_cast<std::size_t>(rows.integer(3));
    row.event.body = rows.text(4);
  }
  return events;
}

}  // namespace nadir
