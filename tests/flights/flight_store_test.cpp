// A flight's store: batches, what is refused, what survives.
#include "flights/flight_store.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <ctime>
#include <fstream>
#include <set>
#include <sstream>
#include <thread>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/random.hpp"
#include "flights/stored_flight.hpp"
#include "imagery/codecs.hpp"
#include "imagery/sqlite_database.hpp"
#include "support/process.hpp"
#include "support/small_disk.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using namespace test;
using Outcome = PictureAnswer::Outcome;
namespace fs = std::filesystem;

class StoredPictures : public testing::Test {
 protected:
  std::unique_ptr<FlightStore> create(const FlightStoreOptions& options = {}) const {
    return FlightStore::create(folder(), description(Course::smooth), kNow, options);
  }
  fs::path folder() const { return temporary_ / "flight"; }
  std::size_t files() const {
    std::size_t count = 0;
    for ([[maybe_unused]] const auto& entry : fs::directory_iterator(folder() / kPicturesFolder)) ++count;
    return count;
  }

  // The answer to one picture.
  static PictureAnswer answer(FlightStore& store, const EncodedPicture& picture) {
    const PictureOffer offer = picture.offer();
    return store.accept({&offer, 1}, kNow).front();
  }
  static std::optional<PictureProblem> problem(FlightStore& store, const EncodedPicture& picture) {
    const PictureAnswer given = answer(store, picture);
    EXPECT_EQ(given.outcome == Outcome::refused, given.refusal.has_value());
    return given.refusal ? std::optional(given.refusal->problem) : std::nullopt;
  }

  const TemporaryFolder temporary_;
};

TEST_F(StoredPictures, ABatchIsPartOfTheFlightWhenItReturns) {
  const std::vector<EncodedPicture> pictures{plain_picture(1), plain_picture(2), plain_picture(3)};
  {
    const auto store = create();
    const auto answers = store->accept(offers(pictures), kNow);
    ASSERT_EQ(answers.size(), 3U);
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(answers[i].outcome, Outcome::accepted);
      EXPECT_EQ(answers[i].frame, i);
      EXPECT_EQ(answers[i].name, pictures[i].name);
    }
  }
  const auto store = FlightStore::open(folder());
  ASSERT_EQ(store->accepted(), 3U);
  EXPECT_EQ(store->processed(), 0U);
  for (std::size_t i = 0; i < 3; ++i) {
    const PictureRow row = store->picture(i);
    EXPECT_EQ(row.name, pictures[i].name);
    EXPECT_EQ(row.telemetry.frame, pictures[i].name);
    EXPECT_EQ(row.telemetry.time_s, pictures[i].telemetry.time_s);
    EXPECT_EQ(row.telemetry.agl_m, pictures[i].telemetry.agl_m);
    EXPECT_EQ(row.width, flight_camera().camera.width);
    EXPECT_EQ(row.bytes, pictures[i].bytes.size());
    EXPECT_EQ(row.sha256, sha256(pictures[i].bytes));
    EXPECT_EQ(store->read_picture(i), pictures[i].bytes);
  }
  EXPECT_EQ(store->description().name, "a flight");
  EXPECT_TRUE(same_flight(store->description(), description(Course::smooth)));
  EXPECT_FALSE(same_flight(store->description(), description(Course::eventful)));
  const auto events = store->events_after(0, 10);
  ASSERT_EQ(events.size(), 2U);
  EXPECT_EQ(events[0].event.kind, FlightEventKind::flight_created);
  EXPECT_EQ(events[1].event.kind, FlightEventKind::pictures_accepted);
  EXPECT_EQ(events[1].event.body, R"({"accepted":3,"first_frame":0,"refused":[]})");
  EXPECT_EQ(events[1].time, kNow);
  EXPECT_EQ(store->events_after(1, 10).size(), 1U);
  EXPECT_EQ(store->events_after(0, 1).size(), 1U);
  EXPECT_TRUE(store->events_after(2, 10).empty());
}

