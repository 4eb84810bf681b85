// keys revoke, sign and permit-rollback, cache sign and verify: a fleet's trust from its first root to a lost key, as
// people do it.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "commands/command_fixture.hpp"
#include "package/package_maker.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

class TrustCommands : public test::CommandTest {
 protected:
  void keys(std::initializer_list<const char*> names) {
    for (const char* name : names) ASSERT_EQ(run({"keys", "create", "--out", path(name)}), 0) << err_.str();
  }
  std::string first_code() const { return result()["findings"][0]["code"]; }
  void first_root() {
    keys({"r", "p"});
    ASSERT_EQ(run({"keys", "root", "--root-key", "@r.key.pem", "--package-signer", "@p.pub.pem", "--expires",
                   "2030-01-01", "--out", "@root.json"}),
              0)
        << err_.str();
  }
};

TEST_F(TrustCommands, ThePublicKeyOfAPrivateOne) {
  ASSERT_EQ(run({"keys", "create", "--out", "@pair"}), 0);
  const std::string expected = read_text_file(path("pair.pub.pem"));
  EXPECT_EQ(run({"keys", "public", "@pair.key.pem"}), 0);
  EXPECT_EQ(out_.str(), expected);
  EXPECT_EQ(run({"keys", "public", "@pair.key.pem", "--out", "@again.pem"}), 0);
  EXPECT_EQ(read_text_file(path("again.pem")), expected);
  EXPECT_EQ(run({"keys", "public", "@pair.key.pem", "--out", "@again.pem"}), 2) << "never overwritten";
  EXPECT_EQ(run({"keys", "public", "@pair.pub.pem"}), 2);
  EXPECT_EQ(run({"keys", "public", "pkcs11:token=no such token;object=x"}), 2);
  EXPECT_NE(err_.str().find("token"), std::string::npos) << err_.str();
  test::PackageMaker().make(folder_);
  EXPECT_EQ(run({"cache", "sign", "@package", "--key", "pkcs11:object=x?pin-value=1234"}), 2);
  EXPECT_EQ(err_.str().find("1234"), std::string::npos) << err_.str();
}

TEST_F(TrustCommands, APublicKeyPassedAsPrivateKeyIsNamed) {
  keys({"p"});
  const std::string package = test::PackageMaker().make(folder_).string();
  EXPECT_EQ(run({"cache", "sign", package, "--key", "@p.pub.pem"}), 2);
  EXPECT_NE(err_.str().find("this is a public key"), std::string::npos) << err_.str();
  EXPECT_EQ(err_.str().find("chmod"), std::string::npos) << err_.str();
}

TEST_F(TrustCommands, ARevokedKeyIsRejectedByTheFleet) {
  first_root();
  keys({"p2"});
  const std::string package = test::PackageMaker().make(folder_).string();
  fs::remove(fs::path(package) / "manifest.sig");
  ASSERT_EQ(run({"cache", "sign", package, "--key", "@p.key.pem"}), 0) << err_.str();
  EXPECT_EQ(run({"cache", "verify", package, "--trust", "@root.json", "--depth", "full"}), 0) << out_.str();

  const std::vector<std::string> revoke{"keys",     "revoke",     "--previous", "@root.json",
                                        "--revoke", "@p.pub.pem", "--root-key", "@r.key.pem",
                                        "--out",    "@2.json",    "--json"};
  EXPECT_EQ(run(revoke), 2) << "the role would be empty";
  EXPECT_NE(err_.str().find("--new-package-signer"), std::string::npos) << err_.str();
  auto with = [&](std::initializer_list<std::string> more) {
    std::vector<std::string> args = revoke;
    args.insert(args.end(), more);
    return run(args);
  };
  EXPECT_EQ(with({"--new-package-signer", "@p.pub.pem"}), 2) << "a revoked key cannot come back";
  EXPECT_FALSE(fs::exists(folder_ / "2.json"));
  ASSERT_EQ(with({"--new-package-signer", "@p2.pub.pem"}), 0) << err_.str();
  EXPECT_EQ(result()["version"], 2);
  EXPECT_EQ(result()["revoked"].size(), 1U);
  EXPECT_EQ(run(revoke), 2) << "never overwritten";

  ASSERT_EQ(run({"cache", "sign", package, "--key", "@p2.key.pem", "--only", "--carry-root", "@2.json"}), 0)
      << err_.str();
  const std::vector<std::string> verify{"cache",      "verify",  package,   "--trust",
                                        "@root.json", "--state", "@s.json", "--json"};
  ASSERT_EQ(run(verify), 0) << out_.str();
  EXPECT_EQ(result()["root_version"], 2);
  ASSERT_EQ(run({"cache", "sign", package, "--key", "@p.key.pem", "--only"}), 0);
  EXPECT_EQ(run(verify), 1);
  EXPECT_EQ(first_code(), "key.revoked");
}

