#include "api/api.hpp"

#include <gmock/gmock.h>

#include <limits>

#include "api/api_fixture.hpp"
#include "base/error.hpp"
#include "service/service_rules.hpp"

namespace nadir {
namespace {

using test::expect_problem;
using ::testing::HasSubstr;

class ApiTest : public test::ApiFixture {};

std::string header(const ApiResponse& response, const std::string& name) {
  for (const auto& [key, value] : response.headers) {
    if (key == name) return value;
  }
  return {};
}

TEST_F(ApiTest, ReportsTheState) {
  const auto state = json(api.handle(get("/v1/state")));
  EXPECT_EQ(state["state"], "normal");
  EXPECT_EQ(state["version"], 1);
  EXPECT_EQ(state["position"]["sigma_m"], 2.8);
  EXPECT_EQ(state["events"].back()["severity"], "critical");
  EXPECT_EQ(state["track"].size(), 1U);
  EXPECT_EQ(state["track"][0]["source"], "satellite_anchored");
}

TEST_F(ApiTest, ReportsTheProtectionLevelAndWhetherThePositionIsUsable) {
  auto state = json(api.handle(get("/v1/state")));
  EXPECT_NEAR(state["position"]["hpl_m"].get<double>(), 18.2, 1e-9);
  const nlohmann::json demanded{{"usable", true}, {"risk", 1e-5}, {"alert_limit_m", 100}, {"time_to_alert_s", 3}};
  EXPECT_EQ(state["integrity"], demanded);
  publish(ServiceState::degraded);
  state = json(api.handle(get("/v1/state")));
  EXPECT_NEAR(state["position"]["hpl_m"].get<double>(), 247, 1e-9);
  EXPECT_EQ(state["integrity"]["usable"], false);
  FlightView view = flight.at(now_s, ServiceState::normal);
  for (const std::optional<double> unknown : {std::optional<double>(), std::optional(std::nan(""))}) {
    view.position->hpl_m = unknown;
    board.publish(view);
    EXPECT_TRUE(json(api.handle(get("/v1/state")))["position"]["hpl_m"].is_null());
  }
}

TEST_F(ApiTest, OmitsAnUnknownPosition) {
  publish(ServiceState::no_fix);
  const auto state = json(api.handle(get("/v1/state")));
  EXPECT_TRUE(state["position"].is_null());
  EXPECT_EQ(state["source"], "no_fix");
}

TEST_F(ApiTest, APositionSaysHowOldItIs) {
  FlightView view = flight.at(now_s, ServiceState::normal);
  view.position->at_s = now_s - 0.4;
  board.publish(view);
  EXPECT_NEAR(json(api.handle(get("/v1/state")))["position"]["age_s"].get<double>(), 0.4, 1e-9);
  now_s += 0.25;  // nothing new is published
  EXPECT_NEAR(json(api.handle(get("/v1/state")))["position"]["age_s"].get<double>(), 0.65, 1e-9);
}

// The longer axis of the ellipse, by hand: variances 9 along north-east, 1 across.
TEST_F(ApiTest, ReportsTheCovarianceAsAnEllipse) {
  FlightView view = flight.at(now_s, ServiceState::normal);
  view.position = PositionView{{8.5, 47.4}, 2, 5, 5, 4};
  board.publish(view);
  const auto ellipse = json(api.handle(get("/v1/state")))["position"]["ellipse"];
  EXPECT_NEAR(ellipse["major_m"].get<double>(), 3, 1e-9);
  EXPECT_NEAR(ellipse["minor_m"].get<double>(), 1, 1e-9);
  EXPECT_NEAR(ellipse["bearing_deg"].get<double>(), 45, 1e-9);
}

TEST_F(ApiTest, HostileNumbersAndTextAreEscaped) {
  FlightView view = flight.at(now_s, ServiceState::normal);
  view.position->sigma_m = std::numeric_limits<double>::quiet_NaN();
  view.anchored_s = -std::numeric_limits<double>::infinity();
  view.state.reason = "\x1b[2J\xff\xfe\"quoted\"";
  view.events.back().text = std::string("\x00\x01", 2);
  board.publish(view);
  const auto state = json(api.handle(get("/v1/state")));
  EXPECT_TRUE(state["position"]["sigma_m"].is_null());
  EXPECT_TRUE(state["anchor_age_s"].is_null());
  EXPECT_EQ(state["reason"].get<std::string>().find('\x1b'), std::string::npos);
}

TEST_F(ApiTest, HealthFollowsTheFlightsThread) {
  EXPECT_EQ(json(api.handle(get("/v1/health")))["status"], "pass");
  publish(ServiceState::degraded);
  EXPECT_EQ(json(api.handle(get("/v1/health")))["status"], "warn");
  now_s += 2.5;
  const ApiResponse silent = api.handle(get("/v1/health"));
  EXPECT_EQ(silent.status, 503);
  EXPECT_EQ(json(silent)["status"], "fail");
}

// A board that shows a minute of a recording, and what was asked for.
class PlayedApi : public test::ApiFixture {
 protected:
  PlayedApi() {
    FlightView view = flight.at(now_s, ServiceState::normal);
    view.playback = playback;
    board.publish(view);
  }
  ApiOptions played() {
    ApiOptions chosen = options();
    chosen.control_playback = [this](const PlaybackRequest& request) {
      asked = request;
      return playback;
    };
    return chosen;
  }
  ApiResponse ask(const std::string& body) {
    asked.reset();
    return played_api.handle(post("/v1/playback", body));
  }