TEST_F(StoredPictures, EachPictureGetsAnAnswerOfItsOwn) {
  const auto store = create();
  EncodedPicture empty = plain_picture(2), text = plain_picture(3), small = plain_picture(4), early = plain_picture(1);
  empty.bytes.clear();
  const std::string words = "this is no picture";
  text.bytes.assign(words.begin(), words.end());
  small.bytes = encode_image(cv::Mat::zeros(48, 64, CV_8UC1), ImageFormat::jpeg);
  early.name = "late.jpg";
  early.telemetry.time_s = 0.5;
  early.bytes = plain_picture(77).bytes;
  const std::vector<EncodedPicture> batch{plain_picture(1), empty, text, small, early, plain_picture(5)};
  const auto answers = store->accept(offers(batch), kNow);
  ASSERT_EQ(answers.size(), batch.size());
  EXPECT_EQ(answers[0].frame, 0U);
  EXPECT_EQ(answers[1].refusal->problem, PictureProblem::empty);
  EXPECT_EQ(answers[2].refusal->problem, PictureProblem::unknown_type);
  EXPECT_EQ(answers[3].refusal->problem, PictureProblem::other_camera);
  EXPECT_EQ(answers[3].refusal->reason, "expected 320×240 pixels, as the flight's camera has, found 64×48");
  EXPECT_EQ(answers[4].refusal->problem, PictureProblem::out_of_order);
  EXPECT_EQ(answers[5].frame, 1U) << "the others do not stop it";
  EXPECT_EQ(store->accepted(), 2U);
  EXPECT_EQ(files(), 2U);
  const auto refused = store->refused();
  ASSERT_EQ(refused.size(), 4U);
  EXPECT_EQ(refused[0].reason, "empty: the file has 0 bytes");
  EXPECT_FALSE(refused[0].frame);
}

TEST_F(StoredPictures, ARepeatedUploadIsKnownAndChangesNothing) {
  const auto store = create();
  const std::vector<EncodedPicture> batch{plain_picture(1), plain_picture(2)};
  store->accept(offers(batch), kNow);
  const auto again = store->accept(offers(batch), kNow);
  EXPECT_EQ(again[0].outcome, Outcome::known);
  EXPECT_EQ(again[1].outcome, Outcome::known);
  EXPECT_EQ(again[1].frame, 1U);
  EXPECT_EQ(store->accepted(), 2U);
  EXPECT_EQ(store->events_after(0, 10).size(), 2U) << "nothing happened";
}

TEST_F(StoredPictures, ANameOrAContentComesOnce) {
  const auto store = create();
  ASSERT_EQ(problem(*store, plain_picture(1)), std::nullopt);
  EncodedPicture other = plain_picture(2);
  other.name = plain_picture(1).name;
  EXPECT_EQ(problem(*store, other), PictureProblem::name_taken);
  EncodedPicture copy = plain_picture(1);
  copy.name = "copy.jpg";
  copy.telemetry.time_s = 9;
  EXPECT_EQ(problem(*store, copy), PictureProblem::content_known);
  // Within one batch as well.
  EncodedPicture first = plain_picture(10), twin = plain_picture(10), named = plain_picture(11);
  twin.name = "twin.jpg";
  twin.telemetry.time_s = 11;
  named.name = first.name;
  const std::vector<EncodedPicture> batch{first, twin, named, first};
  const auto answers = store->accept(offers(batch), kNow);
  EXPECT_EQ(answers[0].outcome, Outcome::accepted);
  EXPECT_EQ(answers[1].refusal->problem, PictureProblem::content_known);
  EXPECT_EQ(answers[2].refusal->problem, PictureProblem::name_taken);
  EXPECT_EQ(answers[3].outcome, Outcome::known);
}

TEST_F(StoredPictures, NamesNeverLeadAnywhere) {
  const auto store = create();
  for (const std::string& name :
       {std::string(), std::string("../x.jpg"), std::string("/etc/passwd"), std::string(".."), std::string(".hidden"),
        std::string("a\\b"), std::string("a\nb"), std::string("a\0b", 3), std::string("\xff\xfe"),
        std::string("\x1b[31m"), std::string(256, 'a')}) {
    EncodedPicture picture = plain_picture(1);
    picture.name = name;
    EXPECT_EQ(problem(*store, picture), PictureProblem::bad_name) << name;
  }
  EncodedPicture picture = plain_picture(1);
  picture.name = "Luftbild Zürich ½.jpg";
  EXPECT_EQ(problem(*store, picture), std::nullopt);
  EXPECT_TRUE(fs::exists(folder() / kPicturesFolder / "00000000.jpeg")) << "whatever it is called";
  EncodedPicture timeless = plain_picture(2);
  timeless.telemetry.time_s = std::nan("");
  EXPECT_EQ(problem(*store, timeless), PictureProblem::bad_time);
}

