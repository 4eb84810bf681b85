// Frames in, estimates and anchors out.
#include "fbs/anchor_generated.h"
#include "fbs/estimate_generated.h"
#include "fbs/input_generated.h"
#include "fbs/picture_generated.h"
#include "recorder/codec_parts.hpp"

namespace nadir::codec {
namespace {

std::optional<fbs::VelocityChange> velocity_change(const std::optional<Eigen::Vector2d>& dv_mps) {
  if (!dv_mps) return std::nullopt;
  return fbs::VelocityChange(dv_mps->x(), dv_mps->y());
}

std::optional<Eigen::Vector2d> velocity_change(const fbs::VelocityChange* dv) {
  if (dv == nullptr) return std::nullopt;
  return Eigen::Vector2d(dv->east_mps(), dv->north_mps());
}

flatbuffers::Offset<flatbuffers::Vector<flatbuffers::Offset<fbs::Stretch>>> encode_way(
    FlatBufferBuilder& builder, const std::vector<TelemetryInterval>& way) {
  std::vector<flatbuffers::Offset<fbs::Stretch>> stretches;
  for (const TelemetryInterval& stretch : way) {
    const auto dv = velocity_change(stretch.imu_dv_mps);
    stretches.push_back(
        fbs::CreateStretch(builder, stretch.seconds, optional(stretch.heading_rad), dv ? &*dv : nullptr));
  }
  return builder.CreateVector(stretches);
}

std::vector<TelemetryInterval> decode_way(const flatbuffers::Vector<flatbuffers::Offset<fbs::Stretch>>* told) {
  std::vector<TelemetryInterval> way;
  if (told == nullptr) return way;
  for (const fbs::Stretch* stretch : *told) {
    way.push_back({stretch->seconds(), optional(stretch->heading_rad()), velocity_change(stretch->imu_dv())});
  }
  return way;
}

}  // namespace

Bytes encode(const InputRecord& input) {
  FlatBufferBuilder builder;
  const Telemetry& told = input.told;
  const auto frame = builder.CreateString(told.frame);
  const auto picture = builder.CreateString(input.picture.hex());
  const fbs::LonLat at = place(told.place.value_or(LonLat{}));
  const auto dv = velocity_change(told.imu_dv_mps);
  const auto way = encode_way(builder, told.intervals);
  return finish(builder,
                fbs::CreateInput(builder, input.index, frame, told.time_s, optional(told.agl_m),
                                 optional(told.heading_rad), optional(told.pitch_rad), optional(told.roll_rad),
                                 told.place ? &at : nullptr, picture, input.picture_bytes, dv ? &*dv : nullptr, way));
}

bool decode(ByteView bytes, InputRecord& input) {
  const auto* told = verified<fbs::Input>(bytes);
  if (told == nullptr) return false;
  const auto digest = Sha256::from_hex(text(told->picture_sha256()));
  if (!digest) return false;
  input.index = told->index();
  input.told.frame = text(told->frame());
  input.told.time_s = told->time_s();
  input.told.agl_m = optional(told->agl_m());
  input.told.heading_rad = optional(told->heading_rad());
  input.told.pitch_rad = optional(told->pitch_rad());
  input.told.roll_rad = optional(told->roll_rad());
  input.told.place = place(told->place());
  input.told.imu_dv_mps = velocity_change(told->imu_dv());
  input.told.intervals = decode_way(told->way());
  input.picture = *digest;
  input.picture_bytes = told->picture_bytes();
  return true;
}

Bytes encode(const PictureRecord& picture) {
  FlatBufferBuilder builder(picture.encoded.size() + 256);
  const auto frame = builder.CreateString(picture.frame);
  const auto data = builder.CreateVector(picture.encoded);
  return finish(builder, fbs::CreatePicture(builder, picture.index, frame, data));
}

bool decode(ByteView bytes_told, PictureRecord& picture) {
  const auto* told = verified<fbs::Picture>(bytes_told);
  if (told == nullptr) return false;
  picture.index = told->index();
  picture.frame = text(told->frame());
  picture.encoded = bytes(told->data());
  return true;
}

Bytes encode(const EstimateRecord& record) {
  FlatBufferBuilder builder;
  const Estimate& e = record.estimate;
  const auto frame = builder.CreateString(e.frame);
  const fbs::LonLat at = place(e.position.value_or(LonLat{}));
  const fbs::Covariance covariance(e.covariance_m2(0, 0), e.covariance_m2(0, 1), e.covariance_m2(1, 0),
                                   e.covariance_m2(1, 1));
  const StateEstimate& b = record.belief;
  const fbs::Belief belief(b.velocity_mps.x(), b.velocity_mps.y(), b.velocity_sigma_mps, b.heading_rad,
                           b.heading_sigma_rad, b.agl_m, b.agl_sigma_m);
  return finish(builder,
                fbs::CreateEstimate(builder, record.index, frame, e.time_s, e.position ? &at : nullptr, e.sigma_m,
                                    &covariance, static_cast<fbs::Source>(static_cast<std::uint8_t>(e.source)),
                                    e.segment, optional(e.anchor_age_s), e.anchor_inliers, e.anchor_ratio, e.latency_ms,
                                    record.odometry.tracked, record.odometry.inliers, record.odometry.step_m, &belief));
}

bool decode(ByteView bytes, EstimateRecord& record) {
  const auto* told = verified<fbs::Estimate>(bytes);
  if (told == nullptr || told->source() > fbs::Source::MAX) return false;
  record.index = told->index();
  Estimate& e = record.estimate;
  e.frame = text(told->frame());
  e.time_s = told->time_s();
  e.position = place(told->position());
  e.sigma_m = told->sigma_m();
  if (const auto* c = told->covariance(); c != nullptr) {
    e.covariance_m2 << c->ee_m2(), c->en_m2(), c->ne_m2(), c->nn_m2();
  }
  e.source = static_cast<SourceLabel>(static_cast<std::uint8_t>(told->source()));
  e.segment = told->segment();
  e.anchor_age_s = optional(told->anchor_age_s());
  e.anchor_inliers = told->anchor_inliers();
  e.anchor_ratio = told->anchor_ratio();
  e.latency_ms = told->latency_ms();
  if (const auto* b = told->belief(); b != nullptr) {
    record.belief = {{b->east_mps(), b->north_mps()},
                     b->velocity_sigma_mps(),
                     b->heading_rad(),
                     b->heading_sigma_rad(),
                     b->agl_m(),
                     b->agl_sigma_m()};
  }
  record.odometry = {told->tracked(), told->odometry_inliers(), told->odometry_step_m()};
  return true;
}

Bytes encode(const AnchorRecord& record) {
  FlatBufferBuilder builder;
  const AnchorReport& a = record.anchor;
  const auto frame = builder.CreateString(record.frame);
  std::optional<fbs::PlanePoint> camera;
  if (a.camera) camera.emplace(a.camera->east_m, a.camera->north_m);
  return finish(builder,
                fbs::CreateAnchor(builder, record.index, frame, record.time_s, verdict(a.verdict), a.score, a.ratio,
                                  a.inliers, a.patches, a.residual_px, a.matching_gsd_m, a.chi2,
                                  camera ? &*camera : nullptr, a.heading_rad, a.window_radius_m, record.taken_after));
}

bool decode(ByteView bytes, AnchorRecord& record) {
  const auto* told = verified<fbs::Anchor>(bytes);
  if (told == nullptr) return false;
  record.index = told->index();
  record.frame = text(told->frame());
  record.time_s = told->time_s();
  AnchorReport& a = record.anchor;
  a.verdict = verdict(told->verdict());
  a.score = told->score();
  a.ratio = told->ratio();
  a.inliers = told->inliers();
  a.patches = told->patches();
  a.residual_px = told->residual_px();
  a.matching_gsd_m = told->matching_gsd_m();
  a.chi2 = told->chi2();
  if (told->camera() != nullptr) a.camera = PlanePoint{told->camera()->east_m(), told->camera()->north_m()};
  a.heading_rad = told->heading_rad();
  a.window_radius_m = told->window_radius_m();
  record.taken_after = told->taken_after();
  return true;
}

}  // namespace nadir::codec
