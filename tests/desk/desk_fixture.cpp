#include "desk/desk_fixture.hpp"

#include <fmt/format.h>

#include <chrono>
#include <thread>

#include "geodesy/angles.hpp"

namespace nadir::test {

std::string camera_yaml() {
  const CameraFile file = flight_camera();
  const CameraModel& camera = file.camera;
  return fmt::format(
      "model: pinhole\nwidth: {}\nheight: {}\nfx: {}\nfy: {}\ncx: {}\ncy: {}\ndistortion: []\n"
      "uncertainty: {{heading_deg: {}, agl_relative: {}, tilt_deg: {}}}\n",
      camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, degrees(file.uncertainty.heading_rad),
      file.uncertainty.agl_relative, degrees(file.uncertainty.tilt_rad));
}

std::string telemetry_csv(const std::vector<EncodedPicture>& pictures) {
  std::string text = "frame,time_s,agl_m,heading_deg,pitch_deg,roll_deg\n";
  for (const EncodedPicture& picture : pictures) {
    const Telemetry& t = picture.telemetry;
    const auto cell = [](const std::optional<double>& value, double unit) {
      return value ? fmt::format("{:.9f}", *value * unit) : std::string();
    };
    text += fmt::format("{},{:.6f},{},{},{},{}\n", picture.name, t.time_s, cell(t.agl_m, 1),
                        cell(t.heading_rad, degrees(1)), cell(t.pitch_rad, degrees(1)), cell(t.roll_rad, degrees(1)));
  }
  return text;
}

BatchBody batch_of(const std::vector<EncodedPicture>& pictures, const std::string& telemetry,
                   const std::string& telemetry_type) {
  BatchBody batch{.content_type = "multipart/form-data; boundary=XXnadirXX", .body = {}};
  const auto part = [&batch](const std::string& header, std::string_view bytes) {
    batch.body += "--XXnadirXX\r\nContent-Disposition: form-data; " + header + "\r\n\r\n";
    batch.body += bytes;
    batch.body += "\r\n";
  };
  for (const EncodedPicture& picture : pictures) {
    part("name=\"picture\"; filename=\"" + picture.name + "\"", as_text(picture.bytes));
  }
  if (!telemetry.empty()) part("name=\"telemetry\"\r\nContent-Type: " + telemetry_type, telemetry);
  batch.body += "--XXnadirXX--\r\n";
  return batch;
}

DeskFixture::DeskFixture() {
  options.root = folder / "desk";
  options.judged_at = [] { return kJudged; };
  options.limits.keep_free_bytes = 0;
  options.store.sync = StoreSync::checkpoints;
}

void DeskFixture::open() {
  close();
  desk = std::make_unique<DeskService>(options);
  queue = std::make_unique<FairQueue>(4, 100);
  api = std::make_unique<DeskApi>(*desk, *queue, api_options);
}

void DeskFixture::close() {
  api.reset();
  queue.reset();
  desk.reset();
}

ApiRequest DeskFixture::get(std::string target) const {
  ApiRequest request;
  request.method = "GET";
  request.target = std::move(target);
  request.host = "localhost:8770";
  return request;
}

ApiRequest DeskFixture::post(std::string target, std::string body, std::string type) const {
  ApiRequest request = get(std::move(target));
  request.method = "POST";
  request.content_type = std::move(type);
  request.content_length = body.size();
  request.body = std::move(body);
  return request;
}

ApiRequest DeskFixture::request(std::string method, std::string target, std::string body) const {
  const bool plain = body.empty();
  ApiRequest request = plain ? get(std::move(target)) : post(std::move(target), std::move(body));
  request.method = std::move(method);
  return request;
}

nlohmann::json DeskFixture::read(const std::string& target) const {
  const ApiResponse response = call(get(target));
  EXPECT_EQ(response.status, 200) << target << ": " << response.body;
  return json(response);
}

std::string DeskFixture::create(const nlohmann::json& change) {
  nlohmann::json body{
      {"name", "a flight"}, {"camera", camera_yaml()}, {"start", {{"lat", start().lat_deg}, {"lon", start().lon_deg}}}};
  body.update(change);
  const ApiResponse response = call(post("/v1/flights", body.dump()));
  EXPECT_EQ(response.status, 201) << response.body;
  return response.status == 201 ? "/v1/flights/" + json(response)["id"].get<std::string>() : std::string();
}

ApiResponse DeskFixture::send(const std::string& flight, const std::vector<EncodedPicture>& pictures) const {
  BatchBody batch = batch_of(pictures, telemetry_csv(pictures));
  return call(post(flight + "/pictures", std::move(batch.body), batch.content_type));
}

nlohmann::json DeskFixture::settled(const std::string& flight) const {
  for (int i = 0; i < 12'000; ++i) {
    nlohmann::json document = read(flight);
    const std::string state = document["state"];
    const bool done = document["pictures"]["accepted"] == document["pictures"]["processed"];
    if (state == "blocked" ||
        (done && !document["completion_requested"] && (state == "idle" || state == "completed"))) {
      return document;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  ADD_FAILURE() << "never settled: " << read(flight);
  return {};
}

}  // namespace nadir::test
