#include "desk/desk_api.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <fstream>

#include "base/error.hpp"
#include "desk/desk_fixture.hpp"
#include "desk/desk_requests.hpp"
#include "geodesy/local_frame.hpp"

namespace nadir {
namespace {

using test::EncodedPicture;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

class DeskApiTest : public test::DeskFixture {
 protected:
  DeskApiTest() { open(); }
  void expect_problem(const ApiResponse& response, int status, const std::string& type) const {
    EXPECT_EQ(response.status, status) << response.body;
    ASSERT_EQ(response.content_type, "application/problem+json") << response.body;
    EXPECT_EQ(json(response)["type"], "urn:nadir:problem:" + type) << response.body;
  }
  std::string header(const ApiResponse& response, const std::string& name) const {
    for (const auto& [key, value] : response.headers) {
      if (key == name) return value;
    }
    return {};
  }
};

TEST_F(DeskApiTest, PicturesBecomeATrack) {
  const std::string flight = create();
  const auto& pictures = test::flight_pictures(test::Course::smooth);
  const ApiResponse sent = send(flight, pictures);
  ASSERT_EQ(sent.status, 200) << sent.body;
  EXPECT_EQ(json(sent)["accepted"], pictures.size());
  EXPECT_EQ(json(sent)["pictures"][2]["name"], "frame2.img");
  EXPECT_EQ(json(sent)["pictures"][2]["frame"], 2);
  EXPECT_EQ(settled(flight)["state"], "idle");

  const auto estimates = read(flight + "/estimates")["estimates"];
  ASSERT_EQ(estimates.size(), pictures.size());
  EXPECT_EQ(estimates[4]["frame"], 4);
  EXPECT_EQ(estimates[4]["source"], "vo_extrapolated");
  EXPECT_GE(estimates[4]["position"]["ellipse"]["major_m"], estimates[4]["position"]["ellipse"]["minor_m"]);
  const LocalFrame plane(test::start());
  const auto way = plane.plane_from_lonlat({estimates[4]["position"]["lon"], estimates[4]["position"]["lat"]});
  EXPECT_GT(std::hypot(way.east_m, way.north_m), 20) << "17 m/s for 4 s";
  EXPECT_EQ(read(flight + "/estimates?first=3&limit=1")["estimates"][0]["frame"], 3);
  EXPECT_TRUE(read(flight + "/estimates?kind=refined")["estimates"].empty());
  EXPECT_EQ(read(flight + "/segments")["segments"][0]["state"], "floating");
  expect_problem(call(get(flight + "/export?format=colmap")), 404, "reconstruction");

  expect_problem(call(get(flight + "/looks/99")), 404, "frame");
  expect_problem(call(get(flight + "/looks/1/seen")), 404, "look");
  EXPECT_EQ(read(flight + "/looks/1")["verdict"], "not_tried");

  EXPECT_EQ(call(post(flight + "/complete", "")).status, 202);
  const auto completed = settled(flight);
  EXPECT_EQ(completed["state"], "completed");
  EXPECT_THAT(completed["kinds"].get<std::vector<std::string>>(), ElementsAre("online", "refined", "adjusted"));
  EXPECT_EQ(read(flight + "/estimates?kind=refined")["estimates"].size(), pictures.size());
  const auto adjusted = read(flight + "/estimates?kind=adjusted")["estimates"];
  ASSERT_EQ(adjusted.size(), pictures.size());
  EXPECT_FALSE(adjusted[4]["position"].is_null());
  const ApiResponse archive = call(get(flight + "/export?format=colmap"));
  EXPECT_EQ(archive.content_type, "application/zip");
  EXPECT_EQ(archive.body.substr(0, 4), std::string("PK\x03\x04"));
  EXPECT_NE(archive.body.find("frame4.img"), std::string::npos);
  EXPECT_THAT(call(get(flight + "/export?format=geo")).body, testing::StartsWith("EPSG:4326\nframe0.img "));
}

// The same pictures give the same bytes as a flight of the library, and so as `nadir replay`.
TEST_F(DeskApiTest, EstimatesAreThoseOfTheLibrary) {
  const std::string flight = create();
  auto pictures = test::flight_pictures(test::Course::smooth);
  const std::vector<EncodedPicture> first(pictures.begin(), pictures.begin() + 2),
      rest(pictures.begin() + 2, pictures.end());
  send(flight, first);
  send(flight, rest);
  settled(flight);
  const std::string id = flight.substr(flight.rfind('/') + 1);
  const auto live = desk->open(id);
  const auto alone = FlightStore::in_memory(live->store().description(), test::kNow);
  const FlightStore& stored = live->store();
  std::vector<Telemetry> rows;
  for (std::size_t i = 0; i < stored.accepted(); ++i) {
    rows.push_back(stored.picture(i).telemetry);
    std::ofstream(folder / rows.back().frame, std::ios::binary) << as_text(stored.read_picture(i));
  }
  alone->refer(folder.path(), rows, {}, test::kNow);
  const SessionRecord& session = stored.description().session;
  FlightEngine engine(*alone, {.camera = session.camera,
                               .shrink = session.picture_shrink,
                               .frame = LocalFrame(session.origin),
                               .tiles = nullptr,
                               .start = session.start,
                               .localizer = session.localizer});
  engine.process();
  const auto online = [](const FlightStore& store) {
    std::vector<std::string> lines;
    for (const Estimate& e : store.estimates(EstimateKind::online)) {
      lines.push_back(fmt::format("{} {:a} {:a} {:a}", e.frame, e.position->lat_deg, e.position->lon_deg, e.sigma_m));
    }
    return lines;
  };
  EXPECT_EQ(online(stored), online(*alone));
}

TEST_F(DeskApiTest, EachPictureOfABatchHasAnAnswer) {
  const std::string flight = create();
  auto pictures = test::flight_pictures(test::Course::smooth);
  const std::string telemetry = test::telemetry_csv(pictures);
  const auto sent = [&](const std::vector<EncodedPicture>& batch) {
    const test::BatchBody body = test::batch_of(batch, telemetry);
    return json(call(post(flight + "/pictures", body.body, body.content_type)));
  };
  std::reverse(pictures.begin(), pictures.end());  // in any order
  EncodedPicture without_row = test::plain_picture(7), elsewhere = pictures[0];
  without_row.name = "no-row.jpg";
  elsewhere.name = "../elsewhere.jpg";
  auto batch = pictures;
  batch.push_back(without_row);
  batch.push_back(elsewhere);
  const auto answer = sent(batch);
  EXPECT_EQ(answer["accepted"], 5);
  ASSERT_EQ(answer["refused"], 2) << answer;
  EXPECT_EQ(answer["pictures"][0]["frame"], 4) << "the last one was sent first";
  EXPECT_EQ(answer["pictures"][5]["problem"], "bad_time");
  EXPECT_EQ(answer["pictures"][6]["problem"], "bad_name");

  EXPECT_EQ(sent(pictures)["known"], 5);
  auto other = pictures;
  other[0].bytes = pictures[1].bytes;
  EXPECT_EQ(sent(other)["pictures"][0]["problem"], "name_taken");
  EXPECT_EQ(settled(flight)["pictures"]["accepted"], 5);
}

TEST_F(DeskApiTest, TakesOnePictureWithItsTelemetryInTheQuery) {
  const std::string flight = create();
  const auto& pictures = test::flight_pictures(test::Course::smooth);
  const std::string body(as_text(pictures[0].bytes));
  const auto answer = call(post(flight + "/pictures?name=a%20b.png&time_s=1.5&agl_m=100", body, "image/png"));
  EXPECT_EQ(json(answer)["pictures"][0]["outcome"], "accepted") << answer.body;
  EXPECT_EQ(json(answer)["pictures"][0]["name"], "a b.png");
  const auto stored = call(get(flight + "/pictures/0"));
  EXPECT_EQ(stored.content_type, "image/png");
  EXPECT_EQ(stored.body, body);
  const auto preview = call(get(flight + "/pictures/0?preview=true"));
  EXPECT_EQ(preview.content_type, "image/jpeg");
  EXPECT_THAT(preview.body, StartsWith("\xff\xd8"));
  expect_problem(call(get(flight + "/pictures/1")), 404, "frame");
  expect_problem(call(get(flight + "/pictures/0?preview=maybe")), 400, "query");

  const auto wrong = call(post(flight + "/pictures?agl_m=nan&heading_deg=400&colour=red", body, "image/png"));
  expect_problem(wrong, 400, "invalid");
  EXPECT_THAT(wrong.body, HasSubstr("?agl_m"));
  EXPECT_THAT(wrong.body, HasSubstr("?heading_deg"));
  EXPECT_THAT(wrong.body, HasSubstr("?colour"));
  EXPECT_THAT(wrong.body, HasSubstr("?name"));
  EXPECT_THAT(wrong.body, HasSubstr("?time_s"));
}

TEST_F(DeskApiTest, TelemetryMayBeJson) {
  const std::string flight = create();
  const auto& pictures = test::flight_pictures(test::Course::smooth);
  const std::vector<EncodedPicture> one(pictures.begin(), pictures.begin() + 1);
  const auto with = [&](const nlohmann::json& telemetry) {
    const test::BatchBody body = test::batch_of(one, telemetry.dump(), "application/json");
    return call(post(flight + "/pictures", body.body, body.content_type));
  };
  const auto wrong = with({{"rows", {{{"frame", "frame0.img"}, {"agl_m", -3}, {"agl", 3}}}}});
  expect_problem(wrong, 400, "invalid");
  for (const char* pointer : {"/rows/0/time_s", "/rows/0/agl_m", "/rows/0/agl"}) {
    EXPECT_THAT(wrong.body, HasSubstr(pointer));
  }
  EXPECT_EQ(json(with({{"rows", {{{"frame", "frame0.img"}, {"time_s", 0}, {"agl_m", 100}}}}}))["accepted"], 1);
}

TEST_F(DeskApiTest, HostileBatchesLeaveNothing) {
  const std::string flight = create();
  const auto& pictures = test::flight_pictures(test::Course::smooth);
  const test::BatchBody good = test::batch_of(pictures, test::telemetry_csv(pictures));
  const auto sent = [&](std::string body, const std::string& type) {
    return call(post(flight + "/pictures", std::move(body), type));
  };
  expect_problem(sent(good.body.substr(0, good.body.size() - 20), good.content_type), 400, "malformed");
  expect_problem(sent("", good.content_type), 400, "malformed");
  expect_problem(sent(good.body, "multipart/form-data"), 400, "malformed");
  expect_problem(sent(good.body, "text/plain"), 415, "media-type");
  expect_problem(sent(test::batch_of({}, "frame").body, good.content_type), 400, "telemetry");
  expect_problem(sent(test::batch_of({}, "").body, good.content_type), 400, "invalid");
  expect_problem(sent(test::batch_of(pictures, "frame,time_s\n\xff\x00,1").body, good.content_type), 400, "telemetry");
  std::vector<EncodedPicture> many(201, pictures[0]);
  for (EncodedPicture& picture : many) picture.bytes = {1};
  expect_problem(sent(test::batch_of(many, "").body, good.content_type), 400, "invalid");
  many.push_back(many[0]);
  expect_problem(sent(test::batch_of(many, "").body, good.content_type), 400, "malformed");

  ApiRequest large = post(flight + "/pictures", "", good.content_type);
  large.content_length = api_options.body_bytes + 1;
  expect_problem(call(large), 413, "body-too-large");
  large.content_length.reset();
  expect_problem(call(large), 411, "length");
  large.content_length = 5;
  large.other_encoding = true;
  expect_problem(call(large), 411, "length");
  EXPECT_EQ(read(flight)["pictures"]["accepted"], 0);
}

TEST_F(DeskApiTest, TellsAllThatIsWrongWithANewFlight) {
  const ApiResponse response =
      call(post("/v1/flights", R"({"camera": 3, "start": {"lat": 95, "long": 1}, "colour": "red"})"));
  expect_problem(response, 400, "invalid");
  for (const char* pointer : {"/name", "/camera", "/start/lat", "/start/lon", "/start/long", "/colour"}) {
    EXPECT_THAT(response.body, HasSubstr(std::string("\"") + pointer + "\"")) << pointer;
  }
  const auto create_with = [&](const nlohmann::json& body) { return call(post("/v1/flights", body.dump())); };
  expect_problem(create_with({{"name", "x"}, {"camera", test::camera_yaml()}}), 422, "refused");
  expect_problem(create_with({{"name", "x"}, {"camera", "width: 3"}, {"start", {{"lat", 1}, {"lon", 2}}}}), 422,
                 "refused");
  expect_problem(create_with({{"name", "x"}, {"camera", test::camera_yaml()}, {"package", "../root"}}), 422, "refused");
  EXPECT_TRUE(read("/v1/flights")["flights"].empty());
}

TEST_F(DeskApiTest, RejectsWhatIsNoCall) {
  expect_problem(call(get("/v1/nothing")), 404, "path");
  expect_problem(call(get("/v1/flights/0123456789ab")), 404, "flight");
  expect_problem(call(get("/v1/flights/..%2f..%2fetc")), 404, "flight");
  expect_problem(call(get("/v1/flights/0123456789ab/pictures/x")), 404, "path");
  const ApiResponse wrong = call(post("/v1/packages", ""));
  expect_problem(wrong, 405, "method");
  EXPECT_EQ(header(wrong, "Allow"), "GET, HEAD");
  expect_problem(call(post("/v1/flights", "{}", "text/plain")), 415, "media-type");
  ApiRequest foreign = get("/v1/flights");
  foreign.host = "evil.example";
  expect_problem(call(foreign), 421, "host");
  const std::string flight = create();
  expect_problem(call(get(flight + "/estimates?kind=best")), 400, "query");
  expect_problem(call(get(flight + "/estimates?limit=10001")), 400, "query");
  expect_problem(call(get(flight + "/estimates?n=1")), 400, "query");
  expect_problem(call(get(flight + "/export?format=exe")), 400, "query");
  expect_problem(call(get(flight + "/events?after=x")), 400, "query");
  expect_problem(call(post(flight + "/complete", "")), 409, "no-pictures");
}

TEST_F(DeskApiTest, ATokenOpensEverythingButThePage) {
  api_options.token = sha256(as_bytes("a-secret-of-the-desk"));
  open();
  const ApiResponse closed = call(get("/v1/flights"));
  expect_problem(closed, 401, "token");
  EXPECT_EQ(header(closed, "WWW-Authenticate"), "Bearer");
  EXPECT_EQ(call(get("/")).status, 200);
  EXPECT_EQ(call(get("/leaflet.js")).status, 200);
  ApiRequest request = get("/v1/flights");
  request.authorization = "Bearer a-secret-of-the-desk";
  EXPECT_EQ(call(request).status, 200);
}

TEST_F(DeskApiTest, ThePageLoadsNothingFromElsewhere) {
  for (const char* path : {"/", "/page.js", "/page.css", "/leaflet.js", "/leaflet.css"}) {
    const ApiResponse response = call(get(path));
    EXPECT_EQ(response.status, 200) << path;
    EXPECT_THAT(header(response, "Content-Security-Policy"), HasSubstr("default-src 'none'"));
    EXPECT_GT(response.body.size(), 1000U) << path;
  }
  EXPECT_EQ(json(call(get("/v1/openapi.json")))["openapi"], "3.1.0");
}

// A place given for an earlier frame of the same segment is moved along the track.
TEST_F(DeskApiTest, AFixIsCarriedToThePresent) {
  const std::string flight = create();
  expect_problem(call(post(flight + "/fixes", R"({"lat": 48, "lon": 11, "radius_m": 0})")), 400, "invalid");
  expect_problem(call(post(flight + "/fixes", R"({"lat": 48, "lon": 11, "radius_m": 5, "frame": 0})")), 422, "refused");
  const auto& pictures = test::flight_pictures(test::Course::smooth);
  send(flight, pictures);
  settled(flight);
  const auto estimates = read(flight + "/estimates")["estimates"];
  const auto fix =
      json(call(post(flight + "/fixes", R"({"lat": 48.1, "lon": 11.2, "radius_m": 30, "frame": 1, "by": "me"})")));
  EXPECT_EQ(fix["before_frame"], 5);
  EXPECT_EQ(fix["frame"], 1);
  EXPECT_EQ(fix["by"], "me");
  EXPECT_EQ(fix["lat"], 48.1) << "as it was said";
  const double moved = fix["hint"]["lat"].get<double>() - 48.1;
  const double flown = estimates[4]["position"]["lat"].get<double>() - estimates[1]["position"]["lat"].get<double>();
  EXPECT_NEAR(moved, flown, 2e-8);
  EXPECT_GT(fix["hint"]["radius_m"], 30);
  EXPECT_LT(fix["hint"]["radius_m"], 40);
  EXPECT_EQ(read(flight + "/fixes")["fixes"].size(), 1U);
}

// Who says that a pixel shows the very place that it does says where the aircraft was.
TEST_F(DeskApiTest, APixelFixSaysWhereTheAircraftWas) {
  const std::string flight = create();
  send(flight, test::flight_pictures(test::Course::smooth));
  settled(flight);
  const auto print = read(flight + "/pictures/4/footprint");
  ASSERT_EQ(print["corners"].size(), 4U) << print;
  const auto& corner = print["corners"][0];
  const LonLat aircraft{print["position"]["lon"], print["position"]["lat"]};
  const LonLat seen = LocalFrame(aircraft).lonlat_from_plane({corner[0], corner[1]});
  const nlohmann::json said{
      {"lat", seen.lat_deg}, {"lon", seen.lon_deg}, {"frame", 4}, {"pixel", {{"x", -0.5}, {"y", -0.5}}}};
  const ApiResponse response = call(post(flight + "/fixes", said.dump()));
  ASSERT_EQ(response.status, 201) << response.body;
  const auto fix = json(response);
  EXPECT_EQ(fix["sigma_m"], 5);
  EXPECT_EQ(fix["pixel"]["x"], -0.5);
  const PlanePoint off = LocalFrame(aircraft).plane_from_lonlat({fix["hint"]["lon"], fix["hint"]["lat"]});
  EXPECT_LT(std::hypot(off.east_m, off.north_m), 0.01);
  EXPECT_GT(fix["hint"]["radius_m"], 10) << "2 sigma, and what heading and tilt add";

  auto wrong = said;
  wrong["pixel"]["x"] = 1e5;
  expect_problem(call(post(flight + "/fixes", wrong.dump())), 422, "refused");
  wrong = said;
  wrong.erase("frame");
  expect_problem(call(post(flight + "/fixes", wrong.dump())), 400, "invalid");
  wrong = said;
  wrong["radius_m"] = 5;
  expect_problem(call(post(flight + "/fixes", wrong.dump())), 400, "invalid");
  wrong = said;
  wrong["frame"] = 5;
  expect_problem(call(post(flight + "/fixes", wrong.dump())), 422, "refused");
  expect_problem(call(get(flight + "/pictures/5/footprint")), 404, "frame");
}

TEST_F(DeskApiTest, AFixCanBeWithdrawn) {
  const std::string flight = create();
  call(post(flight + "/fixes", R"({"lat": 48, "lon": 11, "radius_m": 50})"));
  const ApiResponse withdrawn = call(request("DELETE", flight + "/fixes/1"));
  ASSERT_EQ(withdrawn.status, 200) << withdrawn.body;
  EXPECT_FALSE(json(withdrawn)["withdrawn"].is_null());
  EXPECT_EQ(json(call(request("DELETE", flight + "/fixes/1"))), json(withdrawn)) << "once more changes nothing";
  expect_problem(call(request("DELETE", flight + "/fixes/2")), 404, "fix");
  expect_problem(call(get(flight + "/fixes/1")), 405, "method");
  EXPECT_EQ(read(flight + "/fixes")["fixes"].size(), 1U) << "it stays in the record";
}

// The middle of two pictures of a flight over flat ground: two objects; one that is at both places contradicts itself.
TEST_F(DeskApiTest, MarkedObjectsHavePlaces) {
  const std::string flight = create();
  send(flight, test::flight_pictures(test::Course::smooth));
  settled(flight);
  const auto print = read(flight + "/pictures/2/footprint");
  const double x = (print["picture"]["width"].get<double>() - 1) / 2,
               y = (print["picture"]["height"].get<double>() - 1) / 2;
  const auto mark = [&](const std::string& path, nlohmann::json body, int frame) {
    body["frame"] = frame;
    body["pixel"] = {{"x", x}, {"y", y}};
    const ApiResponse response = call(post(flight + path, body.dump()));
    EXPECT_EQ(response.status, 201) << response.body;
    return json(response);
  };
  const auto object = mark("/objects", {{"name", "=cross \"north\""}, {"by", "me"}}, 2);
  EXPECT_EQ(object["id"], 1);
  ASSERT_FALSE(object["place"].is_null()) << object;
  const LonLat aircraft{print["position"]["lon"], print["position"]["lat"]};
  const PlanePoint off = LocalFrame(aircraft).plane_from_lonlat({object["place"]["lon"], object["place"]["lat"]});
  EXPECT_LT(std::hypot(off.east_m, off.north_m), 25) << "near nadir";
  EXPECT_GT(object["place"]["ellipse_95"]["major_m"], 1);
  EXPECT_TRUE(object["place"]["agrees"]);

  const auto contradicted = mark("/objects/1/sightings", {}, 0);
  ASSERT_EQ(contradicted["sightings"].size(), 2U);
  EXPECT_GT(contradicted["sightings"][1]["residual_px"], 1);
  const std::string second = std::to_string(contradicted["sightings"][1]["id"].get<int>());
  EXPECT_EQ(json(call(request("DELETE", flight + "/objects/1/sightings/" + second)))["sightings"].size(), 1U);
  expect_problem(call(request("DELETE", flight + "/objects/1/sightings/1")), 422, "refused");
  expect_problem(call(request("DELETE", flight + "/objects/1/sightings/9")), 404, "sighting");

  const ApiResponse renamed = call(request("PATCH", flight + "/objects/1", R"({"name": "+cross"})"));
  EXPECT_EQ(json(renamed)["name"], "+cross") << renamed.body;
  EXPECT_EQ(read(flight + "/objects")["objects"].size(), 1U);
  EXPECT_EQ(read(flight + "/objects/1")["name"], "+cross");
  const ApiResponse csv = call(get(flight + "/objects?format=csv"));
  EXPECT_THAT(csv.body, HasSubstr("\n1,\"'+cross\",48."));
  EXPECT_THAT(header(csv, "Content-Disposition"), HasSubstr("-objects.csv\""));
  EXPECT_EQ(json(call(get(flight + "/objects?format=geojson")))["features"][0]["geometry"]["type"], "Point");
  expect_problem(call(get(flight + "/objects?format=exe")), 400, "query");

  expect_problem(call(post(flight + "/objects", R"({"frame": 2})")), 400, "invalid");
  expect_problem(call(post(flight + "/objects", R"({"frame": 2, "pixel": {"x": 1, "y": 9999}})")), 422, "refused");
  expect_problem(call(post(flight + "/objects", R"({"frame": 9, "pixel": {"x": 1, "y": 1}})")), 422, "refused");
  expect_problem(call(post(flight + "/objects/7/sightings", R"({"frame": 2, "pixel": {"x": 1, "y": 1}})")), 404,
                 "object");

  // Once the flight is adjusted, its poses are used.
  EXPECT_EQ(print["adjusted"], false);
  EXPECT_EQ(object["place"]["adjusted"], false);
  EXPECT_EQ(call(post(flight + "/complete", "")).status, 202);
  EXPECT_EQ(settled(flight)["state"], "completed");
  const auto adjusted = read(flight + "/objects/1");
  EXPECT_EQ(adjusted["place"]["adjusted"], true) << adjusted;
  const PlanePoint moved = LocalFrame({object["place"]["lon"], object["place"]["lat"]})
                               .plane_from_lonlat({adjusted["place"]["lon"], adjusted["place"]["lat"]});
  EXPECT_LT(std::hypot(moved.east_m, moved.north_m), 40) << "dead reckoning from the start, both times";
  EXPECT_EQ(read(flight + "/pictures/2/footprint")["adjusted"], true);
  EXPECT_FALSE(read(flight + "/pictures/2/footprint")["corners"].is_null());

  EXPECT_EQ(call(request("DELETE", flight + "/objects/1")).status, 200);
  expect_problem(call(get(flight + "/objects/1")), 404, "object");
}

TEST_F(DeskApiTest, ExportsTheTrack) {
  const std::string flight = create({{"name", "<Tal> & \"Wald\""}});
  send(flight, test::flight_pictures(test::Course::smooth));
  settled(flight);
  const auto exported = [&](const std::string& query) { return call(get(flight + "/export" + query)); };
  EXPECT_EQ(json(exported(""))["type"], "FeatureCollection");
  EXPECT_THAT(exported("?format=csv").body, StartsWith("frame,time_s,lat_deg,lon_deg"));
  const ApiResponse kml = exported("?format=kml"), gpx = exported("?format=gpx&kind=online");
  EXPECT_THAT(kml.body, HasSubstr("&lt;Tal&gt; &amp; "));
  EXPECT_EQ(kml.body.find("<Tal>"), std::string::npos);
  EXPECT_THAT(gpx.body, HasSubstr("<trkpt lat=\"48."));
  EXPECT_THAT(header(gpx, "Content-Disposition"), HasSubstr("-online.gpx\""));
}

TEST_F(DeskApiTest, KeepsSpaceFree) {
  const std::string flight = create();
  options.limits.keep_free_bytes = std::uint64_t{1} << 60;
  open();
  expect_problem(send(flight, test::flight_pictures(test::Course::smooth)), 507, "storage-full");
  expect_problem(call(post("/v1/flights", nlohmann::json{{"name", "x"}, {"camera", "y"}}.dump())), 507, "storage-full");
  EXPECT_EQ(read(flight)["pictures"]["accepted"], 0);
}

// Bodies of all requests together have a limit: those that wait are asked to retry.
TEST_F(DeskApiTest, BodiesTogetherAreBounded) {
  api_options.body_bytes = 1000, api_options.bodies_bytes = 1500;
  open();
  ApiRequest request = post("/v1/flights/0123456789ab/pictures?name=x", "", "image/png");
  request.content_length = 900;
  auto first = api->admit(request);
  ASSERT_TRUE(std::holds_alternative<std::shared_ptr<HttpAdmission>>(first));
  auto second = api->admit(request);
  ASSERT_TRUE(std::holds_alternative<ApiResponse>(second));
  expect_problem(std::get<ApiResponse>(second), 429, "too-many-requests");
  first = ApiResponse{};  // written
  EXPECT_TRUE(std::holds_alternative<std::shared_ptr<HttpAdmission>>(api->admit(request)));
}

}  // namespace
}  // namespace nadir
