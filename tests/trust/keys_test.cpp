#include "trust/keys.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <map>
#include <vector>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using test::TemporaryFolder;

// The independent oracle: the openssl command line, in the folder.
int openssl(const TemporaryFolder& folder, const std::string& arguments) {
  const std::string command = "cd '" + folder.path().string() + "' && openssl " + arguments + " >/dev/null 2>&1";
  return std::system(command.c_str());
}

unsigned mode_of(const std::filesystem::path& path) {
  struct stat info {};
  EXPECT_EQ(::stat(path.c_str(), &info), 0);
  return info.st_mode & 07777;
}

TEST(Keys, CreatedFilesEqualThoseOfOpenSsl) {
  const TemporaryFolder folder;
  const KeyFiles files = create_key_files(folder / "k");
  EXPECT_EQ(mode_of(files.private_key), 0600U);
  EXPECT_EQ(openssl(folder, "pkey -in k.key.pem -pubout -out theirs.pem"), 0);
  EXPECT_EQ(read_text_file(folder / "theirs.pem"), read_text_file(files.public_key));
}

TEST(Keys, IdIsTheDigestOfTheDerEncoding) {
  const TemporaryFolder folder;
  create_key_files(folder / "k");
  ASSERT_EQ(openssl(folder, "pkey -pubin -in k.pub.pem -outform DER -out k.der"), 0);
  EXPECT_EQ(PublicKey::read(folder / "k.pub.pem").id(), sha256_file(folder / "k.der").hex());
}

TEST(Keys, OpenSslVerifiesOurSignature) {
  const TemporaryFolder folder;
  const KeyFiles files = create_key_files(folder / "k");
  folder.write("message", "what is signed");
  const Signature signature = PrivateKey::read(files.private_key).sign(as_bytes("what is signed"));
  write_file_atomic(folder / "sig", ByteView(signature));
  EXPECT_EQ(openssl(folder, "pkeyutl -verify -pubin -inkey k.pub.pem -rawin -in message -sigfile sig"), 0);
  folder.write("message", "what is Signed");
  EXPECT_NE(openssl(folder, "pkeyutl -verify -pubin -inkey k.pub.pem -rawin -in message -sigfile sig"), 0);
}

TEST(Keys, WeVerifyOpenSslsSignature) {
  const TemporaryFolder folder;
  ASSERT_EQ(openssl(folder, "genpkey -algorithm ed25519 -out k.key.pem"), 0);
  ASSERT_EQ(openssl(folder, "pkey -in k.key.pem -pubout -out k.pub.pem"), 0);
  folder.write("message", "what is signed");
  ASSERT_EQ(openssl(folder, "pkeyutl -sign -inkey k.key.pem -rawin -in message -out sig"), 0);
  const Bytes signature = read_file(folder / "sig");
  const PublicKey key = PublicKey::read(folder / "k.pub.pem");
  EXPECT_TRUE(key.verifies(as_bytes("what is signed"), signature));
  EXPECT_FALSE(key.verifies(as_bytes("what is signee"), signature));
  EXPECT_FALSE(key.verifies(as_bytes("what is signed"), ByteView(signature).first(63)));
  EXPECT_FALSE(key.verifies(as_bytes("what is signed"), {}));
  std::filesystem::permissions(folder / "k.key.pem", std::filesystem::perms(0600));
  EXPECT_EQ(PrivateKey::read(folder / "k.key.pem").public_key().id(), key.id());
}

// RFC 8032, 7.1, test 2.
TEST(Keys, MatchesTheVectorOfTheRfc) {
  const auto from_hex = [](std::string_view hex) {
    Bytes bytes;
    for (std::size_t i = 0; i < hex.size(); i += 2) {
      bytes.push_back(static_cast<std::uint8_t>(std::stoul(std::string(hex.substr(i, 2)), nullptr, 16)));
    }
    return bytes;
  };
  const auto key = PublicKey::from_raw(from_hex("3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c"));
  EXPECT_TRUE(
      key.verifies(from_hex("72"), from_hex("92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da"
                                            "085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00")));
}

TEST(Keys, RejectsPrivateKeysReadableByOthers) {
  const TemporaryFolder folder;
  const KeyFiles files = create_key_files(folder / "k");
  for (const unsigned mode : {0640U, 0604U, 0660U, 0644U, 0601U, 0700U}) {
    ASSERT_EQ(::chmod(files.private_key.c_str(), mode), 0);
    EXPECT_THROW(PrivateKey::read(files.private_key), UsageError) << std::oct << mode;
  }
  ASSERT_EQ(::chmod(files.private_key.c_str(), 0400), 0);
  EXPECT_NO_THROW(PrivateKey::read(files.private_key));
}

