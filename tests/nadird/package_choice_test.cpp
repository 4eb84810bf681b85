// Accepting and resuming: before take-off everything is asked of a package; what was accepted for a flight is opened
// again by its digest, whatever the clock says. Real packages, a real state directory, a clock that is set.
#include "package_choice.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <functional>

#include "base/files.hpp"
#include "nadird_fixture.hpp"
#include "service/saved_flight.hpp"
#include "trust/signatures.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kHour_s = 3600, kYear_s = 365 * 86'400;

class Boarding : public test::NadirdFixture {
 protected:
  Boarding() {
    fs::create_directory(folder_ / "frames");
    fs::create_directory(folder_ / "packages");
    folder_.write("airframe.json", airframe_json());
    make_package("packages/a", 3);
    make_package("packages/b", 4);
    want("a");
  }
  // The link `current` points to that package.
  void want(const std::string& name) {
    fs::remove(folder_ / "packages/current");
    fs::create_directory_symlink(name, folder_ / "packages/current");
  }
  // Starts the service, which ends at once. offset_s: of the clock.
  void start(std::int64_t offset_s, const std::string& boot, std::initializer_list<std::string> more = {}) {
    const FixedClock clock(UtcTime{test::kJudged.unix_s + offset_s});
    const test::BriefFlight flight(boot);
    const auto options = service_options(path("packages/current"), "airframe.json", "frames");
    EXPECT_EQ(run_service(options, more, clock, &flight), 0) << err_.str();
  }
  bool said(const std::string& text) const { return err_.str().find(text) != std::string::npos; }
  bool flew() const { return !said("REJECTED"); }
  bool resumed() const { return flew() && said("resumed as accepted at"); }

  AcceptanceRecord record() const {
    const AcceptanceReading reading = StateDirectory(folder_ / "state").load_acceptance();
    EXPECT_TRUE(reading.record) << reading.rejection;
    return reading.record.value_or(AcceptanceRecord{});
  }
  void edit_record(const std::function<void(AcceptanceRecord&)>& edit) {
    AcceptanceRecord edited = record();
    edit(edited);
    StateDirectory(folder_ / "state").save(edited);
  }
  void take_off() {
    edit_record([](AcceptanceRecord& record) { record.airborne = true; });
  }
  void land() {
    edit_record([](AcceptanceRecord& record) {
      record.airborne = false;
      record.boot_id.clear();
    });
  }
  void damage(const std::string& file) {  // a byte of it
    std::fstream stream(folder_ / file, std::ios::in | std::ios::out | std::ios::binary);
    stream.seekp(static_cast<std::streamoff>(fs::file_size(folder_ / file) / 2));
    stream.put('\x7f');
  }
};

TEST_F(Boarding, AWrongClockAfterARebootInFlightDoesNotCostThePackage) {
  start(0, "boot-1");
  EXPECT_FALSE(resumed()) << "accepted";
  ASSERT_TRUE(flew()) << err_.str();
  take_off();
  for (const std::int64_t wrong_s : {-10L, -600L, -2 * kHour_s, 2 * kYear_s, -test::kJudged.unix_s}) {
    start(wrong_s, "boot-2");
    EXPECT_TRUE(resumed()) << wrong_s << '\n' << err_.str();
  }
  EXPECT_TRUE(record().airborne) << "it has not landed";
  EXPECT_EQ(record().current.accepted_at, test::kJudged);
}

TEST_F(Boarding, APackageThatExpiresInFlightIsFlownOn) {
  start(0, "boot-1");
  take_off();
  start(kYear_s, "boot-1");
  EXPECT_TRUE(resumed()) << err_.str();
  land();
  start(kYear_s, "boot-1");
  EXPECT_FALSE(flew());
  EXPECT_TRUE(said("package.expired")) << err_.str();
}

TEST_F(Boarding, WithinABootARestartOnTheGroundResumes) {
  start(0, "boot-1");
  start(-2 * kHour_s, "boot-1");
  EXPECT_TRUE(resumed()) << err_.str();
}

TEST_F(Boarding, OnTheGroundAfterARebootTheClockIsChecked) {
  start(0, "boot-1");
  start(-2 * kHour_s, "boot-2");
  EXPECT_FALSE(flew());
  EXPECT_TRUE(said("time.untrusted")) << err_.str();
  start(2 * kYear_s, "boot-2");
  EXPECT_TRUE(said("package.expired")) << err_.str();
  for (const std::int64_t corrected_s : {-10L, -600L}) {
    start(corrected_s, "boot after " + std::to_string(corrected_s));
    EXPECT_TRUE(flew()) << "a clock that was corrected: " << err_.str();
    EXPECT_FALSE(resumed());
  }
}

