// Readers of autopilots' logs: judged by pymavlink and pyulog, and attacked.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/input_file.hpp"
#include "flight_import/ardupilot_log.hpp"
#include "flight_import/mavlink_log.hpp"
#include "flight_import/px4_log.hpp"
#include "flight_import/sample_logs.hpp"
#include "geodesy/angles.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using test::Packed;
using test::SampleFlight;

const std::vector<double> kTriggers{110.05, 113.42, 121.9, 150.25, 171.6, 203.3};

struct Format {
  const char* name;
  FlightLog (*read)(LogStream&);
  bool (*is)(LogStream&);
  Bytes bytes;
};

FlightLog read(const Format& format, ByteView bytes) {
  LogStream stream(bytes, "log");
  return format.read(stream);
}

const Format& format_of(int number) {
  static const std::vector<Format> all{
      {"dataflash", read_ardupilot_log, is_ardupilot_log, test::sample_dataflash({}, kTriggers)},
      {"ulog", read_px4_log, is_px4_log, test::sample_ulog({}, kTriggers)},
      {"tlog", read_mavlink_log, is_mavlink_log, test::sample_tlog({}, kTriggers)}};
  return all[static_cast<std::size_t>(number)];
}

class EveryLog : public ::testing::TestWithParam<int> {
 protected:
  const Format& format() const { return format_of(GetParam()); }
  test::TemporaryFolder folder_;
};
INSTANTIATE_TEST_SUITE_P(Logs, EveryLog, ::testing::Values(0, 1, 2),
                         [](const auto& one) { return std::string(format_of(one.param).name); });

TEST_P(EveryLog, HasTheFlightThatWasFlown) {
  const SampleFlight flight;
  const FlightLog log = read(format(), format().bytes);
  EXPECT_EQ(log.damaged, 0U);
  EXPECT_EQ(log.wrong_times, 0U);
  EXPECT_FALSE(log.truncated);
  EXPECT_FALSE(log.restarted);
  ASSERT_TRUE(log.unix_from_log_s);
  EXPECT_NEAR(*log.unix_from_log_s, flight.unix_from_boot_s, 0.002);
  EXPECT_EQ(log.utc_from, "GPS");
  ASSERT_EQ(log.triggers.size(), kTriggers.size());
  for (std::size_t i = 0; i < kTriggers.size(); ++i) EXPECT_NEAR(log.triggers[i].time_s, kTriggers[i], 2e-3);
  for (const double t : {105.03, 114.77, 133.0, 199.99}) {
    const auto attitude = attitude_at(log.attitudes, t, 2);
    ASSERT_TRUE(attitude);
    EXPECT_NEAR(degrees(wrap_pi(attitude->heading_rad - flight.attitude_at(t).heading_rad)), 0, 0.8) << t;
    EXPECT_NEAR(degrees(attitude->pitch_rad), degrees(flight.attitude_at(t).pitch_rad), 0.05) << t;
    EXPECT_NEAR(degrees(attitude->roll_rad), degrees(flight.attitude_at(t).roll_rad), 0.05) << t;
    EXPECT_NEAR(*height_at(log.home_heights, t, 5), flight.height_at(t), 0.02);
    const auto position = position_at(log.positions, t, 2);
    ASSERT_TRUE(position);
    EXPECT_NEAR(position->place.lat_deg, flight.lat_at(t), 1.5e-5);  // the tlog's arrive a fifth of a second late
    EXPECT_NEAR(position->msl_m, 400 + flight.height_at(t), 0.03);
  }
  EXPECT_FALSE(attitude_at(log.attitudes, 90, 2));
  EXPECT_FALSE(attitude_at(log.attitudes, 230, 2));
}