TEST_F(TrustCommands, RevokingNeedsTheRootKeysOfBothSides) {
  first_root();
  keys({"r2", "untrusted"});
  const auto revoke = [&](std::initializer_list<std::string> more) {
    std::vector<std::string> args{"keys", "revoke", "--previous", "@root.json", "--out", "@2.json"};
    args.insert(args.end(), more);
    return run(args);
  };
  EXPECT_EQ(revoke({"--revoke", "@r.pub.pem", "--root-key", "@r.key.pem"}), 2) << "no root key would be left";
  EXPECT_EQ(revoke({"--revoke", "@untrusted.pub.pem", "--root-key", "@r.key.pem"}), 2) << "unknown key";
  EXPECT_EQ(
      revoke({"--revoke", "@p.pub.pem", "--new-package-signer", "@r2.pub.pem", "--root-key", "@untrusted.key.pem"}), 2)
      << "no root key";
  EXPECT_EQ(revoke({"--revoke", "@r.pub.pem", "--new-root-key", "@r2.key.pem", "--root-key", "@r.key.pem"}), 0)
      << err_.str();
}

// The role must not vanish with its last key: unsigned airframes would be accepted again.
TEST_F(TrustCommands, AnAirframeSignerIsRevokedOnlyWithAReplacement) {
  keys({"r", "p", "hangar", "hangar2"});
  ASSERT_EQ(run({"keys", "root", "--root-key", "@r.key.pem", "--package-signer", "@p.pub.pem", "--airframe-signer",
                 "@hangar.pub.pem", "--expires", "2030-01-01", "--out", "@root.json"}),
            0)
      << err_.str();
  std::vector<std::string> revoke{"keys",       "revoke",     "--previous", "@root.json", "--revoke", "@hangar.pub.pem",
                                  "--root-key", "@r.key.pem", "--out",      "@2.json"};
  EXPECT_EQ(run(revoke), 2);
  EXPECT_NE(err_.str().find("--new-airframe-signer"), std::string::npos) << err_.str();
  revoke.insert(revoke.end(), {"--new-airframe-signer", "@hangar2.pub.pem"});
  ASSERT_EQ(run(revoke), 0) << err_.str();
  const TrustRoot root = read_trusted_root(folder_ / "2.json");
  ASSERT_TRUE(root.airframe_signer);
  EXPECT_EQ(root.airframe_signer->key_ids.size(), 1U);
}

