#include "provision/airframe_manifest.hpp"

#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "trust/signatures.hpp"
#include "trust/signed_document.hpp"

namespace nadir {

std::string airframe_json(const Airframe& airframe) {
  const CameraModel& camera = airframe.camera.camera;
  const TelemetryUncertainty& uncertainty = airframe.camera.uncertainty;
  nlohmann::ordered_json document{{"format", "nadir.airframe/1"}, {"airframe", airframe.id}};
  if (airframe.sequence) document["sequence"] = *airframe.sequence;
  if (airframe.expires) document["expires"] = to_rfc3339(*airframe.expires);
  document.update(nlohmann::ordered_json{{"camera",
                                          {{"model", "pinhole"},
                                           {"width", camera.width},
                                           {"height", camera.height},
                                           {"fx", camera.fx},
                                           {"fy", camera.fy},
                                           {"cx", camera.cx},
                                           {"cy", camera.cy},
                                           {"distortion", camera.distortion},
                                           {"uncertainty",
                                            {{"heading_deg", degrees(uncertainty.heading_rad)},
                                             {"agl_relative", uncertainty.agl_relative},
                                             {"tilt_deg", degrees(uncertainty.tilt_rad)},
                                             {"imu_dv_mps", uncertainty.imu_dv_mps}}}}},
                                         {"mount",
                                          {{"yaw_deg", degrees(airframe.mount.heading_rad)},
                                           {"pitch_deg", degrees(airframe.mount.pitch_rad)},
                                           {"roll_deg", degrees(airframe.mount.roll_rad)}}},
                                         {"capture_delay_s", airframe.capture_delay_s},
                                         {"mavlink",
                                          {{"system", airframe.system},
                                           {"autopilot", airframe.autopilot},
                                           {"component", airframe.component},
                                           {"link", airframe.link},
                                           {"gps_id", airframe.gps_id}}}});
  if (airframe.camera.readout) {
    document["camera"]["rolling_shutter"] = {{"row_time_s", airframe.camera.line_time_s()},
                                             {"direction", name_of(airframe.camera.readout->direction)}};
  }
  if (airframe.camera.on_gimbal) document["camera"]["on_gimbal"] = true;
  if (airframe.matcher) {
    document["matcher"] = {{"model", airframe.matcher->model}, {"sha256", airframe.matcher->sha256.hex()}};
  }
  if (airframe.gimbal) {
    document["gimbal"] = {{"component", airframe.gimbal->component}, {"device", airframe.gimbal->device}};
  }
  for (const AirframeParameter& one : airframe.parameters) {
    document["mavlink"]["parameters"].push_back({{"name", one.name}, {"value", one.value}});
  }
  return document.dump(1) + "\n";
}

void write_airframe(const std::filesystem::path& folder, const Airframe& airframe, const PrivateKey& key) {
  StagingDirectory staging(folder);
  const std::string text = airframe_json(airframe);
  write_file_atomic(staging.path() / "airframe.json", text);
  read_airframe(staging.path() / "airframe.json");
  const Envelope envelope{std::string(kAirframePayloadType), {sign_payload(key, kAirframePayloadType, as_bytes(text))}};
  write_file_atomic(staging.path() / "airframe.json.sig", envelope_json(envelope));
  staging.commit();
}

}  // namespace nadir
