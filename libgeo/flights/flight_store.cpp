#include "flights/flight_store.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
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

void check_place(const LonLat& place, double radius_m) {
  const bool valid = std::abs(place.lon_deg) <= 180 && std::abs(place.lat_deg) <= 90;  // false for NaN too
  if (valid && radius_m > 0 && std::isfinite(radius_m)) return;
  throw UsageError({.what = "the fix is not a valid place",
                    .expected = "longitude, latitude and a radius above 0 m",
                    .found = fmt::format("{},{} within {} m", place.lon_deg, place.lat_deg, radius_m)});
}

bool plain_file_name(const fs::path& file) {
  return !file.empty() && file.filename() == file && file != "." && file != "..";
}

// The files of a batch: complete and synced, but without names until name_all(); those with a name lose it again unless
// the batch becomes part of the flight.
class PendingPictures {
 public:
  ~PendingPictures() {
    std::error_code ignored;
    for (const fs::path& path : named_) fs::remove(path, ignored);
  }

  void add(const fs::path& path, ByteView bytes) {
    files_.emplace_back(path, std::make_unique<PendingFile>(path, bytes));
  }
  void name_all() {
    for (auto& [path, file] : files_) {
      file->replace();  // what a killed process left under this name belongs to no batch
      named_.push_back(path);
    }
    files_.clear();  // closes them
  }
  void keep() { named_.clear(); }

 private:
  std::vector<std::pair<fs::path, std::unique_ptr<PendingFile>>> files_;
  std::vector<fs::path> named_;
};

}  // namespace