// Height and width in the JPEG's frame header.
Bytes declared(Bytes jpeg, int width, int height) {
  for (std::size_t i = 2; i + 9 < jpeg.size(); ++i) {
    if (jpeg[i] != 0xFF || jpeg[i + 1] != 0xC0) continue;
    jpeg[i + 5] = static_cast<std::uint8_t>(height >> 8);
    jpeg[i + 6] = static_cast<std::uint8_t>(height);
    jpeg[i + 7] = static_cast<std::uint8_t>(width >> 8);
    jpeg[i + 8] = static_cast<std::uint8_t>(width);
    return jpeg;
  }
  ADD_FAILURE() << "no frame header";
  return jpeg;
}

TEST_F(StoredPictures, HugeHeadersAndBytesAreRefused) {
  FlightStoreOptions options;
  options.limits.picture_bytes = 100'000;
  options.limits.batch_pictures = 3;
  options.limits.flight_pictures = 1;
  const auto store = create(options);
  EncodedPicture picture = plain_picture(1);
  const Bytes sound = picture.bytes;
  picture.bytes = declared(sound, 19'000, 19'000);
  EXPECT_EQ(problem(*store, picture), PictureProblem::too_many_pixels);
  picture.bytes = declared(sound, 65'535, 65'535);
  EXPECT_EQ(problem(*store, picture), PictureProblem::damaged_header);
  picture.bytes = Bytes(sound.begin(), sound.begin() + 30);
  EXPECT_EQ(problem(*store, picture), PictureProblem::damaged_header);
  picture.bytes = sound;
  picture.bytes.resize(100'001);
  EXPECT_EQ(problem(*store, picture), PictureProblem::too_large);
  EXPECT_EQ(problem(*store, plain_picture(2)), std::nullopt);
  EXPECT_EQ(problem(*store, plain_picture(3)), PictureProblem::flight_full);
  const std::vector<EncodedPicture> four(4, plain_picture(4));
  EXPECT_THROW(store->accept(offers(four), kNow), UsageError);
  EXPECT_EQ(files(), 1U);
}

TEST_F(StoredPictures, RefusalsDoNotFillTheDisk) {
  FlightStoreOptions options;
  options.limits.stored_refusals = 5;
  const auto store = create(options);
  EncodedPicture empty = plain_picture(1);
  empty.bytes.clear();
  for (int i = 0; i < 20; ++i) EXPECT_EQ(problem(*store, empty), PictureProblem::empty);
  EXPECT_EQ(store->refused().size(), 5U);
}

TEST_F(StoredPictures, FilesOfAFolderAreReadButNoLinks) {
  const auto store = create();
  const fs::path source = temporary_ / "source";
  fs::create_directory(source);
  write_file_atomic(source / "picture1.jpg", plain_picture(1).bytes);
  fs::create_symlink(source / "picture1.jpg", source / "link.jpg");
  fs::create_directory(source / "folder.jpg");
  ASSERT_EQ(::mkfifo((source / "pipe.jpg").c_str(), 0600), 0);
  const Directory opened(source);
  std::vector<PictureOffer> batch;
  for (const char* name :
       {"picture1.jpg", "link.jpg", "folder.jpg", "pipe.jpg", "none.jpg", "../source/picture1.jpg"}) {
    PictureOffer& offer = batch.emplace_back();
    offer.name = name;
    offer.telemetry.time_s = static_cast<double>(batch.size());
    offer.folder = &opened;
  }
  const auto answers = store->accept(batch, kNow);
  EXPECT_EQ(answers[0].outcome, Outcome::accepted);
  for (std::size_t i = 1; i < 5; ++i) EXPECT_EQ(answers[i].refusal->problem, PictureProblem::not_a_file) << i;
  EXPECT_EQ(answers[5].refusal->problem, PictureProblem::bad_name);
  EXPECT_EQ(store->read_picture(0), plain_picture(1).bytes);
}

TEST_F(StoredPictures, AChangedPictureIsNotProcessed) {
  const auto store = create();
  ASSERT_EQ(problem(*store, plain_picture(1)), std::nullopt);
  write_file_atomic(folder() / kPicturesFolder / "00000000.jpeg", plain_picture(2).bytes);
  EXPECT_THROW(store->read_picture(0), Error);
  fs::remove(folder() / kPicturesFolder / "00000000.jpeg");
  EXPECT_THROW(store->read_picture(0), Error);
}

TEST_F(StoredPictures, WhatNoBatchMentionsIsRemoved) {
  {
    const auto store = create();
    ASSERT_EQ(problem(*store, plain_picture(1)), std::nullopt);
  }
  write_file_atomic(folder() / kPicturesFolder / "00000001.jpeg", plain_picture(2).bytes);
  const auto store = FlightStore::open(folder());
  EXPECT_EQ(files(), 1U);
  EXPECT_EQ(problem(*store, plain_picture(3)), std::nullopt);
  EXPECT_EQ(store->read_picture(1), plain_picture(3).bytes);
}

TEST_F(StoredPictures, OneProcessAtATime) {
  const auto store = create();
  EXPECT_THROW(FlightStore::open(folder()), UsageError);
  const ProcessResult other = run_process({NADIR_KILLED_FLIGHT, folder().string(), "fly", "smooth", "0"});
  EXPECT_EQ(other.code, 2);
  EXPECT_THAT(other.err, testing::HasSubstr("another process is using this flight"));
}

TEST_F(StoredPictures, OtherDatabasesAreRefused) {
  EXPECT_THROW(FlightStore::open(temporary_ / "nothing"), UsageError);
  create().reset();
  EXPECT_THROW(create(), UsageError) << "there is one already";
  const auto change = [this](const std::string& sql) {
    SqliteDatabase database = SqliteDatabase::open_writable(folder() / kFlightFile);
    database.execute(sql);
    database.close();
  };
  change("PRAGMA user_version = 5");
  try {
    FlightStore::open(folder());
    FAIL() << "a newer version was opened";
  } catch (const UsageError& error) {
    EXPECT_EQ(error.text().found, "version 5");
    EXPECT_EQ(error.text().fix, "use the nadir that created it");
  }
  change("PRAGMA user_version = 1");
  try {
    FlightStore::open(folder());
    FAIL() << "an older version was opened";
  } catch (const UsageError& error) {
    EXPECT_EQ(error.text().found, "version 1");
    EXPECT_THAT(error.text().fix, testing::HasSubstr("process its pictures again"));
  }
  change("PRAGMA user_version = 4");
  FlightStore::open(folder());
  change("CREATE TRIGGER t AFTER INSERT ON event BEGIN DELETE FROM picture; END");
  EXPECT_THROW(FlightStore::open(folder()), UsageError);
  change("DROP TRIGGER t");
  change("ALTER TABLE fix RENAME TO other");
  EXPECT_THROW(FlightStore::open(folder()), UsageError);
  change("ALTER TABLE other RENAME TO fix");
  change("PRAGMA application_id = 7");
  EXPECT_THROW(FlightStore::open(folder()), UsageError);
  temporary_.write("text/flight.sqlite", "no database");
  EXPECT_THROW(FlightStore::open(temporary_ / "text"), Error);
}

// What version 3 stored, and no more.
TEST_F(StoredPictures, AFlightOfTheVersionBeforeIsOpened) {
  const auto change = [this](const std::string& sql) {
    SqliteDatabase database = SqliteDatabase::open_writable(folder() / kFlightFile);
    database.execute(sql);
    database.close();
  };
  const std::vector<EncodedPicture> batch{plain_picture(1), plain_picture(2)};
  create()->accept(offers(batch), kNow);
  const std::string older =
      "DROP TABLE lens; DROP TABLE pose; DROP TABLE pose_covariance; DROP TABLE merge_basis; PRAGMA user_version = 3";
  change(older);
  for (int time = 0; time < 2; ++time) {
    const auto store = FlightStore::open(folder());
    EXPECT_EQ(store->accepted(), 2U);
    EXPECT_FALSE(store->adjusted_lens());
    EXPECT_FALSE(store->adjusted_pose(0));
  }
  change(older);
  change("CREATE TABLE pose (frame INTEGER)");
  EXPECT_THROW(FlightStore::open(folder()), UsageError) << "version 3 has no such table";
}

TEST_F(StoredPictures, FixesAreForTheFrameThatFollows) {
  const auto store = create();
  const std::vector<EncodedPicture> batch{plain_picture(1), plain_picture(2)};
  store->accept(offers(batch), kNow);
  EXPECT_EQ(store->add_fix(start(), 50, "before", kNow).before_frame, 0U);
  const auto begun = store->begin_frame();
  ASSERT_TRUE(begun);
  EXPECT_EQ(begun->fixes.size(), 1U);
  EXPECT_FALSE(store->begin_frame()) << "one at a time";
  EXPECT_EQ(store->add_fix(start(), 60, "meanwhile", kNow).before_frame, 1U);
  store->abandon_frame();
  EXPECT_EQ(store->begin_frame()->fixes.size(), 1U) << "the frame is begun with the same fixes again";
  EXPECT_EQ(store->fixes().size(), 2U);
  EXPECT_EQ(store->fixes()[1].radius_m, 60);
  EXPECT_EQ(store->fixes()[1].place.lat_deg, start().lat_deg);
  EXPECT_THROW(store->add_fix({181, 0}, 50, "nobody", kNow), UsageError);
  EXPECT_THROW(store->add_fix({0, std::nan("")}, 50, "nobody", kNow), UsageError);
  EXPECT_THROW(store->add_fix(start(), 0, "nobody", kNow), UsageError);
}

// What was applied stays applied, so that a resumed flight is estimated from the same inputs; from then on it is not.
TEST_F(StoredPictures, AWithdrawnFixStaysWithTheFramesThatHadIt) {
  const auto store = create();
  const std::vector<EncodedPicture> batch{plain_picture(1), plain_picture(2)};
  store->accept(offers(batch), kNow);
  const std::int64_t used = store->add_fix(start(), 50, "me", kNow).id;
  ASSERT_EQ(store->begin_frame()->fixes.size(), 1U);
  const std::int64_t unused = store->add_fix(start(), 60, "me", kNow).id;
  const auto withdrawn = store->withdraw_fix(used, kNow);
  ASSERT_TRUE(withdrawn);
  EXPECT_EQ(withdrawn->withdrawn->unix_ms, kNow.unix_ms);
  EXPECT_TRUE(withdrawn->applied());
  EXPECT_FALSE(store->withdraw_fix(unused, kNow)->applied());
  EXPECT_FALSE(store->withdraw_fix(77, kNow));
  const std::int64_t events = store->last_event();
  EXPECT_EQ(store->withdraw_fix(used, {1})->withdrawn->unix_ms, kNow.unix_ms) << "once";
  EXPECT_EQ(store->last_event(), events);
  store->abandon_frame();
  EXPECT_EQ(store->begin_frame()->fixes.size(), 1U) << "the frame is begun with the same fixes again";
  EXPECT_EQ(store->fixes_before(0).size(), 1U);
  EXPECT_TRUE(store->fixes_before(1).empty());
  EXPECT_EQ(store->fixes().size(), 2U) << "the record keeps both";
}

TEST_F(StoredPictures, APixelFixKeepsWhatWasSaidAndWhatFollows) {
  UserFix said;
  said.place = start(), said.radius_m = 10, said.sigma_m = 5, said.frame = 0, said.pixel = PixelPoint{12.5, 3};
  said.hint = {{.lon_deg = 11.5, .lat_deg = 48.5}, 40};
  create()->add_fix(said, kNow);
  const UserFix kept = FlightStore::open(folder())->fixes().at(0);
  EXPECT_EQ(kept.frame, 0U);
  EXPECT_EQ(kept.pixel->x, 12.5);
  EXPECT_EQ(kept.sigma_m, 5);
  EXPECT_EQ(kept.hint.place.lat_deg, 48.5);
  EXPECT_EQ(kept.hint.radius_m, 40);
  said.pixel->x = std::nan("");
  EXPECT_THROW(FlightStore::open(folder())->add_fix(said, kNow), UsageError);
}

TEST_F(StoredPictures, ObjectsHaveSightings) {
  const auto store = create();
  const MarkedObject tower = store->add_object("tower\n", {.frame = 3, .pixel = {10, 20}}, "me", kNow);
  const MarkedObject other = store->add_object("", {.frame = 4, .pixel = {1, 2}}, "me", kNow);
  EXPECT_EQ(tower.name.find('\n'), std::string::npos);
  ASSERT_EQ(tower.sightings.size(), 1U);
  const auto twice = store->add_sighting(tower.id, {.frame = 5, .pixel = {30, 40.5}}, kNow);
  ASSERT_EQ(twice->sightings.size(), 2U);
  EXPECT_EQ(twice->sightings[1].frame, 5U);
  EXPECT_EQ(twice->sightings[1].pixel.y, 40.5);
  EXPECT_EQ(store->rename_object(tower.id, "mast", kNow)->name, "mast");
  EXPECT_FALSE(store->remove_sighting(other.id, twice->sightings[1].id, kNow)) << "it is of another object";
  EXPECT_TRUE(store->remove_sighting(tower.id, twice->sightings[0].id, kNow));
  EXPECT_THROW(store->remove_sighting(tower.id, twice->sightings[1].id, kNow), UsageError) << "its last one";
  ASSERT_EQ(store->objects().size(), 2U);
  EXPECT_EQ(store->objects()[0].sightings.size(), 1U);
  EXPECT_TRUE(store->remove_object(tower.id, kNow));
  EXPECT_FALSE(store->remove_object(tower.id, kNow));
  EXPECT_FALSE(store->object(tower.id));
  EXPECT_FALSE(store->add_sighting(tower.id, {.frame = 5, .pixel = {}}, kNow));
  EXPECT_FALSE(store->rename_object(tower.id, "x", kNow));
  EXPECT_THROW(store->add_object("", {.frame = 3, .pixel = {std::nan(""), 0}}, "me", kNow), UsageError);
  for (std::size_t i = 1; i < kMaxObjectSightings; ++i) store->add_sighting(other.id, {.frame = 4, .pixel = {}}, kNow);
  EXPECT_THROW(store->add_sighting(other.id, {.frame = 4, .pixel = {}}, kNow), UsageError);
  EXPECT_EQ(store->events_after(0, 100).back().event.kind, FlightEventKind::objects_changed);
}

TEST_F(StoredPictures, PicturesOutsideStayThere) {
  const std::vector<EncodedPicture> pictures{plain_picture(1), plain_picture(2)};
  const fs::path outside = temporary_ / "outside";
  fs::create_directory(outside);
  std::vector<Telemetry> rows;
  for (const EncodedPicture& picture : pictures) {
    write_file_atomic(outside / picture.name, picture.bytes);
    rows.push_back(picture.telemetry);
    rows.back().frame = picture.name;
  }
  {
    const auto store = create();
    store->refer(outside, rows, {}, kNow);
    EXPECT_THROW(store->refer(outside, rows, {}, kNow), UsageError);
    EXPECT_THROW(problem(*store, plain_picture(3)), UsageError);
  }
  EXPECT_THROW(FlightStore::open(folder()), UsageError) << "the flight does not choose which files are read";
  fs::rename(outside, temporary_ / "moved");
  FlightStoreOptions options;
  options.outside = temporary_ / "moved";
  {
    const auto store = FlightStore::open(folder(), options);
    EXPECT_EQ(store->accepted(), 2U);
    EXPECT_EQ(files(), 0U);
    EXPECT_EQ(store->read_picture(1), pictures[1].bytes);
  }
  const auto change = [this](const std::string& sql) {
    SqliteDatabase database = SqliteDatabase::open_writable(folder() / kFlightFile);
    database.execute(sql);
    database.close();
  };
  temporary_.write("secret", "not to be read");
  change("UPDATE picture SET file = '../secret' WHERE frame = 0");
  const auto store = FlightStore::open(folder(), options);
  EXPECT_THROW(store->read_picture(0), Error);
  fs::remove(temporary_ / "moved" / pictures[1].name);
  EXPECT_TRUE(store->read_picture(1).empty()) << "an unfit frame";
}

// The disk of a service that nobody looks after.
TEST(FullDisk, ABatchIsStoredWhollyOrNotAtAll) {
  const TemporaryFolder temporary;
  SmallDisk disk(temporary / "disk", "size=700k");
  if (!disk.mounted()) GTEST_SKIP() << "only root may mount a tmpfs";
  const fs::path folder = temporary / "disk" / "flight";
  const auto store = FlightStore::create(folder, description(Course::smooth), kNow);
  Random random(3);
  int number = 0;
  const auto batch = [&] {
    std::vector<EncodedPicture> pictures;
    for (int i = 0; i < 3; ++i) {
      EncodedPicture& picture = pictures.emplace_back(plain_picture(number++));
      cv::Mat noise(240, 320, CV_8UC1);
      for (int at = 0; at < 320 * 240; ++at) noise.data[at] = static_cast<std::uint8_t>(random.integer(0, 255));
      picture.bytes = encode_image(noise, ImageFormat::png);
    }
    return pictures;
  };
  std::size_t stored = 0;
  std::vector<EncodedPicture> last;
  try {
    for (int i = 0; i < 10; ++i) {
      last = batch();
      store->accept(offers(last), kNow);
      stored += 3;
    }
    FAIL() << "a disk of 700 kB took 2 MB";
  } catch (const OutOfSpace&) {
  }
  EXPECT_GT(stored, 0U);
  EXPECT_EQ(store->accepted(), stored);
  const auto files = [&] {
    return std::distance(fs::directory_iterator(folder / kPicturesFolder), fs::directory_iterator());
  };
  EXPECT_EQ(files(), static_cast<std::ptrdiff_t>(stored)) << "the pictures of the failed batch are gone";
  ASSERT_TRUE(disk.resize("4m"));
  store->accept(offers(last), kNow);  // the same batch again
  EXPECT_EQ(store->accepted(), stored + 3);
  EXPECT_EQ(store->read_picture(stored + 2), last.back().bytes);
}

// After so much work, by its CPU time: a busy machine does not kill it before it has begun.
void kill_after(pid_t child, std::chrono::nanoseconds work) {
  clockid_t clock{};
  ASSERT_EQ(::clock_getcpuclockid(child, &clock), 0);
  const auto ended = [child] {
    siginfo_t info{};
    return ::waitid(P_PID, static_cast<id_t>(child), &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid != 0;
  };
  for (timespec used{}; !ended() && ::clock_gettime(clock, &used) == 0;) {
    if (std::chrono::seconds(used.tv_sec) + std::chrono::nanoseconds(used.tv_nsec) >= work) break;
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
  ::kill(child, SIGKILL);
}

// A process that stores batches and is killed at random moments; what it said to be stored is.
TEST(KilledIntake, LosesNothingThatWasAccepted) {
  const TemporaryFolder temporary;
  const fs::path folder = temporary / "flight";
  Random random(11);
  std::size_t accepted = 0, fixes = 0, kills_before_any = 0;
  std::vector<Bytes> offered;  // the pictures, which cost more to encode than to store
  for (int round = 0; round < 40; ++round) {
    const fs::path said = temporary / ("said" + std::to_string(round));
    const std::string program = NADIR_KILLED_FLIGHT, where = folder.string(), out = said.string();
    const pid_t child = ::fork();
    if (child == 0) {
      if (std::freopen(out.c_str(), "w", stdout) == nullptr) ::_exit(3);
      ::execl(program.c_str(), program.c_str(), where.c_str(), "accept", nullptr);
      ::_exit(4);
    }
    kill_after(child, std::chrono::microseconds(random.integer(5'000, 50'000)));
    int status = 0;
    ::waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status)) << "it ended by itself: " << status;
    std::ifstream lines(said);
    for (std::string line; std::getline(lines, line);) {
      std::istringstream words(line);
      std::string what;
      std::size_t number = 0;
      if (!(words >> what >> number)) continue;
      (what == "accepted" ? accepted : fixes) = number;
    }
    if (!FlightStore::exists(folder)) {
      ASSERT_EQ(accepted, 0U);
      ++kills_before_any;
      continue;
    }
    const auto store = FlightStore::open(folder);
    ASSERT_GE(store->accepted(), accepted);
    ASSERT_EQ(store->accepted() % 3, 0U) << "a batch is stored wholly or not at all";
    ASSERT_GE(store->fixes().size(), fixes);
    accepted = store->accepted();
    fixes = store->fixes().size();
    while (offered.size() < accepted) offered.push_back(plain_picture(static_cast<int>(offered.size())).bytes);
    for (std::size_t i = 0; i < accepted; ++i) ASSERT_EQ(store->read_picture(i), offered[i]) << i;
    ASSERT_EQ(std::distance(fs::directory_iterator(folder / kPicturesFolder), fs::directory_iterator()),
              static_cast<std::ptrdiff_t>(accepted));
    std::size_t in_events = 0;
    std::int64_t expected_id = 1;
    for (const EventRow& row : store->events_after(0, 1'000'000)) {
      ASSERT_EQ(row.id, expected_id++);
      if (row.event.kind == FlightEventKind::pictures_accepted) in_events += 3;
    }
    ASSERT_EQ(in_events, accepted);
  }
  EXPECT_GT(accepted, 0U) << "it got somewhere between the kills";
  EXPECT_LT(kills_before_any, 40U);
}

}  // namespace
}  // namespace nadir
