// Keys in tokens, against SoftHSM: it is PKCS#11 as real tokens speak it, in software.
#include "token_keys/token_key.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "base/error.hpp"
#include "base/files.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"
#include "trust/signatures.hpp"

namespace nadir {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

constexpr const char* kModule = "/usr/lib/softhsm/libsofthsm2.so";

class TokenKeyTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(kModule) || test::run_shell("command -v pkcs11-tool softhsm2-util").code != 0) {
      GTEST_SKIP() << "NOT TESTED: keys in tokens need softhsm2 and opensc";
    }
    std::filesystem::create_directory(folder_ / "tokens");
    write_file_atomic(folder_ / "softhsm2.conf", "directories.tokendir = " + (folder_ / "tokens").string() +
                                                     "\nobjectstore.backend = file\nlog.level = ERROR\n");
    ::setenv("SOFTHSM2_CONF", (folder_ / "softhsm2.conf").c_str(), 1);
    for (const char* label : {"nadir", "other"}) {
      tool({"softhsm2-util", "--init-token", "--free", "--label", label, "--so-pin", "87654321", "--pin", "1234"});
    }
    // One pair that the token made, and one that exists as a file too: their points are encoded differently.
    tool({"pkcs11-tool", "--module", kModule, "--login", "--pin", "1234", "--token-label", "nadir", "--keypairgen",
          "--key-type", "EC:edwards25519", "--label", "planner", "--id", "01"});
    write_file_atomic(folder_ / "file.key.pem", file_key_.pem(), 0600);
    tool({"softhsm2-util", "--import", (folder_ / "file.key.pem").string(), "--token", "nadir", "--label", "imported",
          "--id", "02", "--pin", "1234"});
    tool({"pkcs11-tool", "--module", kModule, "--login", "--pin", "1234", "--token-label", "nadir", "--keypairgen",
          "--key-type", "EC:prime256v1", "--label", "curve", "--id", "03"});
    write_file_atomic(folder_ / "pin", "1234\n", 0600);
  }
  void TearDown() override { ::unsetenv("SOFTHSM2_CONF"); }

  static void tool(const std::vector<std::string>& command) {
    const auto result = test::run_process(command);
    ASSERT_EQ(result.code, 0) << command[0] << ": " << result.err << result.out;
  }
  std::string uri(const std::string& path, const std::string& query = {}) const {
    return "pkcs11:" + path + "?module-path=" + kModule + query;
  }
  std::string refusal(const std::string& uri, const std::optional<std::string>& pin = "1234") const {
    try {
      open_token_key(uri, pin);
      return {};
    } catch (const Error& error) {
      return error.what();
    }
  }

  test::TemporaryFolder folder_;
  PrivateKey file_key_ = PrivateKey::generate();
};

TEST_F(TokenKeyTest, SignsAsTheFileDoes) {
  const PrivateKey key = open_token_key(uri("token=nadir;object=imported"), "1234");
  EXPECT_EQ(key.public_key().id(), file_key_.public_key().id());
  EXPECT_EQ(key.sign(as_bytes("a manifest")), file_key_.sign(as_bytes("a manifest"))) << "Ed25519 knows no chance";
  EXPECT_EQ(key.sign({}), file_key_.sign({}));
  EXPECT_THROW(key.pem(), Error);
}

TEST_F(TokenKeyTest, ItsOwnKeysSignEnvelopes) {
  const PrivateKey key = open_token_key(uri("token=nadir;id=%01"), "1234");
  const std::string large(1 << 20, 'm');
  EXPECT_TRUE(key.public_key().verifies(as_bytes(large), key.sign(as_bytes(large))));
  // OpenSSL's word.
  write_file_atomic(folder_ / "pub.pem", key.public_key().pem());
  write_file_atomic(folder_ / "message", "signed");
  const Signature signature = key.sign(as_bytes("signed"));
  write_file_atomic(folder_ / "signature", ByteView(signature));
  EXPECT_EQ(test::run_process({"openssl", "pkeyutl", "-verify", "-pubin", "-inkey", folder_ / "pub.pem", "-rawin",
                               "-in", folder_ / "message", "-sigfile", folder_ / "signature"})
                .code,
            0);
}

