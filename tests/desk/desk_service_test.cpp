#include "desk/desk_service.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <thread>

#include "base/error.hpp"
#include "base/files.hpp"
#include "desk/desk_fixture.hpp"
#include "http/raw_client.hpp"

namespace nadir {
namespace {

using test::RawClient;
using ::testing::HasSubstr;

class DeskServiceTest : public test::DeskFixture {
 protected:
  // A signed package of noise, judged while it is valid.
  void add_package(const std::string& name) {
    maker.make(folder, name);
    std::filesystem::create_directories(options.root / "packages");
    std::filesystem::rename(folder / name, options.root / "packages" / name);
    options.trust = folder.write("root.json", sign_root(maker.root, {&maker.signer}).json());
  }

  test::PackageMaker maker;
};

// Accepted pictures, and the wish to complete, outlive the desk.
TEST_F(DeskServiceTest, GoesOnAfterARestart) {
  open();
  const std::string flight = create();
  const auto& pictures = test::flight_pictures(test::Course::smooth);
  send(flight, pictures);
  ASSERT_EQ(call(post(flight + "/complete", "")).status, 202);
  close();  // in the middle of it, or not
  open();
  const auto document = settled(flight);
  EXPECT_EQ(document["state"], "completed");
  EXPECT_EQ(read(flight + "/estimates?kind=refined")["estimates"].size(), pictures.size());
  EXPECT_EQ(read(flight + "/estimates?kind=adjusted")["estimates"].size(), pictures.size());
  close();
  open();
  EXPECT_EQ(read("/v1/flights")["flights"][0]["state"], "completed") << "without opening it";
}

// Pictures of another place than the package's: a person learns why, also after a restart.
TEST_F(DeskServiceTest, SaysWhyPicturesMatchNowhere) {
  add_package("noise");
  open();
  const std::string flight = create({{"package", "noise"}});
  EXPECT_TRUE(read(flight)["diagnosis"].is_null());
  send(flight, test::flight_pictures(test::Course::smooth));
  EXPECT_THAT(settled(flight)["diagnosis"].get<std::string>(), HasSubstr("match nowhere in this package"));
  close();
  open();
  EXPECT_THAT(read(flight)["diagnosis"].get<std::string>(), HasSubstr("match nowhere in this package"));
}

TEST_F(DeskServiceTest, OneDeskUsesAFolder) {
  open();
  EXPECT_THROW(DeskService second(options), UsageError);
}

TEST_F(DeskServiceTest, IdleFlightsMakeRoom) {
  options.limits.live_flights = 1;
  open();
  const std::string first = create(), second = create();
  const auto id = [](const std::string& path) { return path.substr(path.rfind('/') + 1); };
  EXPECT_EQ(read(first)["state"], "idle");
  EXPECT_EQ(read(second)["state"], "idle");
  const auto held = desk->open(id(second));
  EXPECT_THROW(desk->open(id(first)), DeskBusy);
  EXPECT_EQ(call(get(first)).status, 503);
  EXPECT_EQ(read("/v1/flights")["flights"].size(), 2U);
}

TEST_F(DeskServiceTest, MoreFlightsThanPlacesAreAllFinished) {
  open();
  const auto& pictures = test::flight_pictures(test::Course::smooth);
  std::vector<std::string> flights;
  for (int i = 0; i < 3; ++i) {
    flights.push_back(create());
    send(flights.back(), pictures);
  }
  close();
  options.limits.live_flights = 1;
  open();
  const auto processed = [&] {
    std::size_t frames = 0;
    const auto list = read("/v1/flights")["flights"];
    for (const auto& flight : list) frames += flight["pictures"]["processed"].get<std::size_t>();
    return frames;
  };
  for (int i = 0; i < 6000 && processed() < 3 * pictures.size(); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_EQ(processed(), 3 * pictures.size());
}

TEST_F(DeskServiceTest, HoldsSoManyFlightsAndNoMore) {
  options.limits.flights = 1;
  open();
  create();
  const nlohmann::json body{{"name", "x"}, {"camera", test::camera_yaml()}, {"start", {{"lat", 48}, {"lon", 11}}}};
  EXPECT_EQ(call(post("/v1/flights", body.dump())).status, 507);
}

TEST_F(DeskServiceTest, ADamagedFlightIsListedAndHarmsNoOther) {
  open();
  const std::string flight = create(), other = create();
  close();
  const auto file = options.root / "flights" / flight.substr(flight.rfind('/') + 1) / kFlightFile;
  write_file_atomic(file, std::string_view("no database"));
  open();
  const auto list = read("/v1/flights");
  for (const auto& listed : list["flights"]) {
    EXPECT_EQ(listed["state"] == "damaged", flight.ends_with(listed["id"].get<std::string>())) << listed;
  }
  EXPECT_GE(call(get(flight)).status, 400);
  EXPECT_EQ(read(other)["state"], "idle");
}

TEST_F(DeskServiceTest, ServesTheMapAndFliesOverIt) {
  add_package("valley");
  open();
  const auto packages = read("/v1/packages")["packages"];
  ASSERT_EQ(packages.size(), 1U);
  ASSERT_EQ(packages[0]["accepted"], true) << packages;
  const auto package = desk->packages().find("valley")->package;
  const TileKey key = package->tiles->sidecars().front().key;
  const ApiResponse tile = call(get(fmt::format("/v1/packages/valley/tiles/{}/{}/{}", key.z, key.x, key.y)));
  EXPECT_EQ(tile.status, 200);
  EXPECT_EQ(tile.content_type, "image/jpeg");
  EXPECT_EQ(as_bytes(tile.body).size(), package->tiles->read(key)->size());
  EXPECT_EQ(call(get("/v1/packages/valley/tiles/3/0/0")).status, 204) << "beyond the edge of the map";
  for (const char* none : {"hill/tiles/3/0/0", "..%2fvalley/tiles/3/0/0", "valley/tiles/x/0/0"}) {
    EXPECT_EQ(call(get(std::string("/v1/packages/") + none)).status, 404) << none;
  }
  // Its map is noise: no look is accepted, and the flight says what it looked at.
  const std::string flight = create({{"package", "valley"}});
  send(flight, test::flight_pictures(test::Course::smooth));
  EXPECT_EQ(settled(flight)["state"], "idle");
  EXPECT_EQ(read(flight + "/estimates")["estimates"].size(), 5U);
  // Its pictures float. They were searched as a whole, which placed nothing.
  const auto segments = read(flight + "/segments")["segments"];
  for (const auto& segment : segments) EXPECT_EQ(segment["state"], "floating");
  const auto live = desk->open(flight.substr(flight.rfind('/') + 1));
  for (const EventRow& row : live->store().events_after(0, 1000)) {
    if (row.event.kind != FlightEventKind::user_input_needed) continue;
    const auto body = nlohmann::json::parse(row.event.body);
    if (!body.contains("candidates")) continue;
    EXPECT_LE(body["candidates"].size(), 5U);
    EXPECT_TRUE(body["candidates"][0]["likeness"].is_number());
  }
  EXPECT_EQ(call(request("DELETE", flight + "/segments/0/merge")).status, 404) << "it is not merged";
  EXPECT_EQ(call(request("DELETE", flight + "/segments/99/merge")).status, 404);
  EXPECT_EQ(call(request("GET", flight + "/segments/0/merge")).status, 405);
}

TEST_F(DeskServiceTest, WithoutARootOfTrustNoPackageIsUsed) {
  add_package("valley");
  options.trust.reset();
  open();
  const auto packages = read("/v1/packages")["packages"];
  EXPECT_EQ(packages[0]["accepted"], false);
  EXPECT_THAT(packages[0]["reason"].get<std::string>(), HasSubstr("--trust"));
}

// A flight never goes on over another map than the one that it was begun with.
TEST_F(DeskServiceTest, AnotherPackageBlocksAFlightUntilItsOwnIsBack) {
  add_package("valley");
  open();
  const std::string flight = create({{"package", "valley"}});
  close();
  std::filesystem::rename(options.root / "packages/valley", folder / "away");
  open();
  auto pictures = test::flight_pictures(test::Course::smooth);
  pictures.resize(2);  // too few to ask why they match nowhere
  send(flight, pictures);
  auto document = settled(flight);
  EXPECT_EQ(document["state"], "blocked");
  EXPECT_THAT(document["reason"].get<std::string>(), HasSubstr("no such package"));
  std::filesystem::rename(folder / "away", options.root / "packages/valley");
  send(flight, pictures);  // all known; tried again
  document = settled(flight);
  EXPECT_EQ(document["state"], "idle") << document;
  EXPECT_EQ(document["pictures"]["processed"], 2);
}

// ---- Over a real socket

class DeskSocketTest : public DeskServiceTest {
 protected:
  void serve(HttpLimits limits = desk_http_limits()) {
    open();
    server.reset();
    limits.stream_interval = std::chrono::milliseconds(10);
    server.emplace(*api, ListenAddress{.port = 0}, limits);
  }
  void TearDown() override { server.reset(); }
  std::string request(const std::string& text) const {
    RawClient client(server->port());
    client.send(text);
    return client.read_to_the_end();
  }
  static std::string head(const std::string& line, const std::string& more = "") {
    return line + " HTTP/1.1\r\nHost: localhost\r\n" + more + "\r\n";
  }

  std::optional<HttpServer> server;
};

TEST_F(DeskSocketTest, EventsAreReplayedAfterABreak) {
  serve();
  const std::string flight = create();
  RawClient early(server->port());
  early.send(head("GET " + flight + "/events"));
  const std::string created = early.read_until("event: flight_created");
  EXPECT_THAT(created, HasSubstr("text/event-stream"));
  send(flight, test::flight_pictures(test::Course::smooth));
  const std::string live = early.read_until("\"frame\":4");
  EXPECT_THAT(live, HasSubstr("event: pictures_accepted"));
  EXPECT_THAT(live, HasSubstr("event: frame_processed"));

  settled(flight);
  const auto last = read(flight)["last_event"].get<int>();
  RawClient late(server->port());
  late.send(head("GET " + flight + "/events", fmt::format("Last-Event-ID: {}\r\n", last - 2)));
  const std::string replayed = late.read_until(fmt::format("id: {}\n", last));
  EXPECT_THAT(replayed, HasSubstr(fmt::format("id: {}\n", last - 1)));
  EXPECT_EQ(replayed.find(fmt::format("id: {}\n", last - 2)), std::string::npos);
}

TEST_F(DeskSocketTest, FiftyReadersHearOfEveryFrame) {
  serve();
  const std::string flight = create();
  std::vector<RawClient> readers;
  for (int i = 0; i < 50; ++i) {
    readers.emplace_back(server->port());
    readers.back().send(head("GET " + flight + "/events"));
  }
  const auto& pictures = test::flight_pictures(test::Course::smooth);
  const test::BatchBody batch = test::batch_of(pictures, test::telemetry_csv(pictures));
  const std::string answer = request(head("POST " + flight + "/pictures",
                                          fmt::format("Content-Type: {}\r\nContent-Length: {}\r\nConnection: close\r\n",
                                                      batch.content_type, batch.body.size())) +
                                     batch.body);
  EXPECT_THAT(answer, HasSubstr("\"accepted\":5"));
  for (RawClient& reader : readers) {
    const std::string text = reader.read_until("\"frame\":4");
    for (int frame = 0; frame < 4; ++frame) EXPECT_THAT(text, HasSubstr(fmt::format("\"frame\":{}", frame)));
  }
  EXPECT_EQ(server->counts().streams_open, 50U);
}

TEST_F(DeskSocketTest, ABodyThatIsTooLargeIsRefusedBeforeItComes) {
  serve();
  const std::string answer =
      request(head("POST /v1/flights/0123456789ab/pictures",
                   "Content-Type: image/png\r\nContent-Length: 99999999999\r\nExpect: 100-continue\r\n"));
  EXPECT_THAT(answer, HasSubstr("HTTP/1.1 413 "));
}

}  // namespace
}  // namespace nadir
