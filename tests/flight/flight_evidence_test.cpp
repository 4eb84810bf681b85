// What a whole service tells the operator and leaves on record: the fixes that it sent, the machine's health, tiles
// that spoil in flight, a matcher that throws, and what it waits for.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <mutex>
#include <thread>

#include "base/files.hpp"
#include "flight/flight_service.hpp"
#include "flight/link_peer.hpp"
#include "package/package_maker.hpp"
#include "recorder/recording.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using testing::Contains;
using testing::HasSubstr;

class FlightEvidence : public ::testing::Test {
 protected:
  FlightEvidence() {
    options_.airframe.system = 7;
    options_.airframe.gps_id = 1;  // the real receiver is the first one
    options_.airframe.camera.camera = {640, 480, 500, 500, 319.5, 239.5, {}};
    options_.state = folder_ / "state";
    std::filesystem::create_directories(options_.state);
    options_.autopilot = peer_.endpoint();
    options_.api.address = "127.0.0.1:0";
    options_.recording.folder = folder_ / "record";
    options_.camera = "folder:" + (folder_ / "frames").string();
    options_.package = maker_.make(folder_);
  }
  void TearDown() override { end(); }

  void begin() {
    NoProgress silent;
    Opening opening = open_package(options_.package, maker_.options(), silent);
    ASSERT_TRUE(opening.package) << test::codes(opening.findings);
    tiles_ = &opening.package->imagery();
    options_.start = opening.package->mission().route.points.front();
    service_ = std::make_unique<FlightService>(options_, VerifiedPackage{std::move(opening.package), opening.findings},
                                               clock_, stop_, [this](const std::string& line) {
                                                 const std::scoped_lock lock(mutex_);
                                                 log_.push_back(line);
                                               });
    running_ = std::jthread([this] { service_->run(); });
    peer_.listen_until(
        [&] { return !peer_.received(MAVLINK_MSG_ID_HEARTBEAT).empty() && logged("waiting for the auto"); });
    mavlink_message_t message;
    mavlink_msg_heartbeat_pack(7, 1, &message, MAV_TYPE_FIXED_WING, MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 0);
    peer_.send(message);
  }
  void end() {
    stop_.request_stop();
    running_ = {};
    service_.reset();
  }
  bool logged(const std::string& beginning) const {
    const std::scoped_lock lock(mutex_);
    return std::ranges::any_of(log_, [&](const std::string& line) { return line.starts_with(beginning); });
  }
  // Until the state is saved with a time after this call. The conductor first notes what was published before, the
  // upkeep thread first measures the machine; in the same turn the conductor reports corrupt tiles.
  void wait_for_save() {
    const double now_s = clock_.monotonic_s();
    peer_.listen_until([&] {
      const SavedFlightReading saved = StateDirectory(options_.state).load();
      return saved.flight && saved.flight->saved_monotonic_s > now_s;
    });
  }
  std::vector<std::string> texts() const {
    std::vector<std::string> found;
    for (const mavlink_message_t& message : peer_.received(MAVLINK_MSG_ID_STATUSTEXT)) {
      char text[51] = {};
      mavlink_msg_statustext_get_text(&message, text);
      found.emplace_back(text);
    }
    return found;
  }
  template <typename Kind>
  std::vector<Kind> recorded() const {
    std::vector<Kind> found;
    read_recording(folder_ / "record", [&](const Recorded& one) {
      if (const auto* record = std::get_if<Kind>(&one.record)) found.push_back(*record);
    });
    return found;
  }

  const test::TemporaryFolder folder_;
  const SystemFlightClock clock_;
  StopSignals stop_;
  test::LinkPeer peer_;
  test::PackageMaker maker_;
  FlightOptions options_;
  const CheckedTiles* tiles_ = nullptr;  // as the matcher reads them
  mutable std::mutex mutex_;
  std::vector<std::string> log_;
  std::unique_ptr<FlightService> service_;
  std::jthread running_;
};

