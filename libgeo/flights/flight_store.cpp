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

namespace nadir {
namespace {

namespace fs = std::filesystem;

std::string json_text(const nlohmann::json& body) {
  return body.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
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

}  // namespace

struct FlightStore::Impl {
  Impl(fs::path flight_folder, FlightStoreOptions store_options, std::unique_ptr<FlightDatabase> flight_database)
      : folder(std::move(flight_folder)),
        options(std::move(store_options)),
        file(std::move(flight_database)),
        rows(file->sql()),
        poses(file->sql()),
        annotations(file->sql()) {}

  // The following expect `mutex` to be held.
  template <typename Work>
  void transaction(std::string_view name, const Work& work) {
    file->transaction(name, work);
  }
  void create_flight(const FlightDescription& flight, UtcMillis now);
  void load();
  void remove_unknown_pictures() const;
  void insert_object_event(std::int64_t object, UtcMillis now);
  void require_processed(EstimateKind kind, std::size_t estimates) const;
  void release(FlightSegment merged, const nlohmann::json& why, std::optional<std::size_t> frame, UtcMillis now);
  // What is said now is for the frame after the one that is being processed.
  std::size_t next_frame() const { return begun ? *begun + 1 : processed; }

  StoredPictures stored_pictures() const;  // expects only `intake` to be held

  fs::path folder;  // empty: in memory
  FlightStoreOptions options;
  std::mutex intake;         // one batch at a time; taken before `mutex`
  mutable std::mutex mutex;  // of all that follows
  std::unique_ptr<FlightDatabase> file;
  FlightRows rows;
  PoseRows poses;
  FlightAnnotations annotations;
  FlightDescription description;
  std::optional<fs::path> outside;  // where the pictures lie that are not kept here
  std::size_t accepted = 0, processed = 0;
  std::optional<std::size_t> begun;
};

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
  impl->create_flight(description, now);
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
  impl->create_flight(description, now);
  impl->load();
  return std::unique_ptr<FlightStore>(new FlightStore(std::move(impl)));
}

// With the tables, in one transaction: a kill leaves an empty file, in which the flight can be created again.
void FlightStore::Impl::create_flight(const FlightDescription& flight, UtcMillis now) {
  transaction("create", [&] {
    file->create_tables();
    rows.insert_flight(flight, now);
    rows.insert_event({FlightEventKind::flight_created, std::nullopt, json_text({{"name", flight.name}})}, now);
  });
}

void FlightStore::Impl::load() {
  FlightRows::Flight flight = rows.flight();
  if (!flight.outside.empty() && !options.outside) {
    throw UsageError({.what = "the pictures of this flight lie outside of it",
                      .where = folder.string(),
                      .expected = "the folder of the pictures",
                      .found = printable(flight.outside),
                      .fix = "say where they are"});
  }
  if (!flight.outside.empty()) outside = fs::absolute(*options.outside);
  description = std::move(flight.description);
  accepted = flight.accepted;
  processed = flight.processed;
}

// Of a batch that was being stored when its process died.
void FlightStore::Impl::remove_unknown_pictures() const {
  std::error_code code;
  fs::create_directories(folder / kPicturesFolder, code);
  const std::set<std::string> known = rows.kept_files();
  for (const auto& entry : fs::directory_iterator(folder / kPicturesFolder)) {
    if (!known.contains(entry.path().filename().string())) fs::remove(entry.path(), code);
  }
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
    s.rows.insert_pictures(intake.added());
    s.rows.insert_refusals(answers, limits.stored_refusals);
    s.rows.insert_event({FlightEventKind::pictures_accepted, std::nullopt, accepted_text(intake.added(), answers)},
                        now);
  });
  intake.keep_files();
  s.accepted += intake.added().size();
  return answers;
}

