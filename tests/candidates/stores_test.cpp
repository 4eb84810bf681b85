// What lies on the disk: packs on their way, packs that are kept, the trust root.
#include <gtest/gtest.h>

#include <fstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "candidates/flight_maker.hpp"
#include "candidates/pack_store.hpp"
#include "candidates/trust_file.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

class Stores : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
  Bytes bytes_ = Bytes(1000, 7);
  Sha256 name_ = sha256(bytes_);
};

TEST_F(Stores, AnIncomingPackSurvivesARestart) {
  {
    IncomingPacks incoming(folder_ / "incoming");
    IncomingPack pack = incoming.begin("abc", name_, bytes_.size());
    incoming.append(pack, ByteView(bytes_).first(300), test::kNoon);
    EXPECT_EQ(pack.offset, 300U);
  }
  IncomingPacks incoming(folder_ / "incoming");
  auto pack = incoming.find("abc", name_);
  ASSERT_TRUE(pack);
  EXPECT_EQ(pack->offset, 300U);
  EXPECT_EQ(pack->length, 1000U);
  EXPECT_EQ(pack->grown_s, test::kNoon.unix_s) << "by the service's clock";
  incoming.append(*pack, ByteView(bytes_).subspan(300), test::kNoon);
  EXPECT_TRUE(pack->whole());
  EXPECT_EQ(read_file(pack->path), bytes_);
  EXPECT_EQ(incoming.of("abc").size(), 1U);
  incoming.remove_all_of("abc");
  EXPECT_FALSE(incoming.find("abc", name_));
}

TEST_F(Stores, ExternalNamesAreNotUsedAsPaths) {
  IncomingPacks incoming(folder_ / "incoming");
  fs::create_directories(folder_ / "outside");
  for (const char* name : {"", "..", "../outside", "a/b", "/etc", "a\\b", "a b", "%2e%2e", ".", "x.y"}) {
    EXPECT_THROW(incoming.begin(name, name_, 10), Error) << name;
    EXPECT_THROW(incoming.of(name), Error) << name;
    EXPECT_THROW(incoming.remove_all_of(name), Error) << name;
  }
  EXPECT_THROW(incoming.of(std::string(65, 'a')), Error);
  EXPECT_TRUE(fs::exists(folder_ / "outside"));
}

TEST_F(Stores, IgnoresForeignFilesAmongIncomingPacks) {
  IncomingPacks incoming(folder_ / "incoming");
  fs::create_directories(folder_ / "incoming/abc");
  for (const char* name : {"notes.txt", "aa.12", ".hidden"}) std::ofstream(folder_ / "incoming/abc" / name) << "x";
  std::ofstream(folder_ / "incoming/abc" / (name_.hex() + ".-5")) << "x";
  // Listed, and gone before it is looked at: another call has taken it in.
  fs::create_symlink("nowhere", folder_ / "incoming/abc" / (name_.hex() + ".1000"));
  EXPECT_TRUE(incoming.of("abc").empty());
}

TEST_F(Stores, AStoredPackReturnsOnlyItsTiles) {
  PackStore packs(folder_ / "packs");
  write_file_atomic(folder_ / "whole", ByteView(bytes_));
  packs.adopt(folder_ / "whole", name_);
  packs.adopt(folder_ / "whole", name_);
  fs::remove(folder_ / "whole");
  const Bytes part(100, 7);
  EXPECT_EQ(packs.read({.pack = name_, .start = 50, .bytes = 100}, sha256(part)), part);
  EXPECT_THROW(packs.read({.pack = name_, .start = 50, .bytes = 100}, sha256(bytes_)), Error) << "another digest";
  EXPECT_THROW(packs.read({.pack = name_, .start = 950, .bytes = 100}, sha256(part)), Error) << "beyond the end";
  EXPECT_THROW(packs.read({.pack = sha256(part), .start = 0, .bytes = 1}, sha256(part)), Error) << "no such pack";
  EXPECT_EQ(packs.packs(), std::vector<Sha256>{name_});
  const fs::path kept = folder_ / "packs" / name_.hex().substr(0, 2) / name_.hex();
  write_file_atomic(kept, "damaged");
  EXPECT_THROW(packs.read({.pack = name_, .start = 50, .bytes = 100}, sha256(part)), PackDamaged);
  write_file_atomic(folder_ / "again", ByteView(bytes_));
  packs.adopt(folder_ / "again", name_);
  EXPECT_EQ(packs.read({.pack = name_, .start = 50, .bytes = 100}, sha256(part)), part)
      << "the good one takes its place";
  EXPECT_EQ(packs.packs(), std::vector<Sha256>{name_});
  packs.remove(name_);
  EXPECT_TRUE(packs.packs().empty());
}

class TrustFileTest : public ::testing::Test {
 protected:
  void write(std::int64_t version, const std::set<std::string>& revoked = {}, const PrivateKey* signer = nullptr) {
    write_file_atomic(folder_ / "root.json", test::root_text({&flight_}, signer ? *signer : signer_, version, revoked));
  }
  test::TemporaryFolder folder_;
  PrivateKey signer_ = PrivateKey::generate();
  test::FlightMaker flight_;
};

TEST_F(TrustFileTest, AppliesASuccessorImmediately) {
  write(1);
  TrustFile trust(folder_ / "root.json");
  EXPECT_EQ(trust.current()->version, 1);
  write(2, {flight_.key().public_key().id()});
  EXPECT_EQ(trust.current()->version, 2);
  EXPECT_EQ(trust.current()->revoked.size(), 1U);
  EXPECT_EQ(trust.fault(), "");
}

TEST_F(TrustFileTest, IgnoresAnInvalidSuccessor) {
  write(2);
  TrustFile trust(folder_ / "root.json");
  const PrivateKey stranger = PrivateKey::generate();
  for (const std::function<void()>& damage : std::vector<std::function<void()>>{
           [this] { write(1); },                                        // back in time
           [&] { write(3, {}, &stranger); },                            // by another root key
           [&] { write(2, {}, &stranger); },                            // the same number
           [this] { write_file_atomic(folder_ / "root.json", "{}"); },  // no root
           [this] { fs::remove(folder_ / "root.json"); },
       }) {
    damage();
    EXPECT_EQ(trust.current()->version, 2);
    EXPECT_EQ(trust.current()->root.key_ids.count(signer_.public_key().id()), 1U);
    EXPECT_NE(trust.fault(), "");
  }
  write(3);
  EXPECT_EQ(trust.current()->version, 3) << "and a good one is followed afterwards";
}

}  // namespace
}  // namespace nadir
