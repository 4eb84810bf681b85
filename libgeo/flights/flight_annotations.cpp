#include "flights/flight_annotations.hpp"

#include <fmt/format.h>

#include <cmath>

#include "base/error.hpp"
#include "imagery/sqlite_database.hpp"

namespace nadir {
namespace {

constexpr const char* kFixColumns =
    "SELECT id, before_frame, lat_deg, lon_deg, radius_m, author, time_ms, frame, pixel_x, pixel_y, sigma_m, "
    "hint_lat_deg, hint_lon_deg, hint_radius_m, withdrawn_ms, withdrawn_from FROM fix";

void check_place(const LonLat& place, double radius_m) {
  const bool valid = std::abs(place.lon_deg) <= 180 && std::abs(place.lat_deg) <= 90;  // false for NaN too
  if (valid && radius_m > 0 && std::isfinite(radius_m)) return;
  throw UsageError({.what = "the fix is not a valid place",
                    .expected = "longitude, latitude and a radius above 0 m",
                    .found = fmt::format("{},{} within {} m", place.lon_deg, place.lat_deg, radius_m)});
}

void check_pixel(const PixelPoint& pixel) {
  if (std::isfinite(pixel.x) && std::isfinite(pixel.y)) return;
  throw UsageError({.what = "the pixel is not a number", .expected = "x and y", .found = "NaN or infinity"});
}

void bind_frame(SqliteStatement& statement, int parameter, const std::optional<std::size_t>& frame) {
  if (frame) {
    statement.bind(parameter, static_cast<std::int64_t>(*frame));
  } else {
    statement.bind_null(parameter);
  }
}

std::optional<std::size_t> frame_in(const SqliteStatement& row, int column) {
  return row.is_null(column) ? std::nullopt : std::optional(static_cast<std::size_t>(row.integer(column)));
}

std::vector<UserFix> read_fixes(SqliteStatement& rows) {
  std::vector<UserFix> fixes;
  while (rows.step()) {
    UserFix& fix = fixes.emplace_back();
    fix.id = rows.integer(0);
    fix.before_frame = static_cast<std::size_t>(rows.integer(1));
    fix.place = {.lon_deg = rows.real(3), .lat_deg = rows.real(2)};
    fix.radius_m = rows.real(4);
    fix.by = rows.text(5);
    fix.time = {rows.integer(6)};
    fix.frame = frame_in(rows, 7);
    if (!rows.is_null(8) && !rows.is_null(9)) fix.pixel = {.x = rows.real(8), .y = rows.real(9)};
    fix.sigma_m = rows.real(10);
    fix.hint = {{.lon_deg = rows.real(12), .lat_deg = rows.real(11)}, rows.real(13)};
    if (!rows.is_null(14)) fix.withdrawn = UtcMillis{rows.integer(14)};
    fix.withdrawn_from = frame_in(rows, 15);
  }
  return fixes;
}

// Rows of objects joined with their sightings, in the order of both.
std::vector<MarkedObject> read_objects(SqliteStatement& rows) {
  std::vector<MarkedObject> objects;
  while (rows.step()) {
    if (objects.empty() || objects.back().id != rows.integer(0)) {
      objects.push_back({.id = rows.integer(0),
                         .name = std::string(rows.text(1)),
                         .by = std::string(rows.text(2)),
                         .time = {rows.integer(3)}});
    }
    objects.back().sightings.push_back({.id = rows.integer(4),
                                        .frame = static_cast<std::size_t>(rows.integer(5)),
                                        .pixel = {.x = rows.real(6), .y = rows.real(7)}});
  }
  return objects;
}

constexpr const char* kObjectRows =
    "SELECT o.id, o.name, o.author, o.time_ms, s.id, s.frame, s.pixel_x, s.pixel_y FROM object o "
    "JOIN sighting s ON s.object = o.id";

}  // namespace

std::int64_t FlightAnnotations::number(std::string_view sql, std::optional<std::int64_t> parameter) const {
  auto statement = database_.prepare(sql);
  if (parameter) statement.bind(1, *parameter);
  return statement.step() ? statement.integer(0) : 0;
}

bool FlightAnnotations::changed() const { return number("SELECT changes()") > 0; }

std::int64_t FlightAnnotations::insert_fix(const UserFix& fix) const {
  check_place(fix.place, fix.radius_m);
  check_place(fix.hint.place, fix.hint.radius_m);
  check_place(fix.place, fix.sigma_m);
  if (fix.pixel) check_pixel(*fix.pixel);
  auto insert = database_.prepare(
      "INSERT INTO fix (before_frame, lat_deg, lon_deg, radius_m, author, time_ms, frame, pixel_x, pixel_y, sigma_m, "
      "hint_lat_deg, hint_lon_deg, hint_radius_m) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  insert.bind(1, static_cast<std::int64_t>(fix.before_frame));
  insert.bind_real(2, fix.place.lat_deg).bind_real(3, fix.place.lon_deg).bind_real(4, fix.radius_m);
  insert.bind(5, fix.by).bind(6, fix.time.unix_ms);
  bind_frame(insert, 7, fix.frame);
  insert.bind_real(8, fix.pixel ? std::optional(fix.pixel->x) : std::nullopt);
  insert.bind_real(9, fix.pixel ? std::optional(fix.pixel->y) : std::nullopt);
  insert.bind_real(10, fix.sigma_m);
  insert.bind_real(11, fix.hint.place.lat_deg).bind_real(12, fix.hint.place.lon_deg).bind_real(13, fix.hint.radius_m);
  insert.run();
  return number("SELECT last_insert_rowid()");
}

bool FlightAnnotations::withdraw_fix(std::int64_t id, std::size_t from_frame, UtcMillis now) const {
  database_.prepare("UPDATE fix SET withdrawn_ms = ?, withdrawn_from = ? WHERE id = ? AND withdrawn_ms IS NULL")
      .bind(1, now.unix_ms)
      .bind(2, static_cast<std::int64_t>(from_frame))
      .bind(3, id)
      .run();
  return changed();
}

std::vector<UserFix> FlightAnnotations::fixes() const {
  auto rows = database_.prepare(fmt::format("{} ORDER BY id", kFixColumns));
  return read_fixes(rows);
}

std::vector<UserFix> FlightAnnotations::fixes_before(std::size_t frame) const {
  auto rows = database_.prepare(
      fmt::format("{} WHERE before_frame = ? AND (withdrawn_from IS NULL OR before_frame < withdrawn_from) ORDER BY id",
                  kFixColumns));
  rows.bind(1, static_cast<std::int64_t>(frame));
  return read_fixes(rows);
}

std::int64_t FlightAnnotations::insert_object(const MarkedObject& object) const {
  if (number("SELECT count(*) FROM object") >= static_cast<std::int64_t>(kMaxFlightObjects)) {
    throw UsageError({.what = "the flight has no room for another object",
                      .expected = fmt::format("at most {} objects", kMaxFlightObjects),
                      .fix = "remove some of them"});
  }
  database_.prepare("INSERT INTO object (name, author, time_ms) VALUES (?, ?, ?)")
      .bind(1, object.name)
      .bind(2, object.by)
      .bind(3, object.time.unix_ms)
      .run();
  const std::int64_t id = number("SELECT last_insert_rowid()");
  for (const MarkedSighting& sighting : object.sightings) insert_sighting(id, sighting);
  return id;
}

std::int64_t FlightAnnotations::insert_sighting(std::int64_t object, const MarkedSighting& sighting) const {
  check_pixel(sighting.pixel);
  const std::int64_t known = number("SELECT count(*) FROM sighting WHERE object = ?", object);
  if (known >= static_cast<std::int64_t>(kMaxObjectSightings)) {
    throw UsageError({.what = "the object has as many sightings as it may have",
                      .expected = fmt::format("at most {}", kMaxObjectSightings),
                      .fix = "remove the worst of them"});
  }
  auto insert = database_.prepare("INSERT INTO sighting (object, frame, pixel_x, pixel_y) VALUES (?, ?, ?, ?)");
  insert.bind(1, object).bind(2, static_cast<std::int64_t>(sighting.frame));
  insert.bind_real(3, sighting.pixel.x).bind_real(4, sighting.pixel.y).run();
  return number("SELECT last_insert_rowid()");
}

bool FlightAnnotations::rename_object(std::int64_t id, std::string_view name) const {
  database_.prepare("UPDATE object SET name = ? WHERE id = ?").bind(1, name).bind(2, id).run();
  return changed();
}

bool FlightAnnotations::remove_object(std::int64_t id) const {
  database_.prepare("DELETE FROM sighting WHERE object = ?").bind(1, id).run();
  database_.prepare("DELETE FROM object WHERE id = ?").bind(1, id).run();
  return changed();
}

bool FlightAnnotations::remove_sighting(std::int64_t object, std::int64_t sighting) const {
  database_.prepare("DELETE FROM sighting WHERE id = ? AND object = ?").bind(1, sighting).bind(2, object).run();
  if (!changed()) return false;
  if (number("SELECT count(*) FROM sighting WHERE object = ?", object) > 0) return true;
  throw UsageError({.what = "an object needs a sighting", .found = "this is its last one", .fix = "remove the object"});
}

std::vector<MarkedObject> FlightAnnotations::objects() const {
  auto rows = database_.prepare(fmt::format("{} ORDER BY o.id, s.id", kObjectRows));
  return read_objects(rows);
}

std::optional<MarkedObject> FlightAnnotations::object(std::int64_t id) const {
  auto rows = database_.prepare(fmt::format("{} WHERE o.id = ? ORDER BY s.id", kObjectRows));
  rows.bind(1, id);
  std::vector<MarkedObject> found = read_objects(rows);
  return found.empty() ? std::nullopt : std::optional(std::move(found.front()));
}

}  // namespace nadir