StoredPictures FlightStore::Impl::stored_pictures() const {
  StoredPictures stored;
  stored.of_name = [this](std::string_view name) -> std::optional<StoredPictures::Named> {
    const std::scoped_lock guard(mutex);
    const std::optional<std::size_t> frame = rows.frame_named(name);
    if (!frame) return std::nullopt;
    return StoredPictures::Named{*frame, rows.picture(*frame).sha256.value_or(Sha256{})};
  };
  stored.of_content = [this](const Sha256& content) {
    const std::scoped_lock guard(mutex);
    return rows.frame_with(content);
  };
  const std::scoped_lock guard(mutex);
  stored.frames = accepted;
  if (accepted > 0) stored.last_time_s = rows.picture(accepted - 1).telemetry.time_s;
  stored.bytes = rows.picture_bytes();
  return stored;
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
    s.rows.set_outside(absolute);
    s.rows.insert_outside_pictures(frames, files);
    s.rows.insert_event(
        {FlightEventKind::pictures_accepted, std::nullopt,
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

PictureRow FlightStore::picture(std::size_t frame) const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->rows.picture(frame);
}

std::vector<PictureRow> FlightStore::refused() const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->rows.refused();
}

Bytes FlightStore::read_picture(std::size_t frame) const {
  PictureRow picture;
  std::string file;
  std::optional<fs::path> outside;
  {
    const std::scoped_lock guard(impl_->mutex);
    picture = impl_->rows.picture(frame);
    file = impl_->rows.file_of(frame);
    outside = impl_->outside;
  }
  if (outside) {
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
    begun.telemetry = impl_->rows.picture(begun.frame).telemetry;
    impl_->begun = begun.frame;
  }
  begun.fixes = fixes_before(begun.frame);
  return begun;
}

void FlightStore::abandon_frame() {
  const std::scoped_lock guard(impl_->mutex);
  impl_->begun.reset();
}

void FlightStore::put_frame(const ProcessedFrame& frame, UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  if (s.begun != frame.frame) {
    throw Error({.what = "a frame is stored that was not begun",
                 .expected = s.begun ? fmt::format("frame {}", *s.begun) : "none",
                 .found = fmt::format("frame {}", frame.frame)});
  }
  s.transaction("frame", [&] { s.rows.insert_frame(frame, now); });
  s.begun.reset();
  s.processed = frame.frame + 1;
}

StoredFrame FlightStore::stored_frame(std::size_t frame) const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->rows.stored_frame(frame);
}

AnchorReport FlightStore::look_of(std::size_t frame) const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->rows.look_of(frame);
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
    s.rows.insert_event({FlightEventKind::user_fix, said.before_frame, json_text(body)}, now);
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
    s.rows.insert_event({FlightEventKind::fix_withdrawn, std::nullopt, json_text({{"fix", id}})}, now);
  });
  for (UserFix& fix : s.annotations.fixes()) {
    if (fix.id == id) return std::move(fix);
  }
  return std::nullopt;
}

void FlightStore::Impl::insert_object_event(std::int64_t object, UtcMillis now) {
  rows.insert_event({FlightEventKind::objects_changed, std::nullopt, json_text({{"object", object}})}, now);
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

void FlightStore::Impl::require_processed(EstimateKind kind, std::size_t estimates) const {
  if (kind != EstimateKind::online && kind != EstimateKind::placed && estimates <= processed) return;
  throw Error({.what = "estimates are stored that belong to no processed frames",
               .expected = fmt::format("refined or adjusted ones of at most {}", count(processed, "frame")),
               .found = fmt::format("{} of {}", name_of(kind), count(estimates, "frame"))});
}

void FlightStore::put_adjustment(std::span<const Estimate> estimates, const AdjustedPoses& poses,
                                 std::span<const StoredFlightEvent> events, UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  s.require_processed(EstimateKind::adjusted, estimates.size());
  s.transaction("estimates", [&] {
    s.rows.replace_estimates(EstimateKind::adjusted, estimates);
    s.poses.replace(poses);
    for (const StoredFlightEvent& event : events) s.rows.insert_event(event, now);
  });
}

void FlightStore::put_estimates(EstimateKind kind, std::span<const Estimate> estimates,
                                std::span<const StoredFlightEvent> events, UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  s.require_processed(kind, estimates.size());
  s.transaction("estimates", [&] {
    s.rows.replace_estimates(kind, estimates);
    if (kind == EstimateKind::adjusted) s.poses.remove_all();
    for (const StoredFlightEvent& event : events) s.rows.insert_event(event, now);
  });
}

void FlightStore::append_event(const StoredFlightEvent& event, UtcMillis now) {
  const std::scoped_lock guard(impl_->mutex);
  impl_->transaction("event", [&] { impl_->rows.insert_event(event, now); });
}

void FlightStore::append_event_once(const StoredFlightEvent& event, UtcMillis now) {
  const std::scoped_lock guard(impl_->mutex);
  impl_->transaction("event", [&] {
    if (!impl_->rows.has_event(event)) impl_->rows.insert_event(event, now);
  });
}

bool FlightStore::merge_segment(const FlightSegment& floating, std::span<const EstimateRecord> placed,
                                const StoredFlightEvent& event, UtcMillis now, std::span<const int> basis) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  const auto segments = s.rows.segments();
  const auto holds = [&](int number) {
    return std::any_of(segments.begin(), segments.end(), [&](const FlightSegment& segment) {
      return segment.number == number && segment.state != SegmentState::floating;
    });
  };
  if (std::find(segments.begin(), segments.end(), floating) == segments.end() ||
      floating.state != SegmentState::floating || !std::all_of(basis.begin(), basis.end(), holds) ||
      s.rows.has_event(FlightEventKind::merge_withdrawn, floating.first_frame)) {
    return false;
  }
  FlightSegment merged = floating;
  merged.state = SegmentState::merged;
  s.transaction("merge", [&] {
    s.rows.insert_merged_segment(merged, placed, basis);
    s.rows.insert_event(event, now);
  });
  return true;
}

