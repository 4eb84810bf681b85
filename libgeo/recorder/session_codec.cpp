// The session record: everything by name, gates included, so that an older or newer reader knows what it lacks.
#include "fbs/session_generated.h"
#include "recorder/codec_parts.hpp"
#include "recorder/gate_names.hpp"
#include "recorder/withheld.hpp"

namespace nadir::codec {
namespace {

constexpr std::uint32_t kFormat = 1;

flatbuffers::Offset<fbs::Camera> camera(FlatBufferBuilder& builder, const CameraFile& file) {
  const CameraModel& c = file.camera;
  const auto distortion = builder.CreateVector(c.distortion.data(), c.distortion.size());
  return fbs::CreateCamera(builder, c.width, c.height, c.fx, c.fy, c.cx, c.cy, distortion, file.uncertainty.heading_rad,
                           file.uncertainty.agl_relative, file.uncertainty.tilt_rad, file.uncertainty.imu_dv_mps);
}

CameraFile camera(const fbs::Camera& told) {
  CameraFile file;
  CameraModel& c = file.camera;
  c.width = told.width();
  c.height = told.height();
  c.fx = told.fx();
  c.fy = told.fy();
  c.cx = told.cx();
  c.cy = told.cy();
  const auto* distortion = told.distortion();
  for (unsigned i = 0; distortion != nullptr && i < distortion->size() && i < c.distortion.size(); ++i) {
    c.distortion[i] = distortion->Get(i);
  }
  file.uncertainty = {told.heading_sigma_rad(), told.agl_sigma_relative(), told.tilt_sigma_rad(),
                      told.imu_dv_sigma_mps()};
  return file;
}

flatbuffers::Offset<fbs::Localizer> localizer(FlatBufferBuilder& builder, const SessionRecord& session) {
  const LocalizerConfig& config = session.localizer;
  std::vector<flatbuffers::Offset<fbs::Gate>> gates;
  for (const auto& [name, value] : named_gates(config.gates)) {
    gates.push_back(fbs::CreateGateDirect(builder, name.c_str(), value));
  }
  const auto gate_list = builder.CreateVector(gates);
  std::optional<fbs::Box> area;
  if (config.area) area.emplace(config.area->west_m, config.area->south_m, config.area->east_m, config.area->north_m);
  return fbs::CreateLocalizer(builder, gate_list, config.start_sigma_m, config.min_search_radius_m,
                              config.max_search_radius_m, config.no_fix_sigma_m, config.map_sigma_m,
                              config.assumed_agl_m, area ? &*area : nullptr, session.terrain, config.anchor_every_m,
                              config.anchor_above_sigma_m, session.places, config.resumed);
}

void localizer(const fbs::Localizer& told, SessionRecord& session) {
  LocalizerConfig& config = session.localizer;
  if (told.gates() != nullptr) {
    for (const auto* gate : *told.gates()) set_gate(config.gates, text(gate->name()), gate->value());
  }
  config.start_sigma_m = told.start_sigma_m();
  config.min_search_radius_m = told.min_search_radius_m();
  config.max_search_radius_m = told.max_search_radius_m();
  config.no_fix_sigma_m = told.no_fix_sigma_m();
  config.map_sigma_m = told.map_sigma_m();
  config.assumed_agl_m = told.assumed_agl_m();
  if (const auto* area = told.area(); area != nullptr) {
    config.area = PlaneBox{area->west_m(), area->south_m(), area->east_m(), area->north_m()};
  }
  config.anchor_every_m = told.anchor_every_m();
  config.anchor_above_sigma_m = told.anchor_above_sigma_m();
  config.resumed = told.resumed();
  session.terrain = told.terrain();
  session.places = told.places();
}

}  // namespace

Bytes encode(const SessionRecord& session) {
  FlatBufferBuilder builder;
  std::vector<flatbuffers::Offset<fbs::Setting>> list;
  for (const auto& [name, value] : session.settings) {
    list.push_back(fbs::CreateSettingDirect(builder, name.c_str(), without_secrets(name, value).c_str()));
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
  const auto* told = verified<fbs::Session>(bytes);
  if (told == nullptr || told->format() != kFormat) return false;
  session.id = text(told->id());
  session.segment = told->segment();
  session.started_ns = told->started_ns();
  session.program = text(told->program());
  session.version = text(told->version());
  session.airframe = text(told->airframe());
  if (told->package_sha256() != nullptr) {
    session.package = Sha256::from_hex(text(told->package_sha256()));
    if (!session.package) return false;
  }
  session.mission = text(told->mission());
  if (told->camera() != nullptr) session.camera = camera(*told->camera());
  session.origin = place(told->origin()).value_or(LonLat{});
  session.start = place(told->start());
  if (told->picture_shrink() == 0 || told->picture_shrink() > 8) return false;
  session.picture_shrink = static_cast<int>(told->picture_shrink());
  session.seed = told->seed();
  session.looked_up_later = told->looked_up_later();
  if (told->localizer() != nullptr) localizer(*told->localizer(), session);
  if (told->settings() != nullptr) {
    for (const auto* setting : *told->settings()) {
      session.settings.emplace_back(text(setting->name()), text(setting->value()));
    }
  }
  return true;
}

}  // namespace nadir::codec