TEST(InertialOfLogs, IsThatOfTheFlightAndNoMoreThanIsNeeded) {
  for (const int hz : {50, 400}) {
    const SampleFlight flight{.inertial_hz = hz};
    for (const Format& format :
         {Format{"dataflash", read_ardupilot_log, is_ardupilot_log, test::sample_dataflash(flight, {})},
          Format{"ulog", read_px4_log, is_px4_log, test::sample_ulog(flight, {})}}) {
      SCOPED_TRACE(fmt::format("{} at {} Hz", format.name, hz));
      const FlightLog log = read(format, format.bytes);
      EXPECT_NEAR(static_cast<double>(log.inertial.size()), 120 * std::min(hz, 100), 12);
      Eigen::Vector3d worst = Eigen::Vector3d::Zero();
      for (const InertialSample& sample : log.inertial) {
        const Eigen::Vector3d rate = flight.rate_at(sample.time_s - (hz > 100 ? 0.00375 : 0));  // middle of four
        worst = worst.cwiseMax((sample.rate_rad_s - rate).cwiseAbs());
        ASSERT_NEAR(sample.force_mps2.z(), -9.8, 1e-5);
      }
      EXPECT_LT(worst.x(), radians(0.5));
      EXPECT_LT(worst.y(), radians(0.5));
      EXPECT_LT(worst.z(), radians(40));  // of the simulated turns, which begin at once
    }
  }
}

TEST(InertialOfLogs, DamageAndDisorderAreLeftOut) {
  LogBuilder builder("");
  const Eigen::Vector3d rate(0.1, 0, 0), force(0, 0, -9.8);
  for (const double time_s : {1.0, 1.02, 1.01, 1.02, 1.04, std::nan("")}) builder.inertial(time_s, rate, force);
  builder.inertial(1.06, {std::nan(""), 0, 0}, force);
  builder.inertial(1.07, {1e6, 0, 0}, force);
  builder.inertial(1.08, rate, force);
  const FlightLog log = builder.finish();
  std::vector<double> times_s;
  for (const InertialSample& sample : log.inertial) {
    times_s.push_back(sample.time_s);
    EXPECT_EQ(sample.rate_rad_s, rate);
  }
  EXPECT_EQ(times_s, (std::vector{1.0, 1.02, 1.04, 1.08}));
}

TEST_P(EveryLog, FromAFileAsFromMemory) {
  LogStream stream{InputFile(folder_.write("a.log", as_text(format().bytes)))};
  const FlightLog log = format().read(stream);
  EXPECT_EQ(log.attitudes.size(), read(format(), format().bytes).attitudes.size());
}

TEST_P(EveryLog, TruncatedAtEveryHundredthByte) {
  const std::size_t all = read(format(), format().bytes).attitudes.size();
  std::size_t last = 0, cut = 0;
  for (std::size_t size = 0; size < format().bytes.size(); size += 100) {
    const ByteView part = ByteView(format().bytes).first(size);
    LogStream probe(part, "log");
    if (!format().is(probe)) {
      EXPECT_LT(size, 200U);
      EXPECT_THROW(read(format(), part), UsageError);
      continue;
    }
    const FlightLog log = read(format(), part);
    EXPECT_GE(log.attitudes.size(), last);  // what is there is read
    EXPECT_EQ(log.damaged, 0U);
    cut += log.truncated ? 1U : 0U;
    last = log.attitudes.size();
  }
  EXPECT_GE(last + 3, all);
  EXPECT_GT(cut, 0U);
}

TEST_P(EveryLog, DamageCostsTheRecordsThatItHit) {
  const std::size_t all = read(format(), format().bytes).attitudes.size();
  Bytes damaged = format().bytes;
  const std::size_t middle = damaged.size() / 2;
  for (std::size_t i = 0; i < 150; ++i) damaged[middle + i] = static_cast<std::uint8_t>(i * 37);
  const FlightLog log = read(format(), damaged);
  EXPECT_GT(log.damaged, 0U);
  EXPECT_GT(log.attitudes.size(), all * 8 / 10);
  EXPECT_TRUE(std::is_sorted(log.attitudes.begin(), log.attitudes.end(),
                             [](const auto& a, const auto& b) { return a.time_s < b.time_s; }));
}

