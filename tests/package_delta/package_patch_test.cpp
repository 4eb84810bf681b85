// Patches of packages: the same bytes, refused where they must be, killed anywhere.
#include "package_delta/package_patch.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "package/package_maker.hpp"
#include "package/package_roots.hpp"
#include "package/package_writer.hpp"
#include "support/process.hpp"
#include "support/small_disk.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class PackagePatch : public ::testing::Test {
 protected:
  PackagePatch() {
    maker_.make(folder_, "old");
    write_file_atomic(folder_ / "signer.pem", maker_.signer.pem(), 0600);
    newer_.signer = PrivateKey::read(folder_ / "signer.pem");
    newer_.root = maker_.root;
    newer_.mission = test::mission_yaml({{"sequence: 3", "sequence: 4"}});
    newer_.edit_tile = [number = 0](Sidecar& sidecar, Bytes& tile) mutable {
      if (number++ % 10 == 0) tile = test::noise_tile(sidecar.key.x + 7);
      return true;
    };
    newer_.make(folder_, "new");
  }

  MadePatch make(const std::string& from = "old", const std::string& to = "new") {
    return make_patch(folder_ / from, folder_ / to, {&maker_.signer}, folder_ / "patch", progress_);
  }
  AppliedPatch apply(const std::string& from = "old", const std::string& patch = "patch") {
    return apply_patch({.old_package = folder_ / from,
                        .patch = folder_ / patch,
                        .out = folder_ / "made",
                        .root = &maker_.root,
                        .at = test::kJudged},
                       progress_);
  }
  bool same(const std::string& a, const std::string& b) {
    return test::run_process({"diff", "-r", folder_ / a, folder_ / b}).code == 0;
  }
  void expect_nothing_made() {
    EXPECT_FALSE(fs::exists(folder_ / "made"));
    EXPECT_FALSE(fs::exists(folder_ / ".made.staging"));
  }
  void expect_error(const char* text, const std::string& from = "old") {
    try {
      apply(from);
      ADD_FAILURE() << "applied";
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr(text));
    }
    expect_nothing_made();
  }
  Bytes patch() { return read_file(folder_ / "patch"); }
  void write_patch(ByteView bytes) { write_file_atomic(folder_ / "patch", bytes); }

  test::TemporaryFolder folder_;
  test::PackageMaker maker_, newer_;
  NoProgress progress_;
};

TEST_F(PackagePatch, MakesTheVeryBytesOfTheNewPackage) {
  TrustRoot next = maker_.root;  // of no artifact, and in the package all the same
  next.version = 2;
  add_package_roots(folder_ / "new", {{2, sign_root(next, {&maker_.signer}).json()}});
  const MadePatch made = make();
  EXPECT_TRUE(made.findings.empty());
  EXPECT_EQ(made.bytes, fs::file_size(folder_ / "patch"));
  EXPECT_LT(made.bytes, made.package_bytes / 4);
  EXPECT_EQ(made.header.from.sequence, 3);
  EXPECT_EQ(made.header.to.sequence, 4);
  const AppliedPatch applied = apply();
  EXPECT_TRUE(applied.findings.empty()) << test::codes(applied.findings);
  EXPECT_TRUE(same("made", "new"));
  EXPECT_TRUE(maker_.verify(folder_ / "made", VerifyDepth::full).accepted());
  EXPECT_EQ(applied.header.to.sequence, 4);
}

TEST_F(PackagePatch, IsTheSameBytesEachTime) {
  make();
  const Bytes first = patch();
  make();
  EXPECT_EQ(patch(), first);
}

TEST_F(PackagePatch, AnotherContainerIsSentWhole) {
  newer_.cog = true;
  newer_.make(folder_, "cog");
  make("old", "cog");
  EXPECT_TRUE(apply().findings.empty());
  EXPECT_TRUE(same("made", "cog"));
}

TEST_F(PackagePatch, IsForOnePackageOnly) {
  make();
  maker_.mission = test::mission_yaml({{"sequence: 3", "sequence: 2"}});
  maker_.make(folder_, "older");
  expect_error("the patch is for another package", "older");
  EXPECT_THROW(make("old", "old"), UsageError);
  EXPECT_THROW(make("nowhere", "new"), UsageError);
  write_file_atomic(folder_ / "made", "x");
  EXPECT_THROW(apply(), Error);
  EXPECT_EQ(read_text_file(folder_ / "made"), "x");
}

TEST_F(PackagePatch, NothingUnsignedOrSignedByOthersIsApplied) {
  const PrivateKey other_key = PrivateKey::generate();
  EXPECT_THROW(make_patch(folder_ / "old", folder_ / "new", {}, folder_ / "patch", progress_), Error);
  make_patch(folder_ / "old", folder_ / "new", {&other_key}, folder_ / "patch", progress_);
  EXPECT_TRUE(apply().findings.contains("key.unknown"));
  make();
  maker_.root.package_signer.threshold = 2;
  EXPECT_TRUE(apply().findings.has_errors());
  expect_nothing_made();
}

// The patch's signer may sign; the package inside is judged by itself.
TEST_F(PackagePatch, ThePackageInsideIsVerified) {
  newer_.mission = test::mission_yaml({{"sequence: 3", "sequence: 4"}, {"2024-06-01", "2024-04-22"}});
  newer_.make(folder_, "expired");
  make("old", "expired");
  EXPECT_TRUE(apply().findings.contains("package.expired")) << test::codes(apply().findings);
  expect_nothing_made();
}