TEST_F(Boarding, LandingEndsTheAcceptance) {
  start(0, "boot-1");
  take_off();
  land();
  start(-2 * kHour_s, "boot-1");
  EXPECT_FALSE(flew()) << "judged anew";
}

TEST_F(Boarding, APackageSwappedInFlightIsNotUsed) {
  start(0, "boot-1");
  take_off();
  want("b");
  start(2 * kYear_s, "boot-2");
  EXPECT_TRUE(flew()) << err_.str();
  EXPECT_TRUE(said("does not hold the package that was accepted for this flight")) << err_.str();
  EXPECT_EQ(record().current.sequence, 3);
  fs::rename(folder_ / "packages/a", folder_ / "packages/moved");
  start(0, "boot-2");
  EXPECT_TRUE(said("packages/moved")) << "found by its digest: " << err_.str();
}

TEST_F(Boarding, OnTheGroundANewPackageIsAcceptedEvenWithinABoot) {
  start(0, "boot-1");
  want("b");
  start(0, "boot-1");
  EXPECT_FALSE(resumed());
  EXPECT_EQ(record().current.sequence, 4);
  ASSERT_TRUE(record().previous);
  EXPECT_EQ(record().previous->sequence, 3);
}

TEST_F(Boarding, WhenTheNewPackageFailsTheLastAcceptedOneComesBack) {
  start(0, "boot-1");
  want("b");
  const Bytes manifest = read_file(folder_ / "packages/b/manifest.json");
  const auto falls_back = [&](const std::string& what) {
    for (const char* boot : {"boot-1", "boot-2"}) {
      start(0, boot);
      EXPECT_TRUE(said("flying with the last accepted one")) << what << ": " << err_.str();
      EXPECT_EQ(record().current.sequence, 3) << what;
    }
  };
  damage("packages/b/manifest.json");
  falls_back("damaged manifest");
  write_file_atomic(folder_ / "packages/b/manifest.json", manifest);
  fs::resize_file(folder_ / "packages/b" / kImageryFile, 4096);
  falls_back("torn imagery");
  fs::remove(folder_ / "packages/b/manifest.sig");
  falls_back("no signature");
  fs::remove_all(folder_ / "packages/b");
  falls_back("gone");
}

// The one that comes back was judged by the clock too: an expired one stays on the ground.
TEST_F(Boarding, AfterARebootOnTheGroundTheLastOneIsCheckedAsWell) {
  start(0, "boot-1");
  want("b");
  fs::remove(folder_ / "packages/b/manifest.sig");
  start(kYear_s, "boot-2");
  EXPECT_FALSE(flew());
  EXPECT_TRUE(said("signature.missing") && said("package.expired")) << err_.str();
}

TEST_F(Boarding, WhenTheAcceptedPackageIsDamagedInFlightTheOneBeforeFlies) {
  start(0, "boot-1");
  want("b");
  start(0, "boot-1");
  take_off();
  fs::resize_file(folder_ / "packages/b" / kImageryFile, 4096);
  start(-2 * kHour_s, "boot-2");
  EXPECT_TRUE(said("flying with the one before it")) << err_.str();
  EXPECT_EQ(record().current.sequence, 4) << "it is looked for again";
}

TEST_F(Boarding, WithoutAnyPackageTheServiceRunsAndReportsWhy) {
  start(0, "boot-1");
  take_off();
  fs::remove_all(folder_ / "packages/a");
  fs::remove_all(folder_ / "packages/b");
  start(0, "boot-2");
  EXPECT_TRUE(said("package.unreadable")) << err_.str();
}

TEST_F(Boarding, ADamagedAirframeFileInFlightIsReplacedByTheAcceptedOne) {
  start(0, "boot-1");
  take_off();
  const std::string whole = read_text_file(folder_ / "airframe.json");
  for (const std::string& text : {std::string(), whole.substr(0, whole.size() / 2), whole + " "}) {
    folder_.write("airframe.json", text);
    start(0, "boot-2");
    EXPECT_TRUE(said("the accepted airframe is used")) << text << err_.str();
  }
  fs::remove(folder_ / "airframe.json");
  start(0, "boot-2");
  EXPECT_TRUE(said("the accepted airframe is used")) << err_.str();
}

TEST_F(Boarding, InFlightNeitherRootNorMemoryIsNeeded) {
  start(0, "boot-1");
  take_off();
  folder_.write("root.json", "{");
  folder_.write("state/aircraft.json", "{");
  start(0, "boot-2");
  EXPECT_TRUE(resumed()) << err_.str();
  EXPECT_EQ(read_text_file(folder_ / "state/aircraft.json"), "{");
}

