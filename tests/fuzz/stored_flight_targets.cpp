// What a stored flight reads: it may come from somebody else. The answers of vision, the rows of its tables, its file.
#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "base/files.hpp"
#include "flights/flight_store.hpp"
#include "flights/recorded_vision.hpp"
#include "fuzz/any_rows.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "imagery/sqlite_database.hpp"

namespace nadir::fuzz {
namespace {

constexpr const char* kSecret = "not the flight's";
constexpr UtcMillis kNow{1'795'000'000'000};

// An empty folder for a flight, with a file beside it that no flight may read or change.
std::filesystem::path fresh_flight_folder() {
  const std::filesystem::path folder = scratch_folder() / "flight";
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder / kPicturesFolder);
  static const auto outside = scratch_file("secret", kSecret);
  require(std::filesystem::exists(outside), "a file outside of the folder is gone");
  return folder;
}

// Everything that a desk asks of a flight, one after the other.
void read_all(const FlightStore& store) {
  const std::size_t frames = std::min<std::size_t>(store.accepted(), 64);
  for (std::size_t frame = 0; frame < frames; ++frame) {
    refusing([&] { require(store.picture(frame).frame == frame, "a picture of another frame"); });
    refusing([&] {
      const Bytes picture = store.read_picture(frame);
      require(std::string(picture.begin(), picture.end()) != kSecret, "a file of somebody else was read");
    });
    refusing([&] { static_cast<void>(decode_answers(store.stored_frame(frame).answers)); });
    refusing([&] { static_cast<void>(store.look_of(frame)); });
    refusing([&] { static_cast<void>(store.fixes_before(frame)); });
    refusing([&] { static_cast<void>(store.adjusted_pose(frame)); });
    refusing([&] { static_cast<void>(store.adjusted_joint_covariance({frame, 0})); });
    refusing([&] { static_cast<void>(store.placed_estimate(frame)); });
  }
  refusing([&] { static_cast<void>(store.refused()); });
  for (const EstimateKind kind : {EstimateKind::online, EstimateKind::refined, EstimateKind::adjusted}) {
    refusing([&] { require(store.estimates(kind, 0, 3).size() <= 3, "more estimates than asked for"); });
  }
  refusing([&] { static_cast<void>(store.adjusted_lens()); });
  refusing([&] { static_cast<void>(store.segments()); });
  refusing([&] { static_cast<void>(store.fixes()); });
  refusing([&] { static_cast<void>(store.objects()); });
  refusing([&] { require(store.events_after(0, 5).size() <= 5, "more events than asked for"); });
}

// And then as one goes on with it.
void use(FlightStore& store) {
  read_all(store);
  refusing([&] { static_cast<void>(store.add_fix({47, 8}, 100, "fuzz", kNow)); });
  refusing([&] { static_cast<void>(store.withdraw_fix(1, kNow)); });
  refusing([&] { static_cast<void>(store.remove_object(1, kNow)); });
  refusing([&] { static_cast<void>(store.take_back_merge(1, "fuzz", kNow)); });
  refusing([&] {
    if (store.begin_frame()) store.abandon_frame();
  });
}

void open_and_use(const std::filesystem::path& folder) {
  FlightStoreOptions options;
  options.sync = StoreSync::checkpoints;
  refusing([&] { use(*FlightStore::open(folder, options)); });
  require(read_text_file(scratch_folder() / "secret") == kSecret, "a file outside of the folder changed");
}

void put_flight_rows(const SqliteDatabase& database, Source source) {
  struct Table {
    const char* insert;
    int columns;
  };
  static constexpr std::array<Table, 13> kRows{{{"picture VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", 12},
                                                {"measurement VALUES (?, ?)", 2},
                                                {"look VALUES (?, ?, ?)", 3},
                                                {"estimate VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", 15},
                                                {"segment VALUES (?, ?, ?, ?, ?)", 5},
                                                {"fix VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", 16},
                                                {"object VALUES (?, ?, ?, ?)", 4},
                                                {"sighting VALUES (?, ?, ?, ?, ?)", 5},
                                                {"event VALUES (?, ?, ?, ?, ?)", 5},
                                                {"lens VALUES (?, ?, ?, ?, ?, ?, ?)", 7},
                                                {"pose VALUES (?, ?, ?, ?, ?)", 5},
                                                {"pose_covariance VALUES (?, ?, ?)", 3},
                                                {"merge_basis VALUES (?, ?)", 2}}};
  for (int row = 0; row < 64 && !source.empty(); ++row) {
    const Table& table = kRows.at(source.byte() % kRows.size());
    auto insert = database.prepare(std::string("INSERT OR IGNORE INTO ") + table.insert);
    for (int column = 1; column <= table.columns; ++column) bind_any(insert, column, source);
    refusing([&] { insert.run(); });  // the tables are strict: a column's type is enforced
  }
}

// A flight as FlightStore creates it, once.
const std::string& empty_flight() {
  static const std::string file = [] {
    const std::filesystem::path folder = fresh_flight_folder();
    FlightDescription description;
    description.name = "fuzz";
    description.session.camera.camera.width = 640;
    description.session.camera.camera.height = 480;
    FlightStore::create(folder, description, kNow);
    return read_text_file(folder / kFlightFile);
  }();
  return file;
}

}  // namespace

void answers(std::string_view bytes) {
  const auto first = decode_answers(as_bytes(bytes));
  if (!first) return;
  const Bytes written = encode_answers(*first);
  require(std::equal(written.begin(), written.end(), as_bytes(bytes).begin(), as_bytes(bytes).end()),
          "answers change when they are written");
}

void flight_rows(std::string_view bytes) {
  const std::string& empty = empty_flight();
  const std::filesystem::path folder = fresh_flight_folder();
  scratch_file("flight/" + std::string(kFlightFile), empty);
  {
    const SqliteDatabase database = SqliteDatabase::open_writable(folder / kFlightFile);
    database.execute("PRAGMA synchronous = OFF; PRAGMA foreign_keys = OFF; PRAGMA ignore_check_constraints = ON");
    database.transaction([&] { put_flight_rows(database, Source(bytes)); });
  }
  open_and_use(folder);
}

void flight_file(std::string_view bytes) {
  const std::filesystem::path folder = fresh_flight_folder();
  scratch_file("flight/" + std::string(kFlightFile), bytes);
  open_and_use(folder);
}

}  // namespace nadir::fuzz