TEST_F(PackagePatch, ANewPackageThatIsNotWhatItsManifestSaysGetsNoPatch) {
  write_file_atomic(folder_ / "new" / kMissionFile, "schema: another");
  EXPECT_TRUE(make().findings.has_errors());
  EXPECT_FALSE(fs::exists(folder_ / "patch"));
}

TEST_F(PackagePatch, EveryDamageIsAnError) {
  make();
  const Bytes good = patch();
  for (std::size_t at = 0; at < good.size(); at += 1 + good.size() / 400) {
    Bytes bad = good;
    bad[at] ^= static_cast<std::uint8_t>(1U << (at % 8));
    write_patch(bad);
    try {
      EXPECT_TRUE(apply().findings.has_errors()) << at;
    } catch (const Error&) {
    }
    expect_nothing_made();
  }
  for (const std::size_t size : {std::size_t{0}, std::size_t{5}, std::size_t{12}, std::size_t{300}, good.size() - 1}) {
    write_patch(ByteView(good).first(size));
    EXPECT_THROW(apply(), Error) << size;
  }
  Bytes more = good;
  more.push_back(0);
  write_patch(more);
  expect_error("the patch is damaged");
  write_patch(good);
  EXPECT_TRUE(apply().findings.empty()) << "the old package is whole";
}

TEST_F(PackagePatch, ADamagedOldPackageIsNamed) {
  make();
  const fs::path imagery = folder_ / "old" / kImageryFile;
  Bytes bytes = read_file(imagery);
  for (std::size_t at = 5000; at < bytes.size(); at += 512) bytes[at] ^= 1;
  write_file_atomic(imagery, bytes);
  expect_error("the old package is damaged");
  fs::remove(imagery);
  expect_error("base.mbtiles");
}

TEST_F(PackagePatch, HeadersAreStrict) {
  make();
  const SignedPatch read = read_patch(InputFile(folder_ / "patch"));
  const nlohmann::json good = nlohmann::json::parse(read.document.json());
  const auto refused = [&](const std::function<void(nlohmann::json&)>& edit) {
    nlohmann::json bad = good;
    edit(bad["signed"]);
    EXPECT_THROW(parse_patch(as_bytes(bad.dump()), "patch"), Error) << bad["signed"].dump().substr(0, 300);
  };
  EXPECT_NO_THROW(parse_patch(as_bytes(good.dump()), "patch"));
  refused([](auto& header) { header["schema"] = "nadir.package-patch/2"; });
  refused([](auto& header) { header["more"] = 1; });
  refused([](auto& header) { header["files"] = nlohmann::json::array(); });
  refused([](auto& header) { header["files"].push_back(header["files"][0]); });
  refused([](auto& header) { header["files"][0]["path"] = "../outside"; });
  refused([](auto& header) { header["files"][0]["path"] = "/etc/passwd"; });
  refused([](auto& header) { header["files"][0]["size"] = -1; });
  refused([](auto& header) { header["files"][0].erase("body"); });
  refused([](auto& header) { header["from"].erase("manifest_sha256"); });
}

TEST_F(PackagePatch, ALinkInThePackageIsRefused) {
  fs::create_symlink("/etc/hostname", folder_ / "new/link");
  EXPECT_TRUE(make().findings.has_errors());
  fs::remove(folder_ / "new/link");
  make();
  fs::remove(folder_ / "old" / kMissionFile);
  fs::create_symlink("/etc/hostname", folder_ / "old" / kMissionFile);
  EXPECT_THROW(apply(), Error);
  expect_nothing_made();
}

TEST_F(PackagePatch, KilledAnywhereItLeavesTheOldPackageAndTheNextRunWorks) {
  make();
  write_file_atomic(folder_ / "root.json", sign_root(maker_.root, {&maker_.signer}).json());
  fs::copy(folder_ / "old", folder_ / "before", fs::copy_options::recursive);
  const auto run = [&](int event) {
    return test::run_process({NADIR_KILLED_PATCH, folder_ / "old", folder_ / "patch", folder_ / "root.json",
                              folder_ / "made", std::to_string(event)});
  };
  const auto whole = run(0);
  ASSERT_EQ(whole.code, 0) << whole.err;
  EXPECT_TRUE(same("made", "new"));
  const int events = std::stoi(whole.out);
  ASSERT_GE(events, 4);
  for (int event = 1; event <= events; ++event) {
    fs::remove_all(folder_ / "made");
    ASSERT_EQ(run(event).code, 128 + SIGKILL) << event;
    EXPECT_FALSE(fs::exists(folder_ / "made")) << event;
    EXPECT_TRUE(same("old", "before")) << event;
  }
  ASSERT_EQ(run(0).code, 0);
  EXPECT_TRUE(same("made", "new"));
}

TEST_F(PackagePatch, AFullDiskLeavesNothing) {
  make();
  const test::SmallDisk disk(folder_ / "disk", "size=100k");
  if (!disk.mounted()) GTEST_SKIP() << "NOT TESTED: a small disk needs root";
  EXPECT_THROW(apply_patch({.old_package = folder_ / "old",
                            .patch = folder_ / "patch",
                            .out = folder_ / "disk/made",
                            .root = &maker_.root,
                            .at = test::kJudged},
                           progress_),
               OutOfSpace);
  EXPECT_TRUE(fs::is_empty(folder_ / "disk"));
  write_file_atomic(folder_ / "disk/filler", Bytes(90'000));
  EXPECT_THROW(make_patch(folder_ / "old", folder_ / "new", {&maker_.signer}, folder_ / "disk/patch", progress_),
               OutOfSpace);
  EXPECT_FALSE(fs::exists(folder_ / "disk/patch"));
}

}  // namespace
}  // namespace nadir
