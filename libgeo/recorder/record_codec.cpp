// One pair of encode() and decode() for each record. decode() is false for bytes that are no such record.
#include "recorder/record_codec.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <string>

#include "base/bytes.hpp"
#include "fbs/anchor_generated.h"
#include "fbs/common_generated.h"
#include "fbs/end_generated.h"
#include "fbs/estimate_generated.h"
#include "fbs/fix_generated.h"
#include "fbs/fix_input_generated.h"
#include "fbs/health_generated.h"
#include "fbs/hint_generated.h"
#include "fbs/input_generated.h"
#include "fbs/picture_generated.h"
#include "fbs/recorder_event_generated.h"
#include "fbs/session_generated.h"
#include "fbs/state_change_generated.h"
#include "fbs/thumbnail_generated.h"
#include "fbs/tile_event_generated.h"
#include "geodesy/lon_lat.hpp"
#include "recorder/records.hpp"

namespace nadir {
namespace {
namespace codec {

namespace fbs = nadir::recorder;
using flatbuffers::FlatBufferBuilder;

std::string text(const flatbuffers::String* text) { return text == nullptr ? std::string() : text->str(); }

Bytes bytes(const flatbuffers::Vector<std::uint8_t>* bytes) {
  return bytes == nullptr ? Bytes() : Bytes(bytes->begin(), bytes->end());
}

template <typename Number>
std::optional<double> optional(const Number& number) {
  return number ? std::optional<double>(*number) : std::nullopt;
}

flatbuffers::Optional<double> optional(const std::optional<double>& number) {
  return number ? flatbuffers::Optional<double>(*number) : flatbuffers::nullopt;
}

fbs::LonLat place(LonLat place) { return {place.lon_deg, place.lat_deg}; }

std::optional<LonLat> place(const fbs::LonLat* place) {
  if (place == nullptr) return std::nullopt;
  return LonLat{place->lon_deg(), place->lat_deg()};
}

fbs::AnchorVerdict verdict(AnchorVerdict verdict) {
  return static_cast<fbs::AnchorVerdict>(static_cast<std::uint8_t>(verdict));
}

// Verdicts of a later version are read as "not tried".
AnchorVerdict verdict(fbs::AnchorVerdict verdict) {
  if (verdict > fbs::AnchorVerdict::MAX) return AnchorVerdict::not_tried;
  return static_cast<AnchorVerdict>(static_cast<std::uint8_t>(verdict));
}

template <typename Table>
Bytes finish(FlatBufferBuilder& builder, flatbuffers::Offset<Table> root) {
  builder.Finish(root);
  return {builder.GetBufferPointer(), builder.GetBufferPointer() + builder.GetSize()};
}

// The table, or null for invalid bytes.
template <typename Table>
const Table* verified(ByteView bytes) {
  flatbuffers::Verifier verifier(bytes.data(), bytes.size(), 16, 100'000);
  if (bytes.size() < 8 || !verifier.VerifyBuffer<Table>(nullptr)) return nullptr;
  return flatbuffers::GetRoot<Table>(bytes.data());
}

constexpr std::uint32_t kFormat = 1;

flatbuffers::Offset<fbs::Camera> camera(FlatBufferBuilder& builder, const CameraFile& file) {
  const CameraModel& c = file.camera;
  const auto distortion = builder.CreateVector(c.distortion.data(), c.distortion.size());
  return fbs::CreateCamera(builder, c.width, c.height, c.fx, c.fy, c.cx, c.cy, distortion, file.uncertainty.heading_rad,
                           file.uncertainty.agl_relative, file.uncertainty.tilt_rad, file.uncertainty.imu_dv_mps,
                           file.readout ? file.readout->duration_s : 0,
                           file.readout ? static_cast<std::uint8_t>(file.readout->direction) : std::uint8_t{0},
                           file.on_gimbal);
}

CameraFile camera(const fbs::Camera& table) {
  CameraFile file;
  CameraModel& c = file.camera;
  c.width = table.width();
  c.height = table.height();
  c.fx = table.fx();
  c.fy = table.fy();
  c.cx = table.cx();
  c.cy = table.cy();
  const auto* distortion = table.distortion();
  for (unsigned i = 0; distortion != nullptr && i < distortion->size() && i < c.distortion.size(); ++i) {
    c.distortion[i] = distortion->Get(i);
  }
  file.uncertainty = {table.heading_sigma_rad(), table.agl_sigma_relative(), table.tilt_sigma_rad(),
                      table.imu_dv_sigma_mps()};
  if (table.readout_s() > 0) {
    constexpr auto kLast = static_cast<std::uint8_t>(SensorReadout::Direction::left);
    const auto direction = static_cast<SensorReadout::Direction>(std::min(table.readout_direction(), kLast));
    file.readout = SensorReadout{table.readout_s(), direction};
  }
  file.on_gimbal = table.on_gimbal();
  return file;
}

flatbuffers::Offset<fbs::Localizer> localizer(FlatBufferBuilder& builder, const SessionRecord& session) {
  const LocalizerConfig& config = session.localizer;
  std::optional<fbs::Box> area;
  if (config.area) area.emplace(config.area->west_m, config.area->south_m, config.area->east_m, config.area->north_m);
  return fbs::CreateLocalizer(builder, config.start_sigma_m, config.min_search_radius_m, config.max_search_radius_m,
                              config.no_fix_sigma_m, config.map_sigma_m.value_or(0), config.assumed_agl_m,
                              area ? &*area : nullptr, session.terrain, config.anchor_every_m,
                              config.anchor_above_sigma_m, session.places, config.resumed, config.integrity_risk,
                              session.matchability);
}

void localizer(const fbs::Localizer& table, SessionRecord& session) {
  LocalizerConfig& config = session.localizer;
  config.start_sigma_m = table.start_sigma_m();
  config.min_search_radius_m = table.min_search_radius_m();
  config.max_search_radius_m = table.max_search_radius_m();
  config.no_fix_sigma_m = table.no_fix_sigma_m();
  config.map_sigma_m = table.map_sigma_m() != 0 ? std::optional(table.map_sigma_m()) : std::nullopt;
  config.assumed_agl_m = table.assumed_agl_m();
  if (const auto* area = table.area(); area != nullptr) {
    config.area = PlaneBox{area->west_m(), area->south_m(), area->east_m(), area->north_m()};
  }
  config.anchor_every_m = table.anchor_every_m();
  config.anchor_above_sigma_m = table.anchor_above_sigma_m();
  config.resumed = table.resumed();
  config.integrity_risk = table.integrity_risk();
  session.terrain = table.terrain();
  session.places = table.places();
  session.matchability = table.matchability();
}

Bytes encode(const SessionRecord& session) {
  FlatBufferBuilder builder;
  std::vector<flatbuffers::Offset<fbs::Setting>> list;
  for (const auto& [name, value] : session.settings) {
    list.push_back(fbs::CreateSettingDirect(builder, name.c_str(), redacted_setting(name, value).c_str()));
  }
  const auto settings = builder.CreateVector(list);
  const auto id = builder.CreateString(session.id), program = builder.CreateString(session.program),
             version = builder.CreateString(session.version), airframe = builder.CreateString(session.airframe),
             mission = builder.CreateString(session.mission);
  flatbuffers::Offset<flatbuffers::String> package;
  if (session.package) package = builder.CreateString(session.package->hex());
  const auto camera_table = camera(builder, session.camera);
  const auto localizer_table = localizer(builder, session);
  const fbs::LonLat origin = place(session.origin), start = place(session.start.value_or(LonLat{}));
  return finish(
      builder, fbs::CreateSession(builder, kFormat, id, session.segment, session.started_ns, program, version, airframe,
                                  package, mission, camera_table, &origin, session.start ? &start : nullptr,
                                  static_cast<std::uint32_t>(session.picture_shrink), session.seed, localizer_table,
                                  settings, session.looked_up_later));
}

bool decode(ByteView bytes, SessionRecord& session) {
  const auto* table = verified<fbs::Session>(bytes);
  if (table == nullptr || table->format() != kFormat) return false;
  session.id = text(table->id());
  session.segment = table->segment();
  session.started_ns = table->started_ns();
  session.program = text(table->program());
  session.version = text(table->version());
  session.airframe = text(table->airframe());
  if (table->package_sha256() != nullptr) {
    session.package = Sha256::from_hex(text(table->package_sha256()));
    if (!session.package) return false;
  }
  session.mission = text(table->mission());
  if (table->camera() != nullptr) session.camera = camera(*table->camera());
  session.origin = place(table->origin()).value_or(LonLat{});
  session.start = place(table->start());
  if (table->picture_shrink() == 0 || table->picture_shrink() > 8) return false;
  session.picture_shrink = static_cast<int>(table->picture_shrink());
  session.seed = table->seed();
  session.looked_up_later = table->looked_up_later();
  if (table->localizer() != nullptr) localizer(*table->localizer(), session);
  if (table->settings() != nullptr) {
    for (const auto* setting : *table->settings()) {
      session.settings.emplace_back(text(setting->name()), text(setting->value()));
    }
  }
  return true;
}

std::optional<fbs::VelocityChange> velocity_change(const std::optional<Eigen::Vector2d>& dv_mps) {
  if (!dv_mps) return std::nullopt;
  return fbs::VelocityChange(dv_mps->x(), dv_mps->y());
}

std::optional<Eigen::Vector2d> velocity_change(const fbs::VelocityChange* dv) {
  if (dv == nullptr) return std::nullopt;
  return Eigen::Vector2d(dv->east_mps(), dv->north_mps());
}

flatbuffers::Offset<flatbuffers::Vector<flatbuffers::Offset<fbs::Stretch>>> encode_intervals(
    FlatBufferBuilder& builder, const std::vector<TelemetryInterval>& intervals) {
  std::vector<flatbuffers::Offset<fbs::Stretch>> stretches;
  for (const TelemetryInterval& interval : intervals) {
    const auto dv = velocity_change(interval.imu_dv_mps);
    stretches.push_back(
        fbs::CreateStretch(builder, interval.seconds, optional(interval.heading_rad), dv ? &*dv : nullptr));
  }
  return builder.CreateVector(stretches);
}

std::vector<TelemetryInterval> decode_intervals(const flatbuffers::Vector<flatbuffers::Offset<fbs::Stretch>>* table) {
  std::vector<TelemetryInterval> intervals;
  if (table == nullptr) return intervals;
  for (const fbs::Stretch* stretch : *table) {
    intervals.push_back({stretch->seconds(), optional(stretch->heading_rad()), velocity_change(stretch->imu_dv())});
  }
  return intervals;
}

std::vector<fbs::InertialSample> encode_inertial(const std::vector<InertialSample>& samples) {
  std::vector<fbs::InertialSample> encoded;
  encoded.reserve(samples.size());
  for (const InertialSample& sample : samples) {
    const auto &rate = sample.rate_rad_s, &force = sample.force_mps2;
    encoded.emplace_back(sample.time_s, rate.x(), rate.y(), rate.z(), force.x(), force.y(), force.z());
  }
  return encoded;
}

std::vector<InertialSample> decode_inertial(const flatbuffers::Vector<const fbs::InertialSample*>* table) {
  std::vector<InertialSample> samples;
  if (table == nullptr) return samples;
  samples.reserve(table->size());
  for (const fbs::InertialSample* sample : *table) {
    samples.push_back({sample->time_s(),
                       {sample->rate_x_rad_s(), sample->rate_y_rad_s(), sample->rate_z_rad_s()},
                       {sample->force_x_mps2(), sample->force_y_mps2(), sample->force_z_mps2()}});
  }
  return samples;
}

Bytes encode(const InputRecord& input) {
  FlatBufferBuilder builder;
  const Telemetry& telemetry = input.telemetry;
  const auto frame = builder.CreateString(telemetry.frame);
  const auto picture = builder.CreateString(input.picture.hex());
  const fbs::LonLat at = place(telemetry.gps_position.value_or(LonLat{}));
  const auto dv = velocity_change(telemetry.imu_dv_mps);
  const auto intervals = encode_intervals(builder, telemetry.intervals);
  const Eigen::Vector3d turn = telemetry.rate_rad_s.value_or(Eigen::Vector3d::Zero());
  const fbs::TurnRate rate(turn.x(), turn.y(), turn.z());
  // Without samples the record is the same as before there were any.
  flatbuffers::Offset<flatbuffers::Vector<const fbs::InertialSample*>> inertial;
  if (!telemetry.inertial.empty()) inertial = builder.CreateVectorOfStructs(encode_inertial(telemetry.inertial));
  return finish(builder, fbs::CreateInput(builder, input.index, frame, telemetry.time_s, optional(telemetry.agl_m),
                                          optional(telemetry.heading_rad), optional(telemetry.pitch_rad),
                                          optional(telemetry.roll_rad), telemetry.gps_position ? &at : nullptr, picture,
                                          input.picture_bytes, dv ? &*dv : nullptr, intervals,
                                          telemetry.rate_rad_s ? &rate : nullptr, inertial));
}

bool decode(ByteView bytes, InputRecord& input) {
  const auto* table = verified<fbs::Input>(bytes);
  if (table == nullptr) return false;
  const auto digest = Sha256::from_hex(text(table->picture_sha256()));
  if (!digest) return false;
  input.index = table->index();
  input.telemetry.frame = text(table->frame());
  input.telemetry.time_s = table->time_s();
  input.telemetry.agl_m = optional(table->agl_m());
  input.telemetry.heading_rad = optional(table->heading_rad());
  input.telemetry.pitch_rad = optional(table->pitch_rad());
  input.telemetry.roll_rad = optional(table->roll_rad());
  input.telemetry.gps_position = place(table->place());
  input.telemetry.imu_dv_mps = velocity_change(table->imu_dv());
  input.telemetry.intervals = decode_intervals(table->way());
  if (const auto* rate = table->rate(); rate != nullptr) {
    input.telemetry.rate_rad_s = {rate->roll_rad_s(), rate->pitch_rad_s(), rate->yaw_rad_s()};
  }
  input.telemetry.inertial = decode_inertial(table->inertial());
  input.picture = *digest;
  input.picture_bytes = table->picture_bytes();
  return true;
}

Bytes encode(const FrameRecord& picture) {
  FlatBufferBuilder builder(picture.encoded.size() + 256);
  const auto frame = builder.CreateString(picture.frame);
  const auto data = builder.CreateVector(picture.encoded);
  return finish(builder, fbs::CreatePicture(builder, picture.index, frame, data));
}

bool decode(ByteView encoded, FrameRecord& picture) {
  const auto* table = verified<fbs::Picture>(encoded);
  if (table == nullptr) return false;
  picture.index = table->index();
  picture.frame = text(table->frame());
  picture.encoded = bytes(table->data());
  return true;
}

Bytes encode(const EstimateRecord& record) {
  FlatBufferBuilder builder;
  const Estimate& e = record.estimate;
  const auto frame = builder.CreateString(e.frame);
  const fbs::LonLat at = place(e.position.value_or(LonLat{}));
  const fbs::Covariance covariance(e.covariance_m2(0, 0), e.covariance_m2(0, 1), e.covariance_m2(1, 0),
                                   e.covariance_m2(1, 1));
  const StateEstimate& b = record.state;
  const fbs::Belief belief(b.velocity_mps.x(), b.velocity_mps.y(), b.velocity_sigma_mps, b.heading_rad,
                           b.heading_sigma_rad, b.agl_m, b.agl_sigma_m);
  return finish(builder,
                fbs::CreateEstimate(builder, record.index, frame, e.time_s, e.position ? &at : nullptr, e.sigma_m,
                                    &covariance, static_cast<fbs::Source>(static_cast<std::uint8_t>(e.source)),
                                    e.segment, optional(e.anchor_age_s), e.anchor_inliers, e.anchor_ratio, e.latency_ms,
                                    record.odometry.tracked, record.odometry.inliers, record.odometry.step_m, &belief,
                                    optional(e.hpl_m)));
}

bool decode(ByteView bytes, EstimateRecord& record) {
  const auto* table = verified<fbs::Estimate>(bytes);
  if (table == nullptr || table->source() > fbs::Source::MAX) return false;
  record.index = table->index();
  Estimate& e = record.estimate;
  e.frame = text(table->frame());
  e.time_s = table->time_s();
  e.position = place(table->position());
  e.sigma_m = table->sigma_m();
  if (const auto* c = table->covariance(); c != nullptr) {
    e.covariance_m2 << c->ee_m2(), c->en_m2(), c->ne_m2(), c->nn_m2();
  }
  e.source = static_cast<SourceLabel>(static_cast<std::uint8_t>(table->source()));
  e.segment = table->segment();
  e.anchor_age_s = optional(table->anchor_age_s());
  e.anchor_inliers = table->anchor_inliers();
  e.anchor_ratio = table->anchor_ratio();
  e.latency_ms = table->latency_ms();
  if (const auto* b = table->belief(); b != nullptr) {
    record.state = {{b->east_mps(), b->north_mps()},
                    b->velocity_sigma_mps(),
                    b->heading_rad(),
                    b->heading_sigma_rad(),
                    b->agl_m(),
                    b->agl_sigma_m()};
  }
  record.odometry = {table->tracked(), table->odometry_inliers(), table->odometry_step_m()};
  e.hpl_m = optional(table->hpl_m());
  return true;
}

Bytes encode(const AnchorRecord& record) {
  FlatBufferBuilder builder;
  const AnchorReport& a = record.anchor;
  const auto frame = builder.CreateString(record.frame);
  std::optional<fbs::PlanePoint> camera;
  if (a.camera) camera.emplace(a.camera->east_m, a.camera->north_m);
  return finish(builder, fbs::CreateAnchor(builder, record.index, frame, record.time_s, verdict(a.verdict), a.score,
                                           a.ratio, a.inliers, a.patches, a.residual_px, a.matching_gsd_m, a.chi2,
                                           camera ? &*camera : nullptr, a.heading_rad, a.window_radius_m,
                                           record.taken_after, a.log_likelihood_ratio, a.place_doubt));
}

bool decode(ByteView bytes, AnchorRecord& record) {
  const auto* table = verified<fbs::Anchor>(bytes);
  if (table == nullptr) return false;
  record.index = table->index();
  record.frame = text(table->frame());
  record.time_s = table->time_s();
  AnchorReport& a = record.anchor;
  a.verdict = verdict(table->verdict());
  a.score = table->score();
  a.ratio = table->ratio();
  a.inliers = table->inliers();
  a.patches = table->patches();
  a.residual_px = table->residual_px();
  a.matching_gsd_m = table->matching_gsd_m();
  a.chi2 = table->chi2();
  if (table->camera() != nullptr) a.camera = PlanePoint{table->camera()->east_m(), table->camera()->north_m()};
  a.heading_rad = table->heading_rad();
  a.window_radius_m = table->window_radius_m();
  record.taken_after = table->taken_after();
  a.log_likelihood_ratio = table->log_likelihood_ratio();
  a.place_doubt = table->place_doubt();
  return true;
}

Bytes encode(const StateRecord& record) {
  FlatBufferBuilder builder;
  return finish(builder,
                fbs::CreateStateChangeDirect(builder, record.from.c_str(), record.to.c_str(), record.reason.c_str()));
}

bool decode(ByteView bytes, StateRecord& record) {
  const auto* table = verified<fbs::StateChange>(bytes);
  if (table == nullptr) return false;
  record = {text(table->from()), text(table->to()), text(table->reason())};
  return true;
}

Bytes encode(const TileRecord& record) {
  FlatBufferBuilder builder;
  return finish(builder, fbs::CreateTileEventDirect(builder, record.key.z, record.key.x, record.key.y,
                                                    record.code.c_str(), record.text.c_str()));
}

bool decode(ByteView bytes, TileRecord& record) {
  const auto* table = verified<fbs::TileEvent>(bytes);
  if (table == nullptr) return false;
  if (table->zoom() < 0 || table->zoom() > kMaxZoom || table->x() < 0 || table->y() < 0) return false;
  record.key = {static_cast<std::uint8_t>(table->zoom()), static_cast<std::uint32_t>(table->x()),
                static_cast<std::uint32_t>(table->y())};
  if (table->x() != record.key.x || table->y() != record.key.y || !record.key.valid()) return false;
  record.code = text(table->code());
  record.text = text(table->text());
  return true;
}

Bytes encode(const HealthRecord& record) {
  FlatBufferBuilder builder;
  std::vector<flatbuffers::Offset<fbs::Measure>> list;
  for (const auto& [name, value] : record.measures) {
    list.push_back(fbs::CreateMeasureDirect(builder, name.c_str(), value));
  }
  const auto measures = builder.CreateVector(list);
  const auto notes = builder.CreateVectorOfStrings(record.notes);
  return finish(builder, fbs::CreateHealth(builder, record.healthy, measures, notes));
}

bool decode(ByteView bytes, HealthRecord& record) {
  const auto* table = verified<fbs::Health>(bytes);
  if (table == nullptr) return false;
  record.healthy = table->healthy();
  if (table->measures() != nullptr) {
    for (const auto* measure : *table->measures())
      record.measures.emplace_back(text(measure->name()), measure->value());
  }
  if (table->notes() != nullptr) {
    for (const auto* note : *table->notes()) record.notes.push_back(text(note));
  }
  return true;
}

Bytes encode(const ThumbnailRecord& record) {
  FlatBufferBuilder builder(record.seen.size() + record.map.size() + 256);
  const auto frame = builder.CreateString(record.frame);
  const auto seen = builder.CreateVector(record.seen), map = builder.CreateVector(record.map);
  return finish(builder, fbs::CreateThumbnail(builder, record.index, frame, verdict(record.verdict), seen, map));
}

bool decode(ByteView encoded, ThumbnailRecord& record) {
  const auto* table = verified<fbs::Thumbnail>(encoded);
  if (table == nullptr) return false;
  record = {table->index(), text(table->frame()), verdict(table->verdict()), bytes(table->seen()), bytes(table->map())};
  return true;
}

Bytes encode(const RecorderRecord& record) {
  FlatBufferBuilder builder;
  const auto kind = static_cast<fbs::RecorderEventKind>(static_cast<std::uint8_t>(record.kind));
  return finish(builder,
                fbs::CreateRecorderEventDirect(builder, kind, record.topic.c_str(), record.count, record.text.c_str()));
}

bool decode(ByteView bytes, RecorderRecord& record) {
  const auto* table = verified<fbs::RecorderEvent>(bytes);
  if (table == nullptr || table->kind() > fbs::RecorderEventKind::MAX) return false;
  record.kind = static_cast<RecorderEventKind>(static_cast<std::uint8_t>(table->kind()));
  record.topic = text(table->topic());
  record.count = table->count();
  record.text = text(table->text());
  return true;
}

Bytes encode(const EndRecord& record) {
  FlatBufferBuilder builder;
  return finish(builder, fbs::CreateEndDirect(builder, record.clean_shutdown, record.records, record.dropped,
                                              record.reason.c_str()));
}

bool decode(ByteView bytes, EndRecord& record) {
  const auto* table = verified<fbs::End>(bytes);
  if (table == nullptr) return false;
  record = {table->clean_shutdown(), table->records(), table->dropped(), text(table->reason())};
  return true;
}

Bytes encode(const HintRecord& record) {
  FlatBufferBuilder builder;
  const fbs::LonLat at = place(record.place);
  return finish(builder, fbs::CreateHintDirect(builder, record.before, &at, record.radius_m, record.by.c_str()));
}

bool decode(ByteView bytes, HintRecord& record) {
  const auto* table = verified<fbs::Hint>(bytes);
  if (table == nullptr || table->place() == nullptr) return false;
  record = {table->before(), *place(table->place()), table->radius_m(), text(table->by())};
  return true;
}

Bytes encode(const FixRecord& record) {
  FlatBufferBuilder builder;
  const fbs::LonLat at = place(record.place.value_or(LonLat{}));
  flatbuffers::Offset<fbs::Receiver> gps;
  if (record.gps) {
    const fbs::LonLat gps_at = place(record.gps->place);
    gps = fbs::CreateReceiver(builder, record.gps->age_s, static_cast<std::uint8_t>(record.gps->fix_type), &gps_at,
                              record.gps->msl_m, optional(record.gps->accuracy_m));
  }
  return finish(
      builder,
      fbs::CreateFix(builder, record.time_s, record.unix_us, static_cast<std::uint8_t>(record.fix_type),
                     static_cast<fbs::FixSource>(static_cast<std::uint8_t>(record.source)),
                     record.place ? &at : nullptr, optional(record.msl_m), optional(record.accuracy_m),
                     optional(record.vertical_accuracy_m), optional(record.north_mps), optional(record.east_mps),
                     optional(record.down_mps), optional(record.speed_accuracy_mps), gps));
}

bool decode(ByteView bytes, FixRecord& record) {
  const auto* table = verified<fbs::Fix>(bytes);
  if (table == nullptr || table->source() > fbs::FixSource::MAX) return false;
  record.time_s = table->time_s();
  record.unix_us = table->unix_us();
  record.fix_type = table->fix_type();
  record.source = static_cast<SourceLabel>(static_cast<std::uint8_t>(table->source()));
  record.place = place(table->position());
  record.msl_m = optional(table->msl_m());
  record.accuracy_m = optional(table->accuracy_m());
  record.vertical_accuracy_m = optional(table->vertical_accuracy_m());
  record.north_mps = optional(table->north_mps());
  record.east_mps = optional(table->east_mps());
  record.down_mps = optional(table->down_mps());
  record.speed_accuracy_mps = optional(table->speed_accuracy_mps());
  if (const auto* gps = table->gps(); gps != nullptr) {
    record.gps = FixRecord::Receiver{gps->age_s(), gps->fix_type(), place(gps->position()).value_or(LonLat{}),
                                     gps->msl_m(), optional(gps->accuracy_m())};
  }
  return true;
}

// The inputs go into one vector for each kind, which needs no table for each of them; `order` is their sequence.
Bytes encode(const FixInputRecord& record) {
  FlatBufferBuilder builder;
  std::vector<fbs::FixInputKind> order;
  std::vector<fbs::AttitudeInput> attitudes;
  std::vector<fbs::AccelerationInput> accelerations;
  std::vector<fbs::EstimateInput> estimates;
  for (const FixInputRecord::Input& input : record.inputs) {
    const auto before_us = static_cast<std::uint32_t>(record.time_us - input.time_us);
    if (const auto* attitude = std::get_if<FixInputRecord::Attitude>(&input.what)) {
      order.push_back(fbs::FixInputKind::attitude);
      attitudes.emplace_back(before_us, attitude->roll_rad, attitude->pitch_rad, attitude->yaw_rad);
    } else if (const auto* force = std::get_if<FixInputRecord::Acceleration>(&input.what)) {
      order.push_back(fbs::FixInputKind::acceleration);
      accelerations.emplace_back(before_us, force->forward_mps2, force->right_mps2, force->down_mps2);
    } else {
      const auto& estimate = std::get<FixInputRecord::ArrivedEstimate>(input.what);
      order.push_back(fbs::FixInputKind::estimate);
      estimates.emplace_back(estimate.index, before_us, estimate.late);
    }
  }
  const auto kinds = builder.CreateVector(order);
  const auto attitude_list = builder.CreateVectorOfStructs(attitudes);
  const auto acceleration_list = builder.CreateVectorOfStructs(accelerations);
  const auto estimate_list = builder.CreateVectorOfStructs(estimates);
  const FixStatus& status = record.status;
  return finish(builder, fbs::CreateFixInput(
                             builder, record.number, record.time_us, record.unix_us, status.served, status.permitted,
                             static_cast<fbs::FixSource>(static_cast<std::uint8_t>(status.source)), status.sigma_m,
                             record.sent, record.missing, kinds, attitude_list, acceleration_list, estimate_list));
}

constexpr std::int64_t kMaxTime_us = 1'000'000'000'000'000'000;  // no difference of two times overflows

bool decode(ByteView bytes, FixInputRecord& record) {
  const auto* table = verified<fbs::FixInput>(bytes);
  if (table == nullptr || table->source() > fbs::FixSource::MAX) return false;
  const auto plausible = [](std::int64_t time_us) { return time_us >= 0 && time_us <= kMaxTime_us; };
  if (!plausible(table->time_us()) || !plausible(table->unix_us())) return false;
  record.number = table->number();
  record.time_us = table->time_us();
  record.unix_us = table->unix_us();
  record.status = {table->served(), table->permitted(),
                   static_cast<SourceLabel>(static_cast<std::uint8_t>(table->source())), table->sigma_m()};
  record.sent = table->sent();
  record.missing = table->missing();
  unsigned attitudes = 0, accelerations = 0, estimates = 0;
  const auto size_of = [](const auto* list) { return list == nullptr ? 0U : list->size(); };
  for (unsigned i = 0; i < size_of(table->order()); ++i) {
    switch (table->order()->Get(i)) {
      case fbs::FixInputKind::attitude: {
        if (attitudes >= size_of(table->attitudes())) return false;
        const auto& one = *table->attitudes()->Get(attitudes++);
        record.inputs.push_back({record.time_us - one.before_us(),
                                 FixInputRecord::Attitude{one.roll_rad(), one.pitch_rad(), one.yaw_rad()}});
        break;
      }
      case fbs::FixInputKind::acceleration: {
        if (accelerations >= size_of(table->accelerations())) return false;
        const auto& one = *table->accelerations()->Get(accelerations++);
        record.inputs.push_back({record.time_us - one.before_us(),
                                 FixInputRecord::Acceleration{one.forward_mps2(), one.right_mps2(), one.down_mps2()}});
        break;
      }
      case fbs::FixInputKind::estimate: {
        if (estimates >= size_of(table->estimates())) return false;
        const auto& one = *table->estimates()->Get(estimates++);
        record.inputs.push_back(
            {record.time_us - one.before_us(), FixInputRecord::ArrivedEstimate{one.index(), one.late()}});
        break;
      }
      default: return false;
    }
  }
  return attitudes == size_of(table->attitudes()) && accelerations == size_of(table->accelerations()) &&
         estimates == size_of(table->estimates());
}

}  // namespace codec

template <std::size_t Alternative = 0>
std::optional<Record> decode_alternative(std::size_t which, ByteView bytes) {
  if constexpr (Alternative < kTopics) {
    if (which != Alternative) return decode_alternative<Alternative + 1>(which, bytes);
    std::variant_alternative_t<Alternative, Record> record;
    if (!codec::decode(bytes, record)) return std::nullopt;
    return Record(std::in_place_index<Alternative>, std::move(record));
  } else {
    return std::nullopt;
  }
}

static_assert(std::variant_size_v<Record> == kTopics);

}  // namespace

std::string redacted_setting(std::string_view name, std::string_view value) {
  std::string lower(name);
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  bool secret = value.find("PRIVATE KEY") != std::string_view::npos;
  for (const char* word : {"key", "signature", "passphrase", "password", "secret", "token"}) {
    secret = secret || lower.find(word) != std::string::npos;
  }
  return secret ? "[withheld]" : std::string(value);
}

Bytes encode(const Record& record) {
  return std::visit([](const auto& kind) { return codec::encode(kind); }, record);
}

std::optional<Record> decode(Topic topic, ByteView bytes) {
  // FlatBuffers needs aligned numbers; a message may begin anywhere in its chunk.
  constexpr std::size_t kAlignment = 16;
  if (reinterpret_cast<std::uintptr_t>(bytes.data()) % kAlignment == 0) {
    return decode_alternative(static_cast<std::size_t>(topic), bytes);
  }
  const Bytes aligned(bytes.begin(), bytes.end());
  return decode_alternative(static_cast<std::size_t>(topic), aligned);
}

}  // namespace nadir