  PlaybackView playback{.session = "one", .recorded = UtcTime{1'760'000'000}, .at_s = 12, .length_s = 60};
  std::optional<PlaybackRequest> asked;
  Api played_api{board, hints, played()};
};

TEST_F(PlayedApi, SaysThatItIsARecordingAndFitForNothing) {
  const auto state = json(played_api.handle(get("/v1/state")));
  EXPECT_EQ(state["state"], "normal");
  EXPECT_EQ(state["playback"]["recorded"], "2025-10-09T08:53:20Z");
  EXPECT_EQ(state["playback"]["at_s"], 12);
  EXPECT_EQ(state["playback"]["playing"], false);
  const ApiResponse health = played_api.handle(get("/v1/health"));
  EXPECT_EQ(health.status, 503);
  EXPECT_EQ(json(health)["status"], "fail");
  EXPECT_THAT(json(health)["reason"].get<std::string>(), HasSubstr("recording"));
  const std::string metrics = played_api.handle(get("/v1/metrics")).body;
  EXPECT_THAT(metrics, HasSubstr("nadir_playback 1"));
  EXPECT_THAT(metrics, HasSubstr("nadir_position_usable 0"));
}

TEST_F(PlayedApi, IsControlledByWhatIsAskedForAlone) {
  const ApiResponse response = ask(R"({"playing": true, "speed": 4, "at_s": 60})");
  EXPECT_EQ(response.status, 200);
  EXPECT_EQ(json(response)["session"], "one");
  ASSERT_TRUE(asked);
  EXPECT_EQ(asked->playing, true);
  EXPECT_EQ(asked->speed, 4);
  EXPECT_EQ(asked->at_s, 60);
  EXPECT_EQ(ask(R"({"at_s": 0})").status, 200);
  EXPECT_FALSE(asked->playing || asked->speed);
}

TEST_F(PlayedApi, RefusesWhatIsNoMomentAndNoSpeed) {
  for (const char* wrong : {R"({"at_s": -0.1})", R"({"at_s": 60.1})", R"({"at_s": "12"})", R"({"at_s": null})",
                            R"({"speed": 3})", R"({"speed": 2.5})", R"({"speed": 32})", R"({"playing": 1})",
                            R"({"playing": "yes"})", "{}", R"({"at": 12})", R"({"playing": true, "at_s": 61})", "[]"}) {
    expect_problem(ask(wrong), 400, "invalid");
    EXPECT_FALSE(asked) << wrong;
  }
  for (const char* none : {R"({"at_s": NaN})", R"({"at_s": Infinity})", R"({"at_s": 1e999})", "", "{"}) {
    expect_problem(ask(none), 400, "malformed");
    EXPECT_FALSE(asked) << none;
  }
}

TEST_F(PlayedApi, NoHintReachesARecordingAndNoPlaybackAFlight) {
  expect_problem(played_api.handle(post("/v1/hint", R"({"lat": 47.5, "lon": 8.6, "radius_m": 800})")), 409,
                 "recording");
  EXPECT_EQ(hints.take(), nullptr);
  publish(ServiceState::normal);
  expect_problem(api.handle(post("/v1/playback", R"({"playing": true})")), 409, "no-recording");
  EXPECT_EQ(played_api.handle(get("/v1/playback")).status, 405);
}

TEST_F(ApiTest, IsUnhealthyBeforeTheFirstView) {
  const FlightBoard empty;
  const Api starting(empty, hints, options());
  EXPECT_EQ(starting.handle(get("/v1/health")).status, 503);
  EXPECT_EQ(json(starting.handle(get("/v1/state")))["state"], "boot");
}

TEST_F(ApiTest, ServesTilesFromThePackage) {
  expect_problem(api.handle(get("/v1/tiles/16/34315/22950")), 404, "tile");
  api.use_package({.tiles = std::make_shared<test::PaintedTiles>(), .frame = nullptr, .surface = nullptr});
  const ApiResponse tile = api.handle(get("/v1/tiles/16/34315/22950?x=y"));
  EXPECT_EQ(tile.status, 200);
  EXPECT_EQ(tile.content_type, "image/jpeg");
  EXPECT_EQ(tile.body.substr(0, 3), "\xff\xd8\xff");
  const ApiResponse beyond = api.handle(get("/v1/tiles/2/0/0"));
  EXPECT_EQ(beyond.status, 204) << "beyond the edge of the map";
  EXPECT_TRUE(beyond.body.empty());
  for (const char* none :
       {"25/0/0", "16/99999999/0", "16/-1/0", "16/1", "16/1/2/3", "016/1/2", "../../etc/passwd", ""}) {
    expect_problem(api.handle(get(std::string("/v1/tiles/") + none)), 404, "tile");
  }
}

class BrokenTiles final : public TileSource {
 public:
  ZoomRange zooms() const override { return {0, 20}; }
  std::optional<Bytes> read(const TileKey& key) const override {
    if (key.z == 1) return Bytes{1, 2, 3};
    throw Error({.what = "disk gone"});
  }
};

TEST_F(ApiTest, ADamagedTileSetIsReported) {
  api.use_package({.tiles = std::make_shared<BrokenTiles>(), .frame = nullptr, .surface = nullptr});
  expect_problem(api.handle(get("/v1/tiles/2/0/0")), 500, "internal");
  expect_problem(api.handle(get("/v1/tiles/1/0/0")), 404, "tile");
}

TEST_F(ApiTest, PassesOnAHint) {
  const ApiResponse taken = api.handle(post("/v1/hint", R"({"lat": 47.5, "lon": 8.6, "radius_m": 800})"));
  EXPECT_EQ(taken.status, 202);
  const auto hint = hints.take();
  ASSERT_NE(hint, nullptr);
  EXPECT_EQ(hint->place, (LonLat{8.6, 47.5}));
  EXPECT_EQ(hint->radius_m, 800);
}

TEST_F(ApiTest, RejectsAnInvalidHintWithAllErrors) {
  const ApiResponse refused = api.handle(post("/v1/hint", R"({"lat": 91, "lon": "x", "radius": 5})"));
  expect_problem(refused, 400, "invalid");
  const std::string errors = json(refused)["errors"].dump();
  for (const char* pointer : {"/lat", "/lon", "/radius_m", "\"/radius\""}) EXPECT_THAT(errors, HasSubstr(pointer));
  for (const char* body : {R"({"lat": 1, "lon": 1, "radius_m": 0})", R"({"lat": 1, "lon": 1, "radius_m": -5})",
                           R"({"lat": null, "lon": 1, "radius_m": 5})", "[]", "7"}) {
    expect_problem(api.handle(post("/v1/hint", body)), 400, "invalid");
  }
  for (const char* body : {"", "{", R"({"lat": NaN})", R"({"lat": 1, "lat": 2, "lon": 1, "radius_m": 5})", "\xff",
                           "[[[[[[[[[]]]]]]]]]", R"({"lat": 1e999, "lon": 1, "radius_m": 5})"}) {
    expect_problem(api.handle(post("/v1/hint", body)), 400, "malformed");
  }
  EXPECT_EQ(hints.take(), nullptr);
}

// A request that another site's page can make a browser send does not have JSON's media type.
TEST_F(ApiTest, AcceptsOnlyJson) {
  ApiRequest request = post("/v1/hint", R"({"lat": 1, "lon": 1, "radius_m": 5})");
  for (const char* type : {"", "text/plain", "application/x-www-form-urlencoded", "application/jsonp"}) {
    request.content_type = type;
    expect_problem(api.handle(request), 415, "media-type");
  }
  request.content_type = "Application/JSON ; charset=utf-8";
  EXPECT_EQ(api.handle(request).status, 202);
}

TEST_F(ApiTest, RejectsOtherMethodsAndPaths) {
  for (const char* method : {"POST", "PUT", "DELETE", "OPTIONS", "TRACE", "", "get"}) {
    ApiRequest request = get("/v1/state");
    request.method = method;
    const ApiResponse refused = api.handle(request);
    expect_problem(refused, 405, "method");
    EXPECT_EQ(header(refused, "Allow"), "GET, HEAD");
  }
  EXPECT_EQ(header(api.handle(get("/v1/hint")), "Allow"), "POST");
  for (const char* path : {"/v1", "/v1/", "/v2/state", "/v1/states", "", "*", "//", "/index.html"}) {
    expect_problem(api.handle(get(path)), 404, "path");
  }
}

TEST_F(ApiTest, OnLoopbackServesOnlyLoopbackNames) {
  for (const char* host : {"localhost", "LOCALHOST:1", "127.0.0.1:8750", "[::1]:8750"}) {
    ApiRequest request = get("/v1/state");
    request.host = host;
    EXPECT_EQ(api.handle(request).status, 200) << host;
  }
  for (const char* host : {"", "evil.example", "localhost.evil.example", "[::2]", "127.0.0.1.evil"}) {
    ApiRequest request = get("/v1/state");
    request.host = host;
    expect_problem(api.handle(request), 421, "host");
  }
}

TEST_F(ApiTest, AConfiguredTokenIsRequiredForEveryCall) {
  ApiOptions guarded = options();
  guarded.token = sha256(as_bytes("0123456789abcdef"));
  guarded.loopback = false;
  const Api served(board, hints, guarded);
  ApiRequest request = get("/v1/state");
  request.host = "10.0.0.5:8750";
  for (const char* sent : {"", "Bearer ", "Bearer 0123456789abcde", "Bearer 0123456789abcdefg",
                           "Basic 0123456789abcdef", "0123456789abcdef"}) {
    request.authorization = sent;
    const ApiResponse refused = served.handle(request);
    expect_problem(refused, 401, "token");
    EXPECT_EQ(header(refused, "WWW-Authenticate"), "Bearer");
  }
  for (const char* sent : {"Bearer 0123456789abcdef", "bearer 0123456789abcdef"}) {
    request.authorization = sent;
    EXPECT_EQ(served.handle(request).status, 200);
  }
  // Without it even missing paths are not revealed; only the page is served, because it asks for the token.
  EXPECT_EQ(served.handle(get("/v1/none")).status, 401);
  EXPECT_EQ(served.handle(get("/")).status, 200);
}

TEST_F(ApiTest, ThePageLoadsNoExternalResources) {
  const ApiResponse page = api.handle(get("/"));
  EXPECT_THAT(page.content_type, HasSubstr("text/html"));
  EXPECT_THAT(header(page, "Content-Security-Policy"), HasSubstr("default-src 'none'"));
  for (const char* path : {"/", "/page.css", "/page.js", "/leaflet.js", "/leaflet.css"}) {
    std::string text = api.handle(get(path)).body;
    EXPECT_GT(text.size(), 500U) << path;
    // Names of XML, and Leaflet's own address: a link, not something that is loaded.
    for (const std::string_view name : {"http://www.w3.org/", "https://leafletjs.com"}) {
      for (std::size_t at; (at = text.find(name)) != std::string::npos;) text.erase(at, name.size());
    }
    EXPECT_EQ(text.find("://"), std::string::npos) << path;
  }
}

// Everybody on the computer may read; a hint changes the flight.
TEST_F(ApiTest, OnLoopbackHintsNeedTheirTokenAndReadingNone) {
  ApiOptions guarded = options();
  guarded.hint_token = sha256(as_bytes("a-secret-of-the-crew"));
  const Api served(board, hints, guarded);
  EXPECT_EQ(served.handle(get("/v1/state")).status, 200);
  EXPECT_EQ(served.handle(get("/v1/package")).status, 200);
  ApiRequest hint = post("/v1/hint", R"({"lat": 47.5, "lon": 8.6, "radius_m": 800})");
  expect_problem(served.handle(hint), 401, "token");
  hint.authorization = "Bearer guessed-it-perhaps";
  expect_problem(served.handle(hint), 401, "token");
  EXPECT_EQ(hints.take(), nullptr);
  hint.authorization = "Bearer a-secret-of-the-crew";
  EXPECT_EQ(served.handle(hint).status, 202);
  EXPECT_NE(hints.take(), nullptr);
}

TEST_F(ApiTest, HintsAreTakenAtALimitedRate) {
  const ApiRequest hint = post("/v1/hint", R"({"lat": 47.5, "lon": 8.6, "radius_m": 800})");
  for (int i = 0; i < kHintBurst; ++i) EXPECT_EQ(api.handle(hint).status, 202) << i;
  for (int i = 0; i < 100; ++i) {
    const ApiResponse refused = api.handle(hint);
    expect_problem(refused, 429, "too-many-hints");
    EXPECT_TRUE(std::ranges::any_of(refused.headers, [](const auto& header) { return header.first == "Retry-After"; }));
  }
  expect_problem(api.handle(post("/v1/hint", "{}")), 400, "invalid");
  now_s += kHintPeriod_s;
  EXPECT_EQ(api.handle(hint).status, 202);
  EXPECT_EQ(api.handle(hint).status, 429);
  now_s += 3600;
  for (int i = 0; i < kHintBurst; ++i)
    EXPECT_EQ(api.handle(hint).status, 202) << "after an hour, no more than the burst";
  EXPECT_EQ(api.handle(hint).status, 429);
}

TEST_F(ApiTest, AlarmsHaveAListOfTheirOwn) {
  for (int i = 0; i < 200; ++i) {
    flight.note(now_s, EventSeverity::info, "hint", std::string(static_cast<std::size_t>(i + 1), 'x'));
  }
  publish(ServiceState::normal);
  const nlohmann::json state = json(api.handle(get("/v1/state")));
  EXPECT_EQ(state["events"].size(), 100U);
  ASSERT_EQ(state["alarms"].size(), 1U);
  EXPECT_EQ(state["alarms"][0]["kind"], "gps");
  EXPECT_EQ(state["alarms"][0]["severity"], "critical");
}

}  // namespace
}  // namespace nadir