TEST_P(EveryLog, TwoFlightsInOneFileEndTheFirst) {
  Bytes twice = format().bytes;
  const std::size_t header = std::string_view(format().name) == "ulog" ? 16 : 0;
  twice.insert(twice.end(), format().bytes.begin() + static_cast<std::ptrdiff_t>(header), format().bytes.end());
  const FlightLog log = read(format(), twice);
  EXPECT_TRUE(log.restarted);
  EXPECT_EQ(log.attitudes.size(), read(format(), format().bytes).attitudes.size());
}

TEST_P(EveryLog, OtherFilesAreRefusedByName) {
  for (const char* other : {"", "hello, I am a text log of some kind", "\x89PNG\r\n\x1a\n0123456789abcdef"}) {
    LogStream stream(as_bytes(other), "other.txt");
    EXPECT_FALSE(format().is(stream));
    try {
      format().read(stream);
      FAIL();
    } catch (const UsageError& error) {
      EXPECT_EQ(error.text().where, "other.txt");
      EXPECT_NE(error.text().expected, "");
      EXPECT_NE(error.text().fix, "");
    }
  }
}

// A suite of its own for pyulog, which is not installed everywhere.
class IndependentReader : public EveryLog {};
INSTANTIATE_TEST_SUITE_P(Pymavlink, IndependentReader, ::testing::Values(0, 2));
INSTANTIATE_TEST_SUITE_P(Pyulog, IndependentReader, ::testing::Values(1));

// The same file by pymavlink's DFReader and mavlogfile, and pyulog's reader.
TEST_P(IndependentReader, FindsTheSame) {
  const auto path = folder_.write("a.log", as_text(format().bytes));
  const test::ProcessResult judged =
      test::run_process({NADIR_PYTHON, "-B", NADIR_LOG_JUDGE, format().name, path.string()});
  if (judged.code == 77) GTEST_SKIP() << "NOT TESTED: " << judged.err;
  ASSERT_EQ(judged.code, 0) << judged.err;
  const auto theirs = nlohmann::json::parse(judged.out);
  const FlightLog ours = read(format(), format().bytes);
  ASSERT_EQ(theirs["attitudes"].size(), ours.attitudes.size());
  for (std::size_t i = 0; i < ours.attitudes.size(); ++i) {
    const auto& [time_s, attitude] = ours.attitudes[i];
    ASSERT_NEAR(theirs["attitudes"][i][0].get<double>(), time_s, 1e-6);
    ASSERT_NEAR(theirs["attitudes"][i][1].get<double>(), degrees(attitude.roll_rad), 1e-4);
    ASSERT_NEAR(theirs["attitudes"][i][2].get<double>(), degrees(attitude.pitch_rad), 1e-4);
    ASSERT_NEAR(wrap_pi(radians(theirs["attitudes"][i][3].get<double>()) - attitude.heading_rad), 0, 1e-6);
  }
  ASSERT_EQ(theirs["heights"].size(), ours.home_heights.size());
  for (std::size_t i = 0; i < ours.home_heights.size(); ++i) {
    ASSERT_NEAR(theirs["heights"][i][1].get<double>(), ours.home_heights[i].height_m, 1e-5);
  }
  ASSERT_EQ(theirs["positions"].size(), ours.positions.size());
  for (std::size_t i = 0; i < ours.positions.size(); ++i) {
    ASSERT_NEAR(theirs["positions"][i][1].get<double>(), ours.positions[i].place.lat_deg, 1e-9);
    ASSERT_NEAR(theirs["positions"][i][2].get<double>(), ours.positions[i].place.lon_deg, 1e-9);
  }
  EXPECT_EQ(theirs["triggers"], ours.triggers.size());
}