TEST_F(Boarding, ATornRecordIsReportedAndThePackageCheckedAgain) {
  start(0, "boot-1");
  take_off();
  const std::string whole = read_text_file(folder_ / "state/acceptance.json");
  for (const std::size_t size : {std::size_t{0}, whole.size() / 2, whole.size() - 1}) {
    folder_.write("state/acceptance.json", whole.substr(0, size));
    start(0, "boot-2");
    EXPECT_TRUE(flew()) << err_.str();
    EXPECT_TRUE(said("cannot be resumed, acceptance.json: ")) << err_.str();
  }
}

// The imagery and the manifest cut at many lengths, in flight and on the ground: always a package, or a reason.
TEST_F(Boarding, TornFilesAtEveryLengthNeverEndTheChoice) {
  start(0, "boot-1");
  take_off();
  AcceptanceReading accepted{record(), {}};
  const PackageJudges judges{[&](const fs::path& package) {
                               NoProgress progress;
                               return open_package(package, maker_.options(), progress);
                             },
                             [](const fs::path& package, const AcceptedPackage& earlier) {
                               NoProgress progress;
                               return open_accepted_package(package, earlier.manifest, earlier.accepted_at, progress);
                             }};
  const fs::path wanted = folder_ / "packages/current";
  for (const auto& [file, step] : {std::pair<std::string, std::size_t>{"manifest.json", 1},
                                   {"manifest.sig", 1},
                                   {std::string(kMissionFile), 1},
                                   {std::string(kImageryFile), 997}}) {
    const Bytes whole = read_file(folder_ / "packages/a" / file);
    fs::rename(folder_ / "packages/b", folder_ / "b");
    for (std::size_t size = 0; size < whole.size(); size += step) {
      std::ofstream(folder_ / "packages/a" / file, std::ios::binary)
          .write(reinterpret_cast<const char*>(whole.data()), static_cast<std::streamsize>(size));
      const PackageChoice choice = choose_package(wanted, accepted, "boot-2", judges);
      if (file == "manifest.sig") {
        ASSERT_TRUE(choice.resumed) << size << ": the signature was verified before take-off";
      } else {
        ASSERT_FALSE(choice.opening.package) << file << " at " << size;
        ASSERT_TRUE(choice.opening.findings.has_errors()) << file << " at " << size;
      }
    }
    write_file_atomic(folder_ / "packages/a" / file, whole);
    fs::rename(folder_ / "b", folder_ / "packages/b");
  }
  EXPECT_TRUE(choose_package(wanted, accepted, "boot-2", judges).resumed);
}

// One start as of another time, and one by a clock that runs ahead, ground nobody.
TEST_F(Boarding, AnEvaluationAsOfAnotherTimeIsNotRemembered) {
  start(0, "boot-1", {"--at", "2024-05-20"});
  EXPECT_TRUE(flew()) << err_.str();
  EXPECT_FALSE(fs::exists(folder_ / "state/aircraft.json"));
  EXPECT_FALSE(fs::exists(folder_ / "state/acceptance.json"));
  start(0, "boot-2");
  EXPECT_TRUE(flew()) << err_.str();
}

TEST_F(Boarding, ATimePermitResetsAWrongTimeOnce) {
  start(0, "boot-1");
  land();
  AircraftState state = read_state(folder_ / "state/aircraft.json");
  const UtcTime wrong{test::kJudged.unix_s + 2 * kYear_s};
  state.last_trusted_time = wrong;
  write_state(folder_ / "state/aircraft.json", state);
  start(0, "boot-2");
  EXPECT_TRUE(said("time.untrusted") && !flew()) << err_.str();
  const SignedTimePermit permit =
      sign_time_permit({wrong, UtcTime{test::kJudged.unix_s - 60}, "mini-07", UtcTime{test::kJudged.unix_s + kYear_s}},
                       {&maker_.signer});
  folder_.write("permit.json", permit.document.json());
  folder_.write("state/signing-time", "999999\n");
  start(0, "boot-2", {"--time-permit", path("permit.json")});
  EXPECT_TRUE(flew()) << err_.str();
  EXPECT_EQ(read_state(folder_ / "state/aircraft.json").last_trusted_time, test::kJudged);
  EXPECT_FALSE(fs::exists(folder_ / "state/signing-time")) << "the link's time begins anew";
  land();
  start(-10, "boot-3", {"--time-permit", path("permit.json")});
  EXPECT_TRUE(flew()) << "not needed any more, and no obstacle: " << err_.str();
}

}  // namespace
}  // namespace nadir
