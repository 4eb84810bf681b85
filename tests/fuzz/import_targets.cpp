// What imports of flights read: photos' metadata and logs of autopilots.
#include <algorithm>
#include <cmath>

#include "flight_import/ardupilot_log.hpp"
#include "flight_import/camera_draft.hpp"
#include "flight_import/mavlink_log.hpp"
#include "flight_import/photo_metadata.hpp"
#include "flight_import/px4_log.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"

namespace nadir::fuzz {
namespace {

template <class Sample>
void require_order(const std::vector<Sample>& samples) {
  for (std::size_t i = 0; i < samples.size(); ++i) {
    require(std::isfinite(samples[i].time_s), "a time that is none");
    require(i == 0 || samples[i].time_s > samples[i - 1].time_s, "samples out of the order of time");
  }
}

void sound_log(FlightLog (*read)(LogStream&), std::string_view bytes) {
  refusing([&] {
    LogStream stream(as_bytes(bytes), "fuzz");
    const FlightLog log = read(stream);
    require_order(log.attitudes);
    require_order(log.positions);
    require_order(log.triggers);
    for (const auto* heights : {&log.ranges, &log.terrain_heights, &log.home_heights, &log.msl_heights}) {
      require_order(*heights);
      for (const TimedHeight& height : *heights) require(std::isfinite(height.height_m), "a height that is none");
    }
    for (const TimedAttitude& one : log.attitudes) {
      require(std::isfinite(one.aircraft.heading_rad + one.aircraft.pitch_rad + one.aircraft.roll_rad),
              "an attitude that is none");
    }
    for (const TimedPosition& one : log.positions) {
      require(std::abs(one.place.lon_deg) <= 180 && std::abs(one.place.lat_deg) <= 90, "a place that is none");
    }
    require(log.skipped_bytes <= bytes.size() && log.records <= bytes.size(), "more than there is");
    require(!log.unix_from_log_s || std::isfinite(*log.unix_from_log_s), "a date that is none");
  });
}

}  // namespace

void dataflash(std::string_view bytes) { sound_log(read_ardupilot_log, bytes); }
void ulog(std::string_view bytes) { sound_log(read_px4_log, bytes); }
void tlog(std::string_view bytes) { sound_log(read_mavlink_log, bytes); }

// The first two bytes are the length of the EXIF, the rest is XMP.
void photo_metadata(std::string_view bytes) {
  if (bytes.size() < 2) return;
  const std::size_t length =
      static_cast<unsigned char>(bytes[0]) | static_cast<unsigned>(static_cast<unsigned char>(bytes[1])) << 8;
  const std::string_view exif = bytes.substr(2, length);
  PhotoFacts facts = parse_photo_metadata(as_bytes(exif), as_bytes(bytes.substr(2 + exif.size())));
  facts.size = {4000, 3000};
  require(!facts.camera_s || std::isfinite(*facts.camera_s), "a time that is none");
  require(facts.clock_step_s > 0 && facts.clock_step_s <= 1, "a step of the clock that is none");
  for (const auto& attitude : {facts.gimbal, facts.body}) {
    require(!attitude || std::isfinite(attitude->heading_rad + attitude->pitch_rad + attitude->roll_rad),
            "an attitude that is none");
  }
  require(!facts.gps || (std::abs(facts.gps->lon_deg) <= 181 && std::abs(facts.gps->lat_deg) <= 91),
          "a place that is none");
  if (const auto draft = draft_camera(facts, {})) {
    require(std::isfinite(draft->camera.fx) && draft->camera.fx > 0, "a focal length that is none");
  }
}

}  // namespace nadir::fuzz