// Logs that people flew, of any kind: NADIR_LOGS=FOLDER. None are kept here: they are other people's.
TEST(RealLogs, AreReadAsByTheirOwnTools) {
  const char* folder = std::getenv("NADIR_LOGS");
  if (folder == nullptr) GTEST_SKIP() << "NOT TESTED: no real logs; NADIR_LOGS=FOLDER names some";
  std::size_t judged_logs = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const auto format = [&]() -> const Format* {
      for (int i = 0; i < 3; ++i) {
        LogStream stream{InputFile(entry.path())};
        if (format_of(i).is(stream)) return &format_of(i);
      }
      return nullptr;
    }();
    if (format == nullptr) continue;
    SCOPED_TRACE(entry.path());
    const test::ProcessResult judged =
        test::run_process({NADIR_PYTHON, "-B", NADIR_LOG_JUDGE, format->name, entry.path().string()});
    if (judged.code == 77) continue;
    ASSERT_EQ(judged.code, 0) << judged.err;
    ++judged_logs;
    const auto theirs = nlohmann::json::parse(judged.out);
    LogStream stream{InputFile(entry.path())};
    const FlightLog ours = format->read(stream);
    // A reader that keeps the order of time may drop what steps back; nothing is made up.
    std::map<long long, nlohmann::json> by_time_us;
    for (const auto& row : theirs["attitudes"]) by_time_us[std::llround(row[0].get<double>() * 1e6)] = row;
    std::size_t unknown = 0;
    double worst_deg = 0;
    for (const auto& [time_s, attitude] : ours.attitudes) {
      const auto found = by_time_us.find(std::llround(time_s * 1e6));
      unknown += found == by_time_us.end();
      if (found == by_time_us.end()) continue;
      worst_deg =
          std::max({worst_deg, degrees(std::abs(wrap_pi(radians(found->second[1].get<double>()) - attitude.roll_rad))),
                    std::abs(found->second[2].get<double>() - degrees(attitude.pitch_rad)),
                    degrees(std::abs(wrap_pi(radians(found->second[3].get<double>()) - attitude.heading_rad)))});
    }
    EXPECT_GT(ours.attitudes.size(), 100U);
    EXPECT_EQ(unknown, 0U);
    EXPECT_GE(static_cast<double>(ours.attitudes.size()), 0.99 * static_cast<double>(by_time_us.size()));
    EXPECT_LT(worst_deg, 0.2);  // PX4's quaternions and pyulog's angles are rounded differently
    // Of fixes that arrived together a telemetry log keeps one; a position is one of theirs.
    std::set<std::pair<long long, long long>> places;
    const auto key = [](double lat_deg, double lon_deg) {
      return std::pair(std::llround(lat_deg * 1e7), std::llround(lon_deg * 1e7));
    };
    for (const auto& row : theirs["positions"]) places.insert(key(row[1].get<double>(), row[2].get<double>()));
    for (const TimedPosition& one : ours.positions) {
      ASSERT_TRUE(places.contains(key(one.place.lat_deg, one.place.lon_deg)));
    }
    EXPECT_GE(ours.positions.size(), theirs["positions"].size() * 7 / 10);
    fmt::print("{}: {}, {} attitudes (theirs {}), worst {:.4f} deg; {} positions ({}), {} heights ({}), {} triggers\n",
               entry.path().filename().string(), ours.format, ours.attitudes.size(), theirs["attitudes"].size(),
               worst_deg, ours.positions.size(), theirs["positions"].size(), ours.home_heights.size(),
               theirs["heights"].size(), ours.triggers.size());
  }
  EXPECT_GT(judged_logs, 0U) << "no log in " << folder;
}

