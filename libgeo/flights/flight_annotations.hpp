// What people say about a flight: fixes (where a frame was taken), and objects that they mark in its pictures.
//
// A fix is either a place with a radius in which the aircraft was, or a point that a person found in a picture and on
// the map. It does two things. Before the next frame is processed it is a hint: the aircraft is looked for at
// `hint` first. In the adjustment of the flight a point in a picture is ground control.
//
// A fix that is withdrawn stays in the record. Frames that were processed with it are estimated from it again when the
// flight is resumed, or their estimates would not be those that were published; frames from `withdrawn_from` on and
// adjustments do without it.
//
// An object is what its sightings show. Where it is on the ground depends on poses that get better with time, and is
// computed when it is asked for; it is not stored.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/time.hpp"
#include "geodesy/lon_lat.hpp"

namespace nadir {

class SqliteDatabase;

inline constexpr double kHintRadiusSigmas = 2;  // of a place with a radius, as the localizer takes a hint
inline constexpr double kPixelFixSigma_m = 5;   // of a point that a person finds in a picture and on the map
inline constexpr std::size_t kMaxFlightObjects = 1000;
inline constexpr std::size_t kMaxObjectSightings = 32;  // of one object
inline constexpr std::size_t kMaxObjectName = 200;      // bytes

// In a picture as it was sent, in its full size; the centre of the top-left pixel is (0, 0).
struct PixelPoint {
  double x = 0, y = 0;
};

struct SearchHint {
  LonLat place;
  double radius_m = 0;  // kHintRadiusSigmas of each axis
};

struct UserFix {
  std::int64_t id = 0;
  std::size_t before_frame = 0;  // the hint is applied before this frame is processed
  LonLat place;                  // with a pixel what the picture shows there, otherwise the aircraft
  double radius_m = 0;           // around `place`
  std::string by;
  UtcMillis time;
  std::optional<std::size_t> frame{};  // that the person looked at; nothing: the next one
  std::optional<PixelPoint> pixel{};   // in the picture of `frame`
  double sigma_m = 0;                  // of `place`, each axis
  SearchHint hint{};                   // `place` and `radius_m`, carried to the aircraft and to `before_frame`
  std::optional<UtcMillis> withdrawn{};
  std::optional<std::size_t> withdrawn_from{};  // frames from here on are processed without it

  // Whether frames that it was said before are processed with it, withdrawn or not.
  bool applied() const { return !withdrawn_from || before_frame < *withdrawn_from; }
};

struct MarkedSighting {
  std::int64_t id = 0;
  std::size_t frame = 0;
  PixelPoint pixel{};
};

struct MarkedObject {
  std::int64_t id = 0;
  std::string name;
  std::string by;
  UtcMillis time;
  std::vector<MarkedSighting> sightings{};  // at least one
};

// Rows of the tables fix, object and sighting. Callers hold the store's lock, and a transaction for what changes.
class FlightAnnotations {
 public:
  // database: must outlive this.
  explicit FlightAnnotations(const SqliteDatabase& database) : database_(database) {}

  // Throw UsageError for invalid places, radii and pixels.
  std::int64_t insert_fix(const UserFix& fix) const;
  // False: there is no such fix, or it is withdrawn already.
  bool withdraw_fix(std::int64_t id, std::size_t from_frame, UtcMillis now) const;
  std::vector<UserFix> fixes() const;                          // by number, withdrawn ones too
  std::vector<UserFix> fixes_before(std::size_t frame) const;  // that are applied there

  std::int64_t insert_object(const MarkedObject& object) const;  // with its sightings
  std::int64_t insert_sighting(std::int64_t object, const MarkedSighting& sighting) const;
  bool rename_object(std::int64_t id, std::string_view name) const;
  bool remove_object(std::int64_t id) const;
  // Throws UsageError for an object's last sighting.
  bool remove_sighting(std::int64_t object, std::int64_t sighting) const;
  std::vector<MarkedObject> objects() const;
  std::optional<MarkedObject> object(std::int64_t id) const;

 private:
  std::int64_t number(std::string_view sql, std::optional<std::int64_t> parameter = std::nullopt) const;
  bool changed() const;  // by the last statement

  const SqliteDatabase& database_;
};

}  // namespace nadir