// The old planner must not vanish because nobody thought of him.
TEST_F(TrustCommands, SignersThatTheNextRootLeavesOutAreListedOrKept) {
  keys({"r", "old", "new", "hangar", "tiles"});
  ASSERT_EQ(run({"keys", "root", "--root-key", "@r.key.pem", "--package-signer", "@old.pub.pem", "--airframe-signer",
                 "@hangar.pub.pem", "--tile-signer", "mini-07=" + (folder_ / "tiles.pub.pem").string(), "--expires",
                 "2030-01-01", "--out", "@root.json"}),
            0)
      << err_.str();
  const std::vector<std::string> next{"keys",         "root",      "--root-key", "@r.key.pem", "--package-signer",
                                      "@new.pub.pem", "--expires", "2032-01-01", "--previous", "@root.json",
                                      "--json"};
  std::vector<std::string> only_new = next;
  only_new.insert(only_new.end(), {"--out", "@only-new.json"});
  ASSERT_EQ(run(only_new), 0) << err_.str();
  const std::string old_id = PublicKey::read(folder_ / "old.pub.pem").id();
  EXPECT_EQ(result()["removed"]["package signer"], nlohmann::json::array({old_id}));
  EXPECT_EQ(result()["removed"].size(), 3U) << result()["removed"];
  EXPECT_NE(err_.str().find("warning: package signer " + old_id), std::string::npos) << err_.str();
  EXPECT_NE(err_.str().find("tile signer of mini-07"), std::string::npos) << err_.str();
  EXPECT_NE(err_.str().find("--keep-signers"), std::string::npos);

  std::vector<std::string> kept = next;
  kept.insert(kept.end(), {"--keep-signers", "--out", "@kept.json"});
  ASSERT_EQ(run(kept), 0) << err_.str();
  EXPECT_TRUE(result()["removed"].empty());
  EXPECT_EQ(err_.str().find("warning"), std::string::npos) << err_.str();
  const TrustRoot root = read_trusted_root(folder_ / "kept.json");
  EXPECT_EQ(root.package_signer.key_ids.size(), 2U);
  EXPECT_TRUE(root.package_signer.key_ids.contains(old_id));
  EXPECT_EQ(root.airframe_signer->key_ids.size(), 1U);
  EXPECT_EQ(root.tile_signers.at("mini-07").key_ids.size(), 1U);
}

// A revoked key is gone on purpose, and comes back by no convenience.
TEST_F(TrustCommands, KeepingSignersKeepsNoRevokedOne) {
  keys({"r", "lost", "new"});
  ASSERT_EQ(run({"keys", "root", "--root-key", "@r.key.pem", "--package-signer", "@lost.pub.pem", "--expires",
                 "2030-01-01", "--out", "@root.json"}),
            0);
  ASSERT_EQ(run({"keys", "revoke", "--previous", "@root.json", "--revoke", "@lost.pub.pem", "--new-package-signer",
                 "@new.pub.pem", "--root-key", "@r.key.pem", "--out", "@2.json"}),
            0)
      << err_.str();
  EXPECT_EQ(err_.str().find("warning: package signer"), std::string::npos) << err_.str();
  ASSERT_EQ(run({"keys", "root", "--root-key", "@r.key.pem", "--package-signer", "@new.pub.pem", "--expires",
                 "2032-01-01", "--previous", "@2.json", "--keep-signers", "--out", "@3.json"}),
            0)
      << err_.str();
  EXPECT_FALSE(read_trusted_root(folder_ / "3.json")
                   .package_signer.key_ids.contains(PublicKey::read(folder_ / "lost.pub.pem").id()));
}