TEST(DataflashLog, WrongOrderJumpsAndNotANumber) {
  test::DataflashWriter log;
  log.format(10, "ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw");
  log.format(12, "POS", "Qf", "TimeUS,RelHomeAlt");
  const auto attitude = [&](double time_s, float yaw) {
    log.record(10, Packed().put(static_cast<std::uint64_t>(time_s * 1e6)).put(1.0F).put(2.0F).put(yaw));
  };
  attitude(10, 100);
  attitude(9.5, 1);  // out of order: dropped
  attitude(10.5, 110);
  attitude(1e7, 2);    // a damaged time
  attitude(0.001, 3);  // likewise
  attitude(11, std::numeric_limits<float>::quiet_NaN());
  attitude(11.5, std::numeric_limits<float>::infinity());
  attitude(12, 120);
  log.record(12, Packed().put(std::uint64_t{12'000'000}).put(-1e30F));
  const FlightLog read_log = read(format_of(0), log.bytes);
  ASSERT_EQ(read_log.attitudes.size(), 3U);
  EXPECT_NEAR(degrees(read_log.attitudes[1].aircraft.heading_rad), 110, 1e-4);
  EXPECT_EQ(read_log.wrong_times, 2U);
  EXPECT_FALSE(read_log.restarted);
  EXPECT_TRUE(read_log.home_heights.empty());
}

TEST(DataflashLog, FormatsThatContradictThemselves) {
  test::DataflashWriter log;
  log.format(10, "ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw");
  // A format whose length is not that of its fields, one that is shorter than a head, one of an unknown type.
  Bytes wrong(86, 0);
  wrong[0] = 20;
  wrong[1] = 60;
  wrong[6] = 'Q';
  log.record(128, wrong);
  wrong[0] = 21;
  wrong[1] = 1;
  log.record(128, wrong);
  wrong[0] = 22;
  wrong[6] = '?';
  log.record(128, wrong);
  log.record(20, Bytes(57));  // can be skipped by its length
  log.record(21, Bytes(4));   // cannot
  log.record(10, Packed().put(std::uint64_t{5'000'000}).put(1.0F).put(2.0F).put(3.0F));
  const FlightLog read_log = read(format_of(0), log.bytes);
  EXPECT_EQ(read_log.attitudes.size(), 1U);
  EXPECT_GE(read_log.damaged, 3U);
}

TEST(DataflashLog, OldLogsAndRangeFinders) {
  test::DataflashWriter log;
  log.format(10, "ATT", "IcccC", "TimeMS,Roll,Pitch,X,Yaw");
  log.format(11, "RFND", "QCBB", "TimeUS,Dist,Stat,Orient");
  log.format(12, "TRIG", "QI", "TimeUS,GPSTime");
  log.format(13, "BARO", "Qf", "TimeUS,Alt");
  log.record(10, Packed()
                     .put(std::uint32_t{5000})
                     .put(std::int16_t{100})
                     .put(std::int16_t{-200})
                     .put(std::int16_t{0})
                     .put(std::uint16_t{27000}));
  const auto range = [&](double time_s, int centimetres, int status, int orientation) {
    log.record(11, Packed()
                       .put(static_cast<std::uint64_t>(time_s * 1e6))
                       .put(static_cast<std::uint16_t>(centimetres))
                       .put(static_cast<std::uint8_t>(status))
                       .put(static_cast<std::uint8_t>(orientation)));
  };
  range(5.1, 4000, 4, 25);
  range(5.2, 100, 2, 25);  // out of its range
  range(5.3, 900, 4, 0);   // looks ahead
  log.record(12, Packed().put(std::uint64_t{5'400'000}).put(std::uint32_t{1}));
  log.record(13, Packed().put(std::uint64_t{5'500'000}).put(42.5F));
  const FlightLog read_log = read(format_of(0), log.bytes);
  ASSERT_EQ(read_log.attitudes.size(), 1U);
  EXPECT_DOUBLE_EQ(read_log.attitudes[0].time_s, 5);
  EXPECT_NEAR(degrees(read_log.attitudes[0].aircraft.heading_rad), -90, 1e-9);
  EXPECT_NEAR(degrees(read_log.attitudes[0].aircraft.pitch_rad), -2, 1e-9);
  ASSERT_EQ(read_log.ranges.size(), 1U);
  EXPECT_NEAR(read_log.ranges[0].height_m, 40, 1e-9);
  ASSERT_EQ(read_log.triggers.size(), 1U);      // CAM is missing
  ASSERT_EQ(read_log.home_heights.size(), 1U);  // POS is missing
  EXPECT_FLOAT_EQ(static_cast<float>(read_log.home_heights[0].height_m), 42.5F);
}

