#include "recorder/sample_records.hpp"

namespace nadir::test {
namespace {

Telemetry telemetry(Random& random) {
  Telemetry sample;
  sample.frame = "frame \"é\" 1.jpg";
  sample.time_s = random.normal(1000, 100);
  if (random.chance(0.7)) sample.agl_m = random.normal(120, 3);
  if (random.chance(0.7)) sample.heading_rad = random.normal();
  if (random.chance(0.7)) sample.pitch_rad = random.normal();
  if (random.chance(0.7)) sample.roll_rad = random.normal();
  if (random.chance(0.5)) sample.imu_dv_mps = Eigen::Vector2d(random.normal(), random.normal());
  if (random.chance(0.5)) sample.rate_rad_s = Eigen::Vector3d(random.normal(), random.normal(), random.normal());
  while (random.chance(0.5)) {
    TelemetryInterval& stretch = sample.intervals.emplace_back();
    stretch.seconds = random.uniform(0, 1);
    if (random.chance(0.7)) stretch.heading_rad = random.normal();
    if (random.chance(0.7)) stretch.imu_dv_mps = Eigen::Vector2d(random.normal(), random.normal());
  }
  const auto three = [&random] { return Eigen::Vector3d(random.normal(), random.normal(), random.normal()); };
  while (random.chance(0.6)) sample.inertial.push_back({random.normal(1000, 100), three(), three()});
  if (random.chance(0.5)) sample.gps_position = LonLat{random.uniform(-180, 180), random.uniform(-90, 90)};
  return sample;
}

Estimate estimate(Random& random) {
  Estimate e;
  e.frame = "frame.jpg";
  e.time_s = random.normal(1000, 100);
  if (random.chance(0.7)) e.position = LonLat{random.uniform(-180, 180), random.uniform(-90, 90)};
  e.sigma_m = random.uniform(0, 100);
  e.covariance_m2 << random.normal(), random.normal(), random.normal(), random.normal();
  e.source = static_cast<SourceLabel>(random.integer(0, 3));
  e.segment = random.integer(0, 9);
  if (random.chance(0.7)) e.anchor_age_s = random.uniform(0, 60);
  e.anchor_inliers = random.integer(0, 100);
  e.anchor_ratio = random.uniform();
  e.latency_ms = random.uniform(0, 200);
  if (random.chance(0.7)) e.hpl_m = random.uniform(0, 500);
  return e;
}

AnchorReport anchor(Random& random) {
  AnchorReport a;
  a.verdict = static_cast<AnchorVerdict>(random.integer(1, 8));
  a.score = random.uniform();
  a.ratio = random.uniform();
  a.inliers = random.integer(0, 50);
  a.patches = random.integer(50, 100);
  a.residual_px = random.uniform(0, 3);
  a.matching_gsd_m = random.uniform(0.3, 2);
  a.chi2 = random.uniform(0, 100);
  if (random.chance(0.7)) a.camera = PlanePoint{random.normal(0, 1000), random.normal(0, 1000)};
  a.heading_rad = random.normal();
  a.window_radius_m = random.uniform(60, 1200);
  a.log_likelihood_ratio = random.normal(0, 5);
  a.place_doubt = random.uniform();
  return a;
}

FixInputRecord fix_input(Random& random) {
  FixInputRecord record;
  record.number = static_cast<std::uint64_t>(random.integer(0, 1'000'000));
  record.time_us = 1'000'000'000'000 + random.integer(0, 1'000'000);
  record.unix_us = 1'760'000'000'100'000 + random.integer(0, 1'000'000);
  record.status = {random.chance(0.7), random.chance(0.7), static_cast<SourceLabel>(random.integer(0, 3)),
                   random.uniform(0, 90)};
  record.sent = random.chance(0.7);
  record.missing = static_cast<std::uint32_t>(random.integer(0, 9));
  const auto real = [&] { return static_cast<float>(random.normal()); };
  const auto what = [&]() -> decltype(FixInputRecord::Input::what) {
    const int kind = random.integer(0, 2);
    if (kind == 0) return FixInputRecord::Attitude{real(), real(), real()};
    if (kind == 1) return FixInputRecord::Acceleration{real(), real(), real()};
    return FixInputRecord::ArrivedEstimate{static_cast<std::uint64_t>(random.integer(0, 99)), random.chance(0.5)};
  };
  while (random.chance(0.9)) record.inputs.push_back({record.time_us - random.integer(0, 2'000'000'000), what()});
  return record;
}

FixRecord fix(Random& random) {
  FixRecord fix;
  fix.time_s = random.normal(1000, 100);
  fix.unix_us = 1'760'000'000'100'000 + random.integer(0, 1'000'000);
  fix.accuracy_m = 999;
  if (random.chance(0.7)) {
    fix.fix_type = 3;
    fix.source = static_cast<SourceLabel>(random.integer(0, 2));
    fix.place = LonLat{random.uniform(-180, 180), random.uniform(-90, 90)};
    fix.accuracy_m = random.uniform(1, 500);
    fix.msl_m = random.normal(500, 100);
    fix.vertical_accuracy_m = random.uniform(1, 20);
    fix.north_mps = random.normal();
    fix.east_mps = random.normal();
    fix.down_mps = random.normal();
    fix.speed_accuracy_mps = random.uniform(1, 3);
  }
  if (random.chance(0.7)) {
    fix.gps =
        FixRecord::Receiver{random.uniform(0, 1), random.integer(0, 6), {random.normal(), random.normal()}, 480.5, {}};
    if (random.chance(0.5)) fix.gps->accuracy_m = random.uniform(1, 5);
  }
  return fix;
}

Bytes noise(Random& random, int size) {
  Bytes bytes(static_cast<std::size_t>(size));
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random.integer(0, 255));
  return bytes;
}

}  // namespace

SessionRecord sample_session() {
  SessionRecord session;
  session.id = "a1b2";
  session.started_ns = 1'760'000'000'123'456'789;
  session.program = "nadir tests";
  session.version = "0.1.0";
  session.airframe = "NV-7";
  session.package = sha256(as_bytes("manifest"));
  session.mission = "valley";
  session.camera.camera = {1920, 1080, 1400.5, 1401.5, 959.5, 539.5, {0.1, -0.05, 0.001, -0.002, 0.01}};
  session.camera.uncertainty = {0.02, 0.03, 0.04, 0.05};
  session.camera.readout = SensorReadout{0.02, SensorReadout::Direction::left};
  session.camera.on_gimbal = true;
  session.origin = {8.5, 47.4};
  session.start = LonLat{8.51, 47.41};
  session.picture_shrink = 2;
  session.seed = 42;
  session.localizer.integrity_risk = 1e-6;
  session.localizer.area = PlaneBox{-100, -200, 300, 400};
  session.localizer.map_sigma_m = 1.7;
  session.terrain = true;
  session.places = false;
  session.matchability = true;
  session.localizer.resumed = true;
  session.settings = {{"matcher", "channels"}, {"camera source", "folder"}};
  return session;
}

InputRecord sample_input(std::uint64_t index) {
  Random random = Random(7).fork("input", index);
  return {index, telemetry(random), sha256(as_bytes(std::to_string(index))), 1000 + index};
}

EstimateRecord sample_estimate(std::uint64_t index) {
  Random random = Random(7).fork("estimate", index);
  return {index,
          estimate(random),
          {random.chance(0.5), random.integer(0, 99), random.uniform(0, 10)},
          {{1.5, -2.5}, 0.5, random.normal(), 0.01, 120.5, 1.5}};
}

std::vector<Record> sample_records(Random& random) {
  return {sample_session(),
          InputRecord{1, telemetry(random), sha256(as_bytes("picture")), 1234},
          FrameRecord{1, "frame.jpg", noise(random, 500)},
          EstimateRecord{1, estimate(random), {true, 55, 4.5}, {}},
          AnchorRecord{1, "frame.jpg", 12.5, anchor(random), 3},
          StateRecord{"normal", "degraded", "no anchor for 30 s"},
          TileRecord{{17, 70000, 45000}, "artifact.hash", "taken as missing"},
          HealthRecord{false, {{"memory_mb", 312.5}, {"frames_dropped", 3}}, {"camera is slow"}},
          ThumbnailRecord{1, "frame.jpg", AnchorVerdict::ambiguous, noise(random, 300), {}},
          RecorderRecord{RecorderEventKind::dropped_by_disk, "/thumbnail", 17, "no room"},
          EndRecord{true, 100, 3, "landed"},
          HintRecord{7, {random.uniform(-180, 180), random.uniform(-90, 90)}, random.uniform(1, 900), "operator"},
          fix(random),
          fix_input(random)};
}

bool same(const Record& a, const Record& b) { return a.index() == b.index() && encode(a) == encode(b); }

std::vector<Record> ReadBack::of(Topic topic) const {
  std::vector<Record> found;
  for (const auto& [kind, record] : records) {
    if (kind == topic) found.push_back(record);
  }
  return found;
}

ReadBack read_back(const ByteSource& source) {
  ReadBack back;
  back.contents = read_mcap(source, "test", [&](const McapContents& contents, const McapMessage& message) {
    const auto topic = parse_topic(contents.channels.at(message.channel_id).topic);
    std::optional<Record> record;
    if (topic) record = decode(*topic, message.data);
    if (record) {
      back.records.emplace_back(*topic, std::move(*record));
    } else {
      ++back.undecodable;
    }
  });
  return back;
}

ReadBack read_back(const std::filesystem::path& path) { return read_back(FileSource(path)); }

}  // namespace nadir::test