TEST_F(TrustCommands, SeveralPeopleSignOneRoot) {
  keys({"anna", "ben", "p", "untrusted"});
  const std::vector<std::string> root{
      "keys",         "root",      "--root-key", "@anna.key.pem",    "--out", "@root.json",       "--root-public-key",
      "@ben.pub.pem", "--expires", "2030-01-01", "--root-threshold", "2",     "--package-signer", "@p.pub.pem"};
  EXPECT_EQ(run(root), 2) << "one signature of two";
  std::vector<std::string> incomplete = root;
  incomplete.insert(incomplete.end(), {"--incomplete", "--json"});
  ASSERT_EQ(run(incomplete), 0) << err_.str();
  EXPECT_FALSE(result()["complete"]);
  const std::string package = test::PackageMaker().make(folder_).string();
  ASSERT_EQ(run({"cache", "sign", package, "--key", "@p.key.pem", "--only"}), 0) << err_.str();
  EXPECT_EQ(run({"cache", "verify", package, "--trust", "@root.json"}), 2) << "a half-signed root is trusted by nobody";

  EXPECT_EQ(run({"keys", "sign", "@root.json", "--key", "@untrusted.key.pem"}), 2);
  ASSERT_EQ(run({"keys", "sign", "@root.json", "--key", "@anna.key.pem", "--json"}), 0);
  EXPECT_FALSE(result()["complete"]) << "the same key twice is one signature";
  ASSERT_EQ(run({"keys", "sign", "@root.json", "--key", "@ben.key.pem", "--json"}), 0) << err_.str();
  EXPECT_TRUE(result()["complete"]);
  EXPECT_EQ(run({"cache", "verify", package, "--trust", "@root.json"}), 0) << out_.str() << err_.str();

  // The next one, the same way; complete only when held against the one before.
  incomplete = {"keys",      "root",       "--previous",       "@root.json", "--root-key",        "@anna.key.pem",
                "--out",     "@2.json",    "--root-threshold", "2",          "--root-public-key", "@ben.pub.pem",
                "--expires", "2031-01-01", "--package-signer", "@p.pub.pem", "--incomplete"};
  ASSERT_EQ(run(incomplete), 0) << err_.str();
  ASSERT_EQ(run({"keys", "sign", "@2.json", "--key", "@ben.key.pem", "--previous", "@root.json", "--json"}), 0);
  EXPECT_TRUE(result()["complete"]);
  EXPECT_EQ(run({"cache", "sign", package, "--key", "@p.key.pem", "--carry-root", "@2.json"}), 0) << err_.str();
  EXPECT_EQ(run({"cache", "verify", package, "--trust", "@root.json"}), 0) << out_.str();
}

TEST_F(TrustCommands, PackagesNeedTheThresholdOfTheRoot) {
  keys({"r", "p", "q"});
  ASSERT_EQ(run({"keys", "root", "--root-key", "@r.key.pem", "--package-signer", "@p.pub.pem", "--package-signer",
                 "@q.pub.pem", "--threshold", "2", "--expires", "2030-01-01", "--out", "@root.json"}),
            0);
  const std::string package = test::PackageMaker().make(folder_).string();
  ASSERT_EQ(run({"cache", "sign", package, "--key", "@p.key.pem", "--only"}), 0);
  EXPECT_EQ(run({"cache", "verify", package, "--trust", "@root.json", "--json"}), 1);
  EXPECT_EQ(first_code(), "signature.missing");
  ASSERT_EQ(run({"cache", "sign", package, "--key", "@q.key.pem", "--json"}), 0);
  EXPECT_EQ(result()["signatures"], 2);
  EXPECT_EQ(run({"cache", "verify", package, "--trust", "@root.json"}), 0) << out_.str();
}

TEST_F(TrustCommands, ADamagedPackageIsNotSigned) {
  first_root();
  const fs::path package = test::PackageMaker().make(folder_);
  const std::string before = read_text_file(package / "manifest.sig");
  folder_.write("package/extra", "x");
  EXPECT_EQ(run({"cache", "sign", package.string(), "--key", "@p.key.pem", "--json"}), 1);
  EXPECT_EQ(first_code(), "artifact.unexpected");
  EXPECT_EQ(read_text_file(package / "manifest.sig"), before);
  fs::remove(package / "extra");
  folder_.write("package/manifest.sig", "no envelope");
  EXPECT_EQ(run({"cache", "sign", package.string(), "--key", "@p.key.pem"}), 2);
  EXPECT_EQ(run({"cache", "sign", package.string(), "--key", "@p.key.pem", "--only"}), 0) << err_.str();
  EXPECT_EQ(run({"cache", "sign", "@none", "--key", "@p.key.pem"}), 2);
}