TEST_F(FlightEvidence, EveryFixThatWasSentIsOnRecordWithTheReceiversBesideIt) {
  begin();
  mavlink_message_t message;
  mavlink_gps_raw_int_t gps{};
  gps.fix_type = GPS_FIX_TYPE_3D_FIX;
  gps.lat = 474'000'000;
  gps.lon = 85'000'000;
  gps.alt = 500'000;
  gps.h_acc = 1500;
  mavlink_msg_gps_raw_int_encode(7, 1, &message, &gps);
  peer_.send(message);
  peer_.listen();  // what was sent before
  const std::size_t before = peer_.fixes().size();
  peer_.listen_until([&] { return peer_.fixes().size() >= before + 5; });
  end();
  peer_.listen();
  const auto fixes = recorded<FixRecord>();
  const auto arrived = peer_.fixes();
  ASSERT_EQ(fixes.size(), arrived.size());
  for (std::size_t i = 0; i < fixes.size(); ++i) {
    EXPECT_EQ(fixes[i].fix_type, arrived[i].fix_type) << "\"no fix\" is on record too";
    EXPECT_FALSE(fixes[i].place);
    EXPECT_EQ(fixes[i].accuracy_m, 999);
    EXPECT_EQ(fixes[i].unix_us, static_cast<std::int64_t>(arrived[i].time_usec));
  }
  // And so is what each was made of.
  std::vector<std::int64_t> sent_us;
  const auto inputs = recorded<FixInputRecord>();
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    EXPECT_EQ(inputs[i].number, i);
    EXPECT_EQ(inputs[i].missing, 0U);
    if (inputs[i].sent) sent_us.push_back(inputs[i].unix_us);
  }
  ASSERT_EQ(sent_us.size(), fixes.size());
  for (std::size_t i = 0; i < fixes.size(); ++i) EXPECT_EQ(sent_us[i], fixes[i].unix_us);
  ASSERT_TRUE(fixes.back().gps);
  EXPECT_EQ(fixes.back().gps->fix_type, 3);
  EXPECT_NEAR(fixes.back().gps->place.lat_deg, 47.4, 1e-6);
  EXPECT_EQ(fixes.back().gps->accuracy_m, 1.5);
  EXPECT_GE(fixes.back().gps->age_s, 0);
}

TEST_F(FlightEvidence, TheMachinesHealthIsOnRecord) {
  begin();
  wait_for_save();
  end();
  std::vector<std::string> names;
  for (const HealthRecord& health : recorded<HealthRecord>()) {
    for (const auto& [name, value] : health.measures) names.push_back(name);
  }
  EXPECT_THAT(names, Contains("memory_mb"));
  EXPECT_THAT(names, Contains("memory_available_mb"));
}

// The storage medium goes bad after take-off: quick verification has long passed.
TEST_F(FlightEvidence, ATileDamagedInFlightIsReportedAndRecordedOnce) {
  begin();
  test::sqlite(options_.package / kImageryFile, "UPDATE tiles SET tile_data = zeroblob(length(tile_data))");
  const std::string text = "Nadir: CORRUPT MAP TILES, check storage";
  for (std::size_t i = 0; i < 3; ++i) EXPECT_FALSE(tiles_->read(tiles_->sidecars()[i].key));
  wait_for_save();
  peer_.listen_until([&] { return std::ranges::count(texts(), text) > 0; });
  end();
  peer_.listen();
  EXPECT_EQ(std::ranges::count(texts(), text), 1) << "not once for each tile";
  std::vector<std::string> codes;
  for (const TileRecord& tile : recorded<TileRecord>()) codes.push_back(tile.code);
  EXPECT_EQ(codes, std::vector<std::string>(3, "artifact.hash")) << "each tile";
}

TEST_F(FlightEvidence, ReportsAtTheStartWhatItWaitsFor) {
  begin();
  peer_.listen_until([&] { return logged("autopilot: here after"); });
  end();
  EXPECT_THAT(log_, Contains("package: here"));
  EXPECT_THAT(log_, Contains(HasSubstr("waiting for the camera folder:" + (folder_ / "frames").string())));
  EXPECT_THAT(log_, Contains(HasSubstr("waiting for the autopilot 7/1 at " + options_.autopilot + ": no heartbeat")));
}

TEST_F(FlightEvidence, MakesATokenForHintsThatOnlyItsUserCanRead) {
  begin();
  end();
  const std::filesystem::path token = folder_ / "state" / "api-token";
  ASSERT_TRUE(std::filesystem::exists(token));
  EXPECT_EQ(std::filesystem::status(token).permissions(),
            std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  EXPECT_EQ(read_text_file(token).size(), 49U) << "48 hexadecimal digits and a line end";
}

}  // namespace
}  // namespace nadir