// It floats again, and where the flight was adjusted with it, its frames are where they are without the placement.
void FlightStore::Impl::release(FlightSegment merged, const nlohmann::json& why, std::optional<std::size_t> frame,
                                UtcMillis now) {
  merged.state = SegmentState::floating;
  rows.insert_segment(merged);
  for (std::size_t i = merged.first_frame; i <= merged.last_frame && i < processed; ++i) {
    const auto adjusted = rows.estimates(EstimateKind::adjusted, i, 1);
    const auto refined = rows.estimates(EstimateKind::refined, i, 1);
    if (adjusted.empty() || refined.empty() || refined.front().segment != merged.number) continue;
    rows.replace_estimate(EstimateKind::adjusted, i, refined.front());
    poses.remove(i);
  }
  rows.insert_event({FlightEventKind::merge_withdrawn, frame, json_text(why)}, now);
}

bool FlightStore::take_back_merge(int segment, std::string_view by, UtcMillis now) {
  Impl& s = *impl_;
  const std::scoped_lock guard(s.mutex);
  const std::vector<FlightSegment> segments = s.rows.segments();
  const auto merged_one = [&](int number) {
    return std::find_if(segments.begin(), segments.end(), [&](const FlightSegment& each) {
      return each.number == number && each.state == SegmentState::merged;
    });
  };
  const auto taken = merged_one(segment);
  if (taken == segments.end()) return false;
  s.transaction("release", [&] {
    std::vector<int> left = s.rows.merged_on(segment);
    s.release(*taken, {{"segment", segment}, {"by", printable(by.substr(0, 255))}}, taken->first_frame, now);
    std::set<int> done{segment};
    while (!left.empty()) {
      const int number = left.back();
      left.pop_back();
      const auto dependent = merged_one(number);
      if (dependent == segments.end() || !done.insert(number).second) continue;
      const std::vector<int> further = s.rows.merged_on(number);
      left.insert(left.end(), further.begin(), further.end());
      s.release(*dependent, {{"segment", number}, {"placed_by", segment}}, std::nullopt, now);
    }
  });
  return true;
}

std::optional<EstimateRecord> FlightStore::placed_estimate(std::size_t frame) const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->rows.placed_estimate(frame);
}

std::optional<AdjustedPose> FlightStore::adjusted_pose(std::size_t frame) const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->poses.pose(frame);
}

std::optional<Eigen::MatrixXd> FlightStore::adjusted_joint_covariance(const std::vector<std::size_t>& frames) const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->poses.joint_covariance(frames);
}

std::optional<AdjustedLens> FlightStore::adjusted_lens() const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->poses.lens();
}

bool FlightStore::merge_taken_back(const FlightSegment& segment) const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->rows.has_event(FlightEventKind::merge_withdrawn, segment.first_frame);
}

std::vector<EstimateRecord> FlightStore::placed_estimates() const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->rows.placed_estimates();
}

// ---- Reading

std::vector<Estimate> FlightStore::estimates(EstimateKind kind, std::size_t first, std::size_t most) const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->rows.estimates(kind, first, most);
}

std::vector<FlightSegment> FlightStore::segments() const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->rows.segments();
}

std::int64_t FlightStore::last_event() const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->rows.last_event();
}

std::vector<EventRow> FlightStore::events_after(std::int64_t id, std::size_t most) const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->rows.events_after(id, most);
}

std::vector<EventRow> FlightStore::events_of(FlightEventKind kind) const {
  const std::scoped_lock guard(impl_->mutex);
  return impl_->rows.events_of(kind);
}

}  // namespace nadir