TEST(Keys, RejectsOtherFiles) {
  const TemporaryFolder folder;
  ASSERT_EQ(openssl(folder, "genpkey -algorithm x25519 -out x.key.pem"), 0);
  ASSERT_EQ(openssl(folder, "ecparam -genkey -name prime256v1 -noout -out ec.key.pem"), 0);
  ASSERT_EQ(openssl(folder, "genpkey -algorithm ed25519 -aes256 -pass pass:x -out locked.key.pem"), 0);
  ASSERT_EQ(openssl(folder, "pkey -in x.key.pem -pubout -out x.pub.pem"), 0);
  folder.write("rubbish.key.pem", "-----BEGIN PRIVATE KEY-----\nnot base64\n-----END PRIVATE KEY-----\n");
  folder.write("empty.key.pem", "");
  for (const char* name : {"x", "ec", "locked", "rubbish", "empty"}) {
    const auto path = folder / (std::string(name) + ".key.pem");
    std::filesystem::permissions(path, std::filesystem::perms(0600));
    EXPECT_THROW(PrivateKey::read(path), UsageError) << name;
    EXPECT_THROW(PublicKey::read(path), UsageError) << name;
  }
  EXPECT_THROW(PublicKey::read(folder / "x.pub.pem"), UsageError);
  EXPECT_THROW(PublicKey::read(folder / "none.pub.pem"), Error);
  EXPECT_THROW(PrivateKey::read(folder / "none.key.pem"), Error);
}

// Eight processes at once: one pair, and the key that the winner printed is the one in the files.
TEST(Keys, OfProcessesAtOnceExactlyOneCreatesThePair) {
  for (int round = 0; round < 8; ++round) {
    const TemporaryFolder folder;
    int gate[2];
    ASSERT_EQ(::pipe(gate), 0);
    std::vector<pid_t> children;
    for (int i = 0; i < 8; ++i) {
      children.push_back(::fork());
      if (children.back() != 0) continue;
      ::close(gate[1]);
      char byte = 0;
      const ssize_t released = ::read(gate[0], &byte, 1);  // ends when the parent closes it
      int code = released == 0 ? 9 : 8;
      try {
        create_key_files(folder / "k");
        code = 0;
      } catch (const UsageError& error) {
        code = std::string_view(error.what()).find("a key of this name exists") != std::string_view::npos ? 1 : 7;
      } catch (...) {
      }
      ::_exit(code);
    }
    ::close(gate[0]);
    ::close(gate[1]);
    std::map<int, int> codes;
    for (const pid_t child : children) {
      int status = 0;
      ASSERT_EQ(::waitpid(child, &status, 0), child);
      ++codes[WEXITSTATUS(status)];
    }
    EXPECT_EQ(codes, (std::map<int, int>{{0, 1}, {1, 7}}));
    EXPECT_EQ(PrivateKey::read(folder / "k.key.pem").public_key().id(), PublicKey::read(folder / "k.pub.pem").id());
    EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), std::filesystem::directory_iterator()),
              2);
  }
}

TEST(Keys, ThePairIsCreatedWholeOrNotAtAll) {
  const TemporaryFolder folder;
  folder.write("k.pub.pem", "somebody else's");
  EXPECT_THROW(create_key_files(folder / "k"), UsageError);
  EXPECT_FALSE(std::filesystem::exists(folder / "k.key.pem"));
  EXPECT_EQ(read_text_file(folder / "k.pub.pem"), "somebody else's");
  // A private key alone says how to get the other half.
  create_key_files(folder / "l");
  std::filesystem::remove(folder / "l.pub.pem");
  try {
    create_key_files(folder / "l");
    FAIL() << "it was overwritten";
  } catch (const UsageError& error) {
    EXPECT_NE(error.text().fix.find("-pubout"), std::string::npos) << error.what();
  }
}

TEST(Keys, NeverOverwrites) {
  const TemporaryFolder folder;
  create_key_files(folder / "k");
  const std::string before = read_text_file(folder / "k.key.pem");
  EXPECT_THROW(create_key_files(folder / "k"), UsageError);
  EXPECT_EQ(read_text_file(folder / "k.key.pem"), before);
}

}  // namespace
}  // namespace nadir
