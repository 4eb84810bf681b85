// A stop in the middle of a search over all of a wide area: counted is what is still looked at, not how long it takes.
#include <gtest/gtest.h>

#include <chrono>
#include <condition_variable>
#include <mutex>

#include "estimation/localizer_fixture.hpp"
#include "flight/localizing.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"

namespace nadir {
namespace {

using namespace test;

constexpr PlaneBox kWide{-3200, -3200, 3200, 3200};  // sixteen windows
constexpr std::chrono::seconds kFarTooLong{120};     // only so that what hangs fails

// A map without an end, every tile of it the same. Whoever reads waits until the gate is open.
class EndlessTiles final : public TileSource {
 public:
  ZoomRange zooms() const override { return landscape_tiles().zooms(); }
  std::optional<Bytes> read(const TileKey&) const override {
    std::unique_lock lock(mutex_);
    ++reads_;
    changed_.notify_all();
    changed_.wait_for(lock, kFarTooLong, [&] { return open_; });
    return landscape_tiles().read(tile_at(kOrigin, zooms().max));
  }

  bool await_reader() const {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, kFarTooLong, [&] { return reads_ > 0; });
  }
  void open() {
    const std::scoped_lock lock(mutex_);
    open_ = true;
    changed_.notify_all();
  }
  int reads() const {
    const std::scoped_lock lock(mutex_);
    return reads_;
  }

 private:
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  mutable int reads_ = 0;
  bool open_ = false;
};

TEST(StopInSearch, EndsWithTheWindowAtHandAndTellsNothing) {
  const SystemFlightClock clock;
  ThreadWatch watch(clock);
  LatestMailbox<FlightPicture> pictures;
  EndlessTiles tiles;
  LocalizerConfig lost = config();
  lost.area = kWide;
  const LocalizingSetup setup{flight_camera(), {}, LocalFrame(kOrigin), &tiles, std::nullopt, lost, 0};
  int late = 0;
  {
    Localizing localizing(setup, pictures, watch,
                          {[](std::uint64_t, const Telemetry&, ByteView) {},
                           [&](const LocalizedFrame& frame) { late += frame.late ? 1 : 0; }, [](const HintRecord&) {}});
    const Moment& moment = short_flight()[0];
    const Telemetry& told = moment.telemetry;
    localizing.hear(told.time_s, AircraftAttitude{0, *told.roll_rad, *told.pitch_rad, *told.heading_rad, {}});
    localizing.hear(told.time_s, GroundHeight{{}, 0, *told.agl_m});
    pictures.put({told.frame, encode_image(moment.image, ImageFormat::png), told.time_s});
    ASSERT_TRUE(tiles.await_reader());
    localizing.request_stop();
    tiles.open();
  }
  const double tile_m = kTileSize * ground_resolution_m(tiles.zooms().max, kOrigin.lat_deg);
  const double tiles_of_area = (kWide.east_m - kWide.west_m) * (kWide.north_m - kWide.south_m) / (tile_m * tile_m);
  EXPECT_LT(tiles.reads(), tiles_of_area / 8) << "one window of sixteen, with its margin";
  EXPECT_EQ(late, 0) << "a look that was given up says nothing, not even that nothing was found";
}

}  // namespace
}  // namespace nadir