TEST_F(TokenKeyTest, TwoKeysOfOneTokenAreOpenAtOnce) {
  const PrivateKey a = open_token_key(uri("token=nadir;object=planner"), "1234");
  const PrivateKey b = open_token_key(uri("token=nadir;object=imported"), "1234");
  EXPECT_TRUE(a.public_key().verifies(as_bytes("x"), a.sign(as_bytes("x"))));
  EXPECT_TRUE(b.public_key().verifies(as_bytes("x"), b.sign(as_bytes("x"))));
}

TEST_F(TokenKeyTest, ThePinComesFromAPrivateFileOrTheEnvironment) {
  const std::string source = "&pin-source=" + (folder_ / "pin").string();
  EXPECT_EQ(refusal(uri("token=nadir;object=planner", source), std::nullopt), "");
  EXPECT_EQ(refusal(uri("token=nadir;object=planner", "&pin-source=file:" + (folder_ / "pin").string()), std::nullopt),
            "");
  EXPECT_THAT(refusal(uri("token=nadir;object=planner"), std::nullopt), HasSubstr("asks for its PIN"));
  std::filesystem::permissions(folder_ / "pin", std::filesystem::perms::others_read,
                               std::filesystem::perm_options::add);
  EXPECT_THAT(refusal(uri("token=nadir;object=planner", source), std::nullopt), HasSubstr("0600"));
  const std::string message = refusal(uri("token=nadir;object=planner", "&pin-value=1234"));
  EXPECT_THAT(message, HasSubstr("PIN on the command line"));
  EXPECT_THAT(message, Not(HasSubstr("1234")));
  ::setenv(kTokenPinVariable, "1234", 1);
  EXPECT_EQ(read_signing_key(uri("token=nadir;object=imported")).public_key().id(), file_key_.public_key().id());
  ::unsetenv(kTokenPinVariable);
  EXPECT_EQ(read_signing_key(folder_ / "file.key.pem").public_key().id(), file_key_.public_key().id());
}

TEST_F(TokenKeyTest, AWrongPinIsAnErrorThatDoesNotRepeatIt) {
  const std::string message = refusal(uri("token=nadir;object=planner"), "9876");
  EXPECT_THAT(message, HasSubstr("does not accept the PIN"));
  EXPECT_THAT(message, Not(HasSubstr("9876")));
  EXPECT_EQ(refusal(uri("token=nadir;object=planner")), "");
}

TEST_F(TokenKeyTest, WhatLeadsToNoOrSeveralKeysIsNamed) {
  EXPECT_THAT(refusal(uri("token=nowhere;object=planner")), HasSubstr("tokens nadir, other"));
  EXPECT_THAT(refusal(uri("object=planner")), HasSubstr("several tokens fit"));
  EXPECT_THAT(refusal(uri("token=nadir;object=nobody")), HasSubstr("no such private key"));
  EXPECT_THAT(refusal(uri("token=nadir;object=curve")), HasSubstr("another algorithm"));
  EXPECT_THAT(refusal(uri("token=nadir")), HasSubstr("neither object="));
  EXPECT_THAT(refusal(uri("token=nadir;object=planner;colour=red")), HasSubstr("not known"));
  EXPECT_THAT(refusal("pkcs11:token=%zz;object=x"), HasSubstr("PKCS#11 URI"));
  EXPECT_THAT(refusal("pkcs11:object=x?module-path=/etc/hostname"), HasSubstr("cannot be loaded"));
  tool({"pkcs11-tool", "--module", kModule, "--login", "--pin", "1234", "--token-label", "nadir", "--keypairgen",
        "--key-type", "EC:edwards25519", "--label", "planner", "--id", "09"});
  EXPECT_THAT(refusal(uri("token=nadir;object=planner")), HasSubstr("several private keys fit"));
  EXPECT_EQ(refusal(uri("token=nadir;object=planner;id=%09")), "");
}

TEST_F(TokenKeyTest, WithoutAPublicKeyBesideItNothingIsSigned) {
  tool({"pkcs11-tool", "--module", kModule, "--login", "--pin", "1234", "--token-label", "nadir", "--delete-object",
        "--type", "pubkey", "--id", "01"});
  EXPECT_THAT(refusal(uri("token=nadir;id=%01")), HasSubstr("no public key"));
}

}  // namespace
}  // namespace nadir