std::string_view name_of(PictureAnswer::Outcome outcome) {
  switch (outcome) {
    case PictureAnswer::Outcome::accepted: return "accepted";
    case PictureAnswer::Outcome::known: return "known";
    case PictureAnswer::Outcome::refused: return "refused";
  }
  return {};
}

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
        database(&file->sql()) {}

  // The following expect `mutex` to be held.
  template <typename Work>
  void transaction(std::string_view name, const Work& work) {
    file->transaction(name, work);
  }
  void insert_flight(const FlightDescription& flight, UtcMillis now);
  void load();
  void remove_unknown_pictures() const;
  void insert_event(const StoredFlightEvent& event, UtcMillis now);
  void insert_segment(const FlightSegment& segment);
  void insert_estimate(EstimateKind kind, const EstimateRecord& record, const AnchorReport* anchor);
  std::int64_t scalar(std::string_view sql) const;
  PictureRow picture_row(const SqliteStatement& row) const;
  PictureRow picture(std::size_t frame) const;
  std::string file_of(std::size_t frame) const;
  std::vector<UserFix> read_fixes(SqliteStatement& rows) const;

  fs::path folder;  // empty: in memory
  FlightStoreOptions options;
  std::mutex intake;         // one batch at a time; taken before `mutex`
  mutable std::mutex mutex;  // of all that follows
  std::unique_ptr<FlightDatabase> file;
  const SqliteDatabase* database;
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
  struct NewPicture {
    PictureFacts facts;
    std::string file;
    Telemetry telemetry;
  };
  std::map<std::size_t, NewPicture> added;  // by frame
  std::map<std::string, std::size_t, std::less<>> frame_of_name;
  std::map<Sha256, std::size_t> frame_of_content;
  std::optional<double> last_time_s;
  std::size_t next = 0, refusals = 0;
  std::uint64_t flight_bytes = 0;
  {
    const std::scoped_lock guard(s.mutex);
    next = s.accepted;
    if (next > 0) last_time_s = s.picture(next - 1).telemetry.time_s;
    flight_bytes = static_cast<std::uint64_t>(s.scalar("SELECT ifnull(sum(bytes), 0) FROM picture"));
    refusals = static_cast<std::size_t>(s.scalar("SELECT count(*) FROM picture WHERE state = 'refused'"));
  }
  // Frame and digest of an accepted picture, of this batch or before.
  const auto find_name = [&](std::string_view name) -> std::optional<std::pair<std::size_t, Sha256>> {
    if (const auto found = frame_of_name.find(name); found != frame_of_name.end()) {
      return std::pair(found->second, added.at(found->second).facts.sha256);
    }
    const std::scoped_lock guard(s.mutex);
    auto row = s.database->prepare("SELECT frame FROM picture WHERE name = ? AND frame IS NOT NULL");
    if (!row.bind(1, name).step()) return std::nullopt;
    const auto frame = static_cast<std::size_t>(row.integer(0));
    return std::pair(frame, s.picture(frame).sha256.value_or(Sha256{}));
  };
  const auto find_content = [&](const Sha256& sha256) -> std::optional<std::size_t> {
    if (const auto found = frame_of_content.find(sha256); found != frame_of_content.end()) return found->second;
    const std::scoped_lock guard(s.mutex);
    auto row = s.database->prepare("SELECT frame FROM picture WHERE sha256 = ? AND frame IS NOT NULL");
    if (!row.bind(1, ByteView(sha256.bytes)).step()) return std::nullopt;
    return static_cast<std::size_t>(row.integer(0));
  };

  PendingPictures files;
  std::vector<PictureAnswer> answers;
  for (const PictureOffer& offer : batch) {
    PictureAnswer& answer = answers.emplace_back();
    answer.name = offer.name;
    const auto refuse = [&answer](PictureProblem problem, std::string reason) {
      answer.outcome = PictureAnswer::Outcome::refused;
      answer.refusal = PictureRefusal{problem, std::move(reason)};
    };
    ByteView bytes = offer.bytes;
    Bytes read;
    if (offer.folder != nullptr && plain_picture_name(offer.name)) {
      try {
        const InputFile file = offer.folder->open(offer.name);
        if (file.size() > limits.picture_bytes) {
          refuse(PictureProblem::too_large,
                 fmt::format("expected at most {} bytes, found {}", limits.picture_bytes, file.size()));
          continue;
        }
        read = file.read(limits.picture_bytes);
      } catch (const Error& error) {
        refuse(PictureProblem::not_a_file, fmt::format("expected a readable file, found {}", error.text().found));
        continue;
      }
      bytes = read;
    }
    const auto checked =
        check_picture(offer.name, offer.telemetry.time_s, bytes, s.description.session.camera.camera, limits);
    if (const auto* refusal = std::get_if<PictureRefusal>(&checked)) {
      refuse(refusal->problem, refusal->reason);
      continue;
    }
    const PictureFacts& facts = std::get<PictureFacts>(checked);
    if (const auto same_name = find_name(offer.name)) {
      if (same_name->second == facts.sha256) {
        answer.outcome = PictureAnswer::Outcome::known;
        answer.frame = same_name->first;
      } else {
        refuse(PictureProblem::name_taken, fmt::format("frame {} has this name and other bytes", same_name->first));
      }
      continue;
    }
    if (const auto same_bytes = find_content(facts.sha256)) {
      refuse(PictureProblem::content_known, fmt::format("frame {} has the same bytes", *same_bytes));
      continue;
    }
    if (last_time_s && offer.telemetry.time_s <= *last_time_s) {
      refuse(PictureProblem::out_of_order,
             fmt::format("expected a time after that of the picture before, {:.3f} s, found {:.3f} s", *last_time_s,
                         offer.telemetry.time_s));
      continue;
    }
    if (next >= limits.flight_pictures ||
        facts.bytes > limits.flight_bytes - std::min(flight_bytes, limits.flight_bytes)) {
      refuse(PictureProblem::flight_full, fmt::format("expected at most {} and {} bytes in a flight",
                                                      count(limits.flight_pictures, "picture"), limits.flight_bytes));
      continue;
    }
    NewPicture picture{facts, fmt::format("{:08}.{}", next, name_of(facts.format)), offer.telemetry};
    picture.telemetry.frame = offer.name;
    files.add(s.folder / kPicturesFolder / picture.file, bytes);
    frame_of_name.emplace(offer.name, next);
    frame_of_content.emplace(facts.sha256, next);
    last_time_s = offer.telemetry.time_s;
    flight_bytes += facts.bytes;
    answer.frame = next;
    added.emplace(next++, std::move(picture));
  }

  files.name_all();
  nlohmann::json refused = nlohmann::json::array();
  for (const PictureAnswer& answer : answers) {
    if (!answer.refusal) continue;
    refused.push_back({{"name", printable(answer.name)}, {"problem", name_of(answer.refusal->problem)}});
  }
  if (added.empty() && refused.empty()) return answers;
  const std::scoped_lock guard(s.mutex);
  s.transaction("accept", [&] {
    auto insert = s.database->prepare(
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
    auto note = s.database->prepare("INSERT INTO picture (name, file, state, reason) VALUES (?, '', 'refused', ?)");
    for (const PictureAnswer& answer : answers) {
      if (!answer.refusal || refusals++ >= limits.stored_refusals) continue;
      note.bind(1, printable(answer.name.substr(0, 255))).bind(2, text_of(*answer.refusal)).run();
    }
    nlohmann::json body{{"accepted", added.size()}, {"refused", refused}};
    if (!added.empty()) body["first_frame"] = added.begin()->first;
    s.insert_event({FlightEventKind::pictures_accepted, std::nullopt, json_text(body)}, now);
  });
  files.keep();
  s.accepted = next;
  return answers;
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

std::vector<UserFix> FlightStore::Impl::read_fixes(SqliteStatement& rows) const {
  std::vector<UserFix> fixes;
  while (rows.step()) {
    fixes.push_back({.id = rows.integer(0),
                     .before_frame = static_cast<std::size_t>(rows.integer(1)),
                     .place = {.lon_deg = rows.real(3), .lat_deg = rows.real(2)},
                     .radius_m = rows.real(4),
                     .by = std::string(rows.text(5)),
                     .time = {rows.integer(6)}});
  }
  return fixes;
}

std::vector<UserFix> FlightStore::fixes_before(std::size_t frame) const {
  const std::scoped_lock guard(impl_->mutex);
  auto rows = impl_->database->prepare(
      "SELECT id, before_frame, lat_deg, lon_deg, radius_m, author, time_ms FROM fix WHERE before_frame = ? ORDER BY "
      "id");
  rows.bind(1, signed_of(frame));
  return impl_->read_fixes(rows);
}

std::vector<UserFix> FlightStore::fixes() const {
  const std::scoped_lock guard(impl_->mutex);
  auto rows = impl_->database->prepare(
      "SELECT id, before_frame, lat_deg, lon_deg, radius_m, author, time_ms FROM fix ORDER BY id");
  return impl_->read_fixes(rows);
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

UserFix FlightStore::add_fix(const LonLat& place, double radius_m, std::string_view by, UtcMillis now) {
  check_place(place, radius_m);
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  UserFix fix{.id = 0,
              .before_frame = s.begun ? *s.begun + 1 : s.processed,
              .place = place,
              .radius_m = radius_m,
              .by = printable(by.substr(0, 255)),
              .time = now};
  s.transaction("fix", [&] {
    auto insert = s.database->prepare(
        "INSERT INTO fix (before_frame, lat_deg, lon_deg, radius_m, author, time_ms) VALUES (?, ?, ?, ?, ?, ?)");
    insert.bind(1, signed_of(fix.before_frame)).bind_real(2, place.lat_deg).bind_real(3, place.lon_deg);
    insert.bind_real(4, radius_m).bind(5, fix.by).bind(6, now.unix_ms).run();
    fix.id = s.scalar("SELECT last_insert_rowid()");
    s.insert_event({FlightEventKind::user_fix, fix.before_frame,
                    json_text({{"fix", fix.id},
                               {"lat_deg", place.lat_deg},
                               {"lon_deg", place.lon_deg},
                               {"radius_m", radius_m},
                               {"by", fix.by}})},
                   now);
  });
  return fix;
}

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