// As of another time, the desk remembers which package it accepted, but never that time.
TEST_F(TrustCommands, AnEvaluationAsOfAnotherTimeRemembersNoTime) {
  test::PackageMaker maker;
  write_file_atomic(folder_ / "root.json", sign_root(maker.root, {&maker.signer}).json());
  const std::string older = maker.make(folder_, "older").string();
  maker.mission = test::mission_yaml({{"sequence: 3", "sequence: 4"}});
  const std::string newer = maker.make(folder_, "newer").string();
  const auto verify = [&](const std::string& package, const std::string& at) {
    return run({"cache", "verify", package, "--trust", "@root.json", "--state", "@s.json", "--at", at, "--json"});
  };
  const std::string now = to_rfc3339(test::kJudged), later = to_rfc3339(UtcTime{test::kJudged.unix_s + 86'400});
  ASSERT_EQ(verify(newer, later), 0) << out_.str();
  EXPECT_EQ(verify(newer, now), 0) << "the later time was not remembered: " << out_.str();
  EXPECT_EQ(verify(older, now), 1);
  EXPECT_NE(out_.str().find("package.rollback"), std::string::npos) << out_.str();
}

TEST_F(TrustCommands, APermitAllowsOneStepBack) {
  test::PackageMaker maker;
  write_file_atomic(folder_ / "root.json", sign_root(maker.root, {&maker.signer}).json());
  write_file_atomic(folder_ / "p.key.pem", maker.signer.pem(), 0600);
  const std::string older = maker.make(folder_, "older").string();
  maker.mission = test::mission_yaml({{"sequence: 3", "sequence: 4"}});
  const std::string newer = maker.make(folder_, "newer").string();
  const auto verify = [&](const std::string& package, std::initializer_list<std::string> more = {}) {
    std::vector<std::string> args{"cache", "verify", package, "--trust", "@root.json", "--state", "@s.json", "--json"};
    args.insert(args.end(), more);
    return run(args);
  };
  const auto permit = [&](const std::string& from, const std::string& to, const std::string& out) {
    return run({"keys", "permit-rollback", "--key", "@p.key.pem", "--series", "village", "--from", from, "--to", to,
                "--expires", "2024-05-01", "--out", out});
  };
  ASSERT_EQ(verify(newer), 0);
  EXPECT_EQ(verify(older), 1);
  EXPECT_EQ(permit("3", "4", "@x.json"), 2) << "no step back";
  ASSERT_EQ(permit("4", "3", "@permit.json"), 0) << err_.str();
  EXPECT_EQ(permit("4", "3", "@permit.json"), 2) << "never overwritten";
  ASSERT_EQ(permit("4", "2", "@other.json"), 0);
  EXPECT_EQ(verify(older, {"--permit", "@other.json"}), 1);
  EXPECT_EQ(verify(older, {"--permit", "@permit.json"}), 0) << out_.str();
  EXPECT_EQ(verify(older), 1) << "the memory did not go down";
  EXPECT_EQ(verify(older, {"--permit", "@root.json"}), 1);
  EXPECT_NE(out_.str().find("permit.invalid"), std::string::npos);
  EXPECT_EQ(run({"keys", "sign", "@permit.json", "--key", "@p.key.pem", "--trust", "@root.json", "--json"}), 0);
  EXPECT_TRUE(result()["complete"]);
}

TEST_F(TrustCommands, ADamagedStateIsRejectedAndKept) {
  test::PackageMaker maker;
  write_file_atomic(folder_ / "root.json", sign_root(maker.root, {&maker.signer}).json());
  const std::string package = maker.make(folder_).string();
  folder_.write("s.json", "{\"schema\":");
  EXPECT_EQ(run({"cache", "verify", package, "--trust", "@root.json", "--state", "@s.json", "--json"}), 1);
  EXPECT_EQ(first_code(), "state.corrupt");
  EXPECT_EQ(read_text_file(folder_ / "s.json"), "{\"schema\":");
}

}  // namespace
}  // namespace nadir