// Firmware before 3.3: TimeMS of a GPS record is that of the GPS week, T that of the log.
TEST(DataflashLog, GpsOfOldFirmware) {
  test::DataflashWriter log;
  log.format(10, "ATT", "IcccC", "TimeMS,Roll,Pitch,X,Yaw");
  log.format(14, "GPS", "BIHLLeI", "Status,TimeMS,Week,Lat,Lng,Alt,T");
  const auto attitude = [&](std::uint32_t ms) {
    log.record(
        10, Packed().put(ms).put(std::int16_t{100}).put(std::int16_t{0}).put(std::int16_t{0}).put(std::uint16_t{9000}));
  };
  for (std::uint32_t ms = 45000; ms < 46000; ms += 100) {
    attitude(ms);
    log.record(14, Packed()
                       .put(std::uint8_t{3})
                       .put(std::uint32_t{603'837'400 + ms})
                       .put(std::uint16_t{1871})
                       .put(std::int32_t{-353623714})
                       .put(std::int32_t{1491658533})
                       .put(std::int32_t{59008})
                       .put(ms + 50));
  }
  const FlightLog read_log = read(format_of(0), log.bytes);
  EXPECT_EQ(read_log.attitudes.size(), 10U);
  ASSERT_EQ(read_log.positions.size(), 10U);
  EXPECT_DOUBLE_EQ(read_log.positions[0].time_s, 45.05);
  EXPECT_NEAR(read_log.positions[0].place.lat_deg, -35.3623714, 1e-9);
  ASSERT_TRUE(read_log.unix_from_log_s);
  // 2015-11-21 23:44:25 UTC: GPS week 1871, 603 882.4 s, 17 leap seconds.
  EXPECT_NEAR(*read_log.unix_from_log_s + 45.05, 315'964'800 + 1871 * 604'800.0 + 603'882.4 - 17, 1e-3);
  EXPECT_EQ(read_log.wrong_times, 0U);
}

TEST(Px4Log, HostileFormatsAreIgnored) {
  test::UlogWriter log;
  log.format("a:b[60000] x;");
  log.format("b:c[60000] x;");
  log.format("c:d[60000] x;");
  log.format("d:");  // contains nothing, thousands of millions of times
  log.format("vehicle_attitude:uint64_t timestamp;a x;");
  log.format("vehicle_local_position:vehicle_local_position x;uint64_t timestamp;");
  log.format("vehicle_gps_position:uint64_t timestamp;float[2147483648] q;");
  log.format("distance_sensor:uint64_t timestamp;float[-1] q;float[ q;nonsense;;");
  std::uint16_t id = 0;
  for (const char* topic : {"vehicle_attitude", "vehicle_local_position", "vehicle_gps_position", "distance_sensor"}) {
    log.subscribe(id, topic);
    log.data(id++, Packed().put(std::uint64_t{5'000'000}).put(1.0F));
  }
  log.subscribe(9, "vehicle_global_position");  // no format
  log.data(9, Bytes(100));
  log.data(77, Bytes(100));  // no subscription
  const FlightLog read_log = read(format_of(1), log.bytes);
  EXPECT_TRUE(read_log.empty());
  EXPECT_EQ(read_log.damaged, 0U);
}

TEST(Px4Log, ShortDataLackWhatIsCutOff) {
  test::UlogWriter log;
  log.format("vehicle_local_position:uint64_t timestamp;float z;float dist_bottom;bool dist_bottom_valid;");
  log.subscribe(0, "vehicle_local_position");
  log.data(0, Packed().put(std::uint64_t{1'000'000}).put(-50.0F));
  log.data(0, Packed().put(std::uint64_t{2'000'000}));
  log.data(0, Bytes(3));
  const FlightLog read_log = read(format_of(1), log.bytes);
  ASSERT_EQ(read_log.home_heights.size(), 1U);
  EXPECT_TRUE(read_log.terrain_heights.empty());
}

