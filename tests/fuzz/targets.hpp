// Readers of untrusted bytes. Each target accepts any bytes; it must not crash, hang, or throw anything but the
// reader's own exceptions, and what it accepts must round-trip through writing and reading.
//
// With clang and NADIR_FUZZ=ON each becomes a libFuzzer program, fuzz_NAME; the test `fuzz` replays the corpus with
// every compiler.
#pragma once

#include <string_view>

namespace nadir::fuzz {

void root(std::string_view bytes);
void envelope(std::string_view bytes);
void manifest(std::string_view bytes);
void mission(std::string_view bytes);
void state(std::string_view bytes);
void permit(std::string_view bytes);
void time_permit(std::string_view bytes);
void patch(std::string_view bytes);           // of a package: its file, with the header
void file_delta(std::string_view bytes);      // a body of one
void acceptance(std::string_view bytes);      // the line of acceptance.json, sealed by the target
void candidate(std::string_view bytes);       // a candidate tile's sidecar
void candidate_rows(std::string_view bytes);  // rows of a store of candidates, in any types

void stac_item(std::string_view bytes);
void stac_list(std::string_view bytes);  // of imagery, with pinned objects
void tiled_assets(std::string_view bytes);  // an item of them, beside one tile
void kml(std::string_view bytes);
void geojson(std::string_view bytes);
void plan(std::string_view bytes);       // of QGroundControl
void waypoints(std::string_view bytes);  // QGC WPL 110
void camera(std::string_view bytes);
void telemetry(std::string_view bytes);
void inertial(std::string_view bytes);  // imu.csv, and its samples preintegrated
void poses(std::string_view bytes);
void terrain(std::string_view bytes);
void matchability(std::string_view bytes);
void vectors(std::string_view bytes);       // roads, water, woods and buildings of a package
void tile_package(std::string_view bytes);  // of Esri, .tpkx
void vrt(std::string_view bytes);           // and what it names, before GDAL sees it
void numpy_array(std::string_view bytes);
void picture(std::string_view bytes);  // JPEG, PNG, WebP, TIFF
void onnx(std::string_view bytes);     // the description of a descriptor network

void shard_plan(std::string_view bytes);    // of a build by several machines: plan.json, for the target's mission
void metatile(std::string_view bytes);      // of a shard: a record without its pixels, which the target adds
void shard_result(std::string_view bytes);  // of a survey's: places of an index, a cell of matchability

void mbtiles(std::string_view bytes);    // a file's bytes
void tile_rows(std::string_view bytes);  // rows of a sound SQLite file, in any types
void cog(std::string_view bytes);
void pmtiles(std::string_view bytes);

void place_table(std::string_view bytes);

void api_hint(std::string_view bytes);
void api_object(std::string_view bytes);
void api_playback(std::string_view bytes);
void api_request(std::string_view bytes);
void mcap(std::string_view bytes);  // with the flight recorder's payloads

void batch(std::string_view bytes);  // of uploaded tiles, and the packs that they come in
void pack(std::string_view bytes);

void multipart(std::string_view bytes);       // pictures to the desk: the type on the first line, then the body
void upload_request(std::string_view bytes);  // to the candidate service
void reply(std::string_view bytes);           // of the candidate service
void installed(std::string_view bytes);       // what an aircraft reports, and the service's record of it
void tokens(std::string_view bytes);          // the service's file of tokens
void audit(std::string_view bytes);           // what a caller sends, in the audit log
void http_date(std::string_view bytes);
void outbox(std::string_view bytes);       // a file's bytes
void outbox_rows(std::string_view bytes);  // rows of an outbox that is otherwise sound, in any types

void dataflash(std::string_view bytes);       // a log of ArduPilot
void ulog(std::string_view bytes);            // a log of PX4
void tlog(std::string_view bytes);            // a log of a ground station
void photo_metadata(std::string_view bytes);  // EXIF and XMP

void answers(std::string_view bytes);      // of vision, in a stored flight
void flight_rows(std::string_view bytes);  // rows of a stored flight that is otherwise sound
void flight_file(std::string_view bytes);  // its file's bytes

void mavlink(std::string_view bytes);  // a stream from the autopilot

}  // namespace nadir::fuzz