TEST(Px4Log, LaterVersionsAreNamed) {
  test::UlogWriter log(false);
  Bytes flags(40);
  flags[8] = 2;
  log.message('B', flags);
  EXPECT_THROW(read(format_of(1), log.bytes), UsageError);
}

TEST(Px4Log, AppendedDataAreRead) {
  test::UlogWriter log(false);
  Bytes flags(40);
  flags[8] = 1;
  log.message('B', flags);
  log.format("vehicle_local_position:uint64_t timestamp;float z;");
  log.subscribe(0, "vehicle_local_position");
  log.data(0, Packed().put(std::uint64_t{1'000'000}).put(-50.0F));
  // A crash within a message; what follows was appended.
  log.bytes.insert(log.bytes.end(), {200, 0, 'D', 0, 0, 1, 2, 3});
  const std::uint64_t appended = log.bytes.size();
  log.data(0, Packed().put(std::uint64_t{2'000'000}).put(-60.0F));
  for (std::size_t i = 0; i < 8; ++i) log.bytes[16 + 3 + 16 + i] = static_cast<std::uint8_t>(appended >> (8 * i));
  const FlightLog read_log = read(format_of(1), log.bytes);
  ASSERT_EQ(read_log.home_heights.size(), 2U);
  EXPECT_EQ(read_log.damaged, 0U);
}

TEST(MavlinkLog, OfSeveralAutopilotsTheFirstCounts) {
  Bytes joined = format_of(2).bytes;
  const test::TemporaryFolder folder;
  const auto input = folder.write("m.json", R"({"at": 1782000221, "system": 9, "message": "HEARTBEAT", "autopilot": 3}
{"at": 1782000222, "system": 9, "message": "ATTITUDE", "time_boot_ms": 221000, "yaw": 1}
)");
  ASSERT_EQ(test::run_shell(fmt::format("'{}' -B '{}' write-tlog '{}' < '{}'", NADIR_PYTHON, NADIR_LOG_JUDGE,
                                        (folder / "b.tlog").string(), input.string()))
                .code,
            0);
  const Bytes more = read_file(folder / "b.tlog");
  joined.insert(joined.end(), more.begin(), more.end());
  const FlightLog log = read(format_of(2), joined);
  EXPECT_EQ(log.vehicles, 2U);
  EXPECT_EQ(log.attitudes.size(), read(format_of(2), format_of(2).bytes).attitudes.size());
}

TEST(MavlinkLog, WithoutSystemTimeTheGroundStationKnowsUtc) {
  const test::TemporaryFolder folder;
  std::string lines = R"({"at": 1782000100.5, "message": "HEARTBEAT", "autopilot": 3})";
  for (int i = 0; i < 40; ++i) {
    lines += fmt::format("\n{{\"at\": {}, \"message\": \"ATTITUDE\", \"time_boot_ms\": {}, \"yaw\": 1}}",
                         1782000100.7 + i + 0.05 * (i % 3), 100'000 + 1000 * i);
  }
  const auto input = folder.write("m.json", lines + "\n");
  ASSERT_EQ(test::run_shell(fmt::format("'{}' -B '{}' write-tlog '{}' < '{}'", NADIR_PYTHON, NADIR_LOG_JUDGE,
                                        (folder / "b.tlog").string(), input.string()))
                .code,
            0);
  const FlightLog log = read(format_of(2), read_file(folder / "b.tlog"));
  EXPECT_EQ(log.utc_from, "ground station");
  EXPECT_NEAR(*log.unix_from_log_s, 1'782'000'000.7, 0.01);
}

}  // namespace
}  // namespace nadir
