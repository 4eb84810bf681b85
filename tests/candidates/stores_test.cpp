// What lies on the disk: packs on their way, packs that are kept, the trust root.
#include <gtest/gtest.h>
#include <cstdlib>
#include <fstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "candidates/candidate_catalogue.hpp"
#include "candidates/flight_maker.hpp"
#include "candidates/pack_store.hpp"
#include "candidates/service_fixture.hpp"
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
  FixedClock clock_{{1'800'000'000}};
  TrustFile trust() { return TrustFile(folder_ / "root.json", memory_, clock_); }

  test::TemporaryFolder folder_;
  fs::path memory_ = folder_ / kTrustMemoryFile;
  PrivateKey signer_ = PrivateKey::generate();
  test::FlightMaker flight_;
};

// Whoever can write the file puts the root back under which a lost key was still good, and waits for a restart.
TEST_F(TrustFileTest, ARollbackIsRejectedAfterARestart) {
  write(1);
  EXPECT_TRUE(trust().first_start());
  write(2, {flight_.key().public_key().id()});
  EXPECT_EQ(trust().current()->version, 2);
  write(1);
  TrustFile again = trust();
  EXPECT_FALSE(again.first_start());
  EXPECT_EQ(again.current()->version, 2);
  EXPECT_EQ(again.current()->revoked.size(), 1U);
  EXPECT_NE(again.fault().find("root.rollback: expected version 3, found version 1"), std::string::npos)
      << again.fault();
  write(3, {flight_.key().public_key().id()});
  EXPECT_EQ(again.current()->version, 3);
  EXPECT_EQ(again.fault(), "");
}

// A service that was off while the root went on by several versions goes over those between.
TEST_F(TrustFileTest, FollowsAChainOfSeveralVersions) {
  write(1);
  static_cast<void>(trust());
  write(3);
  TrustFile again = trust();
  EXPECT_EQ(again.current()->version, 1);
  EXPECT_NE(again.fault().find("put 2.root.json beside it"), std::string::npos) << again.fault();
  write_file_atomic(folder_ / "2.root.json", test::root_text({&flight_}, PrivateKey::generate(), 2));
  EXPECT_EQ(again.current()->version, 1) << "an untrusted's root leads nowhere";
  write_file_atomic(folder_ / "2.root.json", test::root_text({&flight_}, signer_, 2));
  EXPECT_EQ(again.current()->version, 3);
  EXPECT_EQ(again.fault(), "");
}

TEST_F(TrustFileTest, ADamagedMemoryIsAnError) {
  write(2);
  static_cast<void>(trust());
  const std::string whole = read_text_file(memory_);
  write(1);
  for (const std::string& damaged : {std::string(), std::string("{}"), whole.substr(0, whole.size() / 2),
                                     test::root_text({&flight_}, signer_, 1).replace(20, 4, "    ")}) {
    write_file_atomic(memory_, damaged);
    EXPECT_THROW(trust(), Error) << damaged.substr(0, 40);
  }
  fs::remove(memory_);  // the documented way back
  EXPECT_EQ(trust().current()->version, 1);
}

// A disk that is full does not keep a revoked key alive; a restart would, and the operator is informed.
TEST_F(TrustFileTest, ARootThatCannotBeStoredIsInForceAndReported) {
  write(1);
  TrustFile trust(folder_ / "root.json", folder_ / "gone" / "memory.json", clock_);
  EXPECT_EQ(trust.current()->version, 1);
  EXPECT_NE(trust.fault().find("a restart would forget it"), std::string::npos) << trust.fault();
  write(2, {flight_.key().public_key().id()});
  EXPECT_EQ(trust.current()->revoked.size(), 1U);
  fs::create_directories(folder_ / "gone");
  EXPECT_EQ(trust.fault(), "") << "it is tried again";
  EXPECT_EQ(parse_root(read_text_file(folder_ / "gone" / "memory.json"), "memory").root.version, 2);
}

TEST_F(TrustFileTest, AppliesASuccessorImmediately) {
  write(1);
  TrustFile trust(folder_ / "root.json", memory_, clock_);
  EXPECT_EQ(trust.current()->version, 1);
  write(2, {flight_.key().public_key().id()});
  EXPECT_EQ(trust.current()->version, 2);
  EXPECT_EQ(trust.current()->revoked.size(), 1U);
  EXPECT_EQ(trust.fault(), "");
}

TEST_F(TrustFileTest, IgnoresAnInvalidSuccessor) {
  write(2);
  TrustFile trust(folder_ / "root.json", memory_, clock_);
  const PrivateKey untrusted = PrivateKey::generate();
  for (const std::function<void()>& damage : std::vector<std::function<void()>>{
           [this] { write(1); },                                        // back in time
           [&] { write(3, {}, &untrusted); },                           // by another root key
           [&] { write(2, {}, &untrusted); },                           // the same number
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

TEST_F(TrustFileTest, AnExpiredRootKeyCannotAppoint) {
  TrustRoot first = parse_root(test::root_text({&flight_}, signer_, 1, {}), "test").root;
  first.keys.at(signer_.public_key().id()).expires = UtcTime{clock_.now().unix_s + 60};
  write_file_atomic(folder_ / "root.json", sign_root(first, {&signer_}).json());
  TrustFile trust(folder_ / "root.json", memory_, clock_);
  clock_ = FixedClock({clock_.now().unix_s + 61});
  write(2);
  EXPECT_EQ(trust.current()->version, 1);
  EXPECT_NE(trust.fault().find("key.expired"), std::string::npos) << trust.fault();
}

// A pack is forgotten, and before its file goes, another upload brings the very same pack; or one of its tiles in
// another pack, whose file is not needed. In a SpatiaLite file, or in the catalogue that NADIR_TEST_CATALOGUE names
// (postgis_test.py).

class AdoptedPack : public ::testing::Test {
 protected:
  CatalogueLocation location() const {
    const char* given = std::getenv("NADIR_TEST_CATALOGUE");
    return parse_catalogue_location(given != nullptr ? given : (folder_ / "catalogue.sqlite").string());
  }
  // Another one of the same tile each time.
  std::int64_t open_upload(CandidateCatalogue& catalogue) { return open_upload(catalogue, {tile_}); }
  std::int64_t open_upload(CandidateCatalogue& catalogue, const std::vector<Candidate>& tiles) {
    const std::string name = sha256(as_bytes(this_test() + std::to_string(++uploads_))).hex();
    const std::vector<std::optional<Refusal>> refusals(tiles.size());
    UploadRow upload;
    upload.name = name;
    upload.batch_key = sha256(as_bytes(name));
    return catalogue.open_upload(upload, flight_.batch(tiles, uploads_).batch, refusals, 1);
  }
  static std::string this_test() { return ::testing::UnitTest::GetInstance()->current_test_info()->name(); }
  void bring(CandidateCatalogue& catalogue, std::int64_t upload) { bring(catalogue, upload, {tile_}); }
  // Returns the pack's name.
  Sha256 bring(CandidateCatalogue& catalogue, std::int64_t upload, const std::vector<Candidate>& tiles) {
    const Bytes bytes = test::pack_of(tiles);
    std::vector<CandidateCatalogue::PackedTile> packed;
    std::uint64_t start = kPackHeadSize + tiles.size() * kPackEntrySize;
    for (const Candidate& tile : tiles) {
      packed.push_back({tile.sidecar.sha256, start, tile.tile.size()});
      start += tile.tile.size();
    }
    catalogue.add_pack(upload, sha256(bytes), bytes.size(), packed, [&] {
      write_file_atomic(folder_ / "come", ByteView(bytes));
      store_.adopt(folder_ / "come", sha256(bytes));
    });
    return sha256(bytes);
  }
  void judge(CandidateCatalogue& catalogue, std::int64_t upload, bool damaged) {
    catalogue.start_judging(upload);
    const AddressWork::Claim claim = catalogue.work().claim_tiles(upload, 10);
    const TileVerdict verdict{.tile = catalogue.tiles_of(upload, CandidateCatalogue::Detail::verdicts).at(0).id,
                              .verdict = Verdict::rejected,
                              .refusal = Refusal{.code = ReasonCode::blurred, .detail = "test"}};
    AddressResult result{.key = tile_.sidecar.key};
    result.judged.push_back(
        {.verdict = verdict, .keyid = tile_.signature.keyid, .sha256 = tile_.sidecar.sha256, .damaged = damaged});
    ASSERT_TRUE(catalogue.work().write(claim, {&result, 1}, 1, {}));
  }
  std::vector<Sha256> finish(CandidateCatalogue& catalogue, std::int64_t upload) {
    return catalogue.finish_judging(upload).value_or(std::vector<Sha256>());
  }
  void reject(CandidateCatalogue& catalogue, std::int64_t upload) { judge(catalogue, upload, false); }
  Bytes read(CandidateCatalogue& catalogue, std::int64_t upload) {
    const auto tiles = catalogue.tiles_of(upload, CandidateCatalogue::Detail::verdicts);
    return store_.read(tiles.at(0).blob.value(), tile_.sidecar.sha256);
  }

  test::TemporaryFolder folder_;
  PackStore store_{folder_ / "packs"};
  // Ground of each test's own: the catalogue may be the same one.
  test::FlightMaker flight_{{.ground = std::hash<std::string>()(this_test())}};
  Candidate tile_ = flight_.candidate(test::keys_in_a_row(1).at(0));
  Bytes bytes_ = test::pack_of({tile_});
  Sha256 pack_ = sha256(bytes_);
  std::uint64_t start_ = kPackHeadSize + kPackEntrySize;
  int uploads_ = 0;
  std::function<void(const Sha256&)> remove_ = [this](const Sha256& pack) { store_.remove(pack); };
};

TEST_F(AdoptedPack, SurvivesAConcurrentRemoval) {
  CandidateCatalogue judging(location(), CandidateCatalogue::Access::write);
  CandidateCatalogue taking_in(location(), CandidateCatalogue::Access::write);
  const std::int64_t first = open_upload(judging);
  bring(judging, first);
  reject(judging, first);
  const std::vector<Sha256> dead = finish(judging, first);
  EXPECT_EQ(dead, std::vector<Sha256>{pack_});

  const std::int64_t second = open_upload(taking_in);
  bring(taking_in, second);

  judging.remove_unused(dead, remove_);
  EXPECT_EQ(read(taking_in, second), tile_.tile) << "the second upload's tile can be judged";
  reject(judging, second);
  judging.remove_unused(finish(judging, second), remove_);
  EXPECT_TRUE(store_.packs().empty()) << "now it is not needed";
}

TEST_F(AdoptedPack, IsMovedIntoPlaceUnderTheLock) {
  CandidateCatalogue catalogue(location(), CandidateCatalogue::Access::write);
  const std::int64_t upload = open_upload(catalogue);
  const CandidateCatalogue::PackedTile packed{tile_.sidecar.sha256, start_, tile_.tile.size()};
  // Its file is put into place within the transaction: when that fails, there is no row either.
  EXPECT_THROW(catalogue.add_pack(upload, pack_, bytes_.size(), {&packed, 1}, [] { throw Error({.what = "full"}); }),
               Error);
  EXPECT_FALSE(catalogue.pack_size(upload, pack_));
  bring(catalogue, upload);
  EXPECT_EQ(read(catalogue, upload), tile_.tile);
}

TEST_F(AdoptedPack, OfARemovedUploadIsNotStored) {
  CandidateCatalogue catalogue(location(), CandidateCatalogue::Access::write);
  const std::int64_t upload = open_upload(catalogue);
  catalogue.remove_unused(catalogue.forget_upload(upload), remove_);
  EXPECT_THROW(bring(catalogue, upload), Error);
  EXPECT_TRUE(store_.packs().empty());
}

// Two uploads announce the same tiles before either has sent them, and pack them differently.
TEST_F(AdoptedPack, WithoutNewTilesLeavesNoFile) {
  CandidateCatalogue catalogue(location(), CandidateCatalogue::Access::write);
  const Candidate other = flight_.candidate(test::keys_in_a_row(2).at(1)),
                  third = flight_.candidate(test::keys_in_a_row(3).at(2));
  const std::int64_t first = open_upload(catalogue, {tile_, other}), second = open_upload(catalogue, {tile_, third});
  const Sha256 both = bring(catalogue, first, {tile_, other});
  const Sha256 again = bring(catalogue, second, {tile_});
  EXPECT_EQ(store_.packs(), std::vector<Sha256>{both});
  EXPECT_TRUE(catalogue.pack_size(second, again)) << "it has come all the same";
  EXPECT_EQ(read(catalogue, second), tile_.tile) << "from the other pack";
  bring(catalogue, second, {tile_, third});
  EXPECT_EQ(store_.packs().size(), 2U) << "one tile of it is new";
  EXPECT_EQ(read(catalogue, second), tile_.tile);
}

TEST_F(AdoptedPack, ThatIsDamagedIsReplacedWhenSentAgain) {
  CandidateCatalogue catalogue(location(), CandidateCatalogue::Access::write);
  bring(catalogue, open_upload(catalogue));
  const std::string name = pack_.hex();
  Bytes damaged = bytes_;
  damaged.back() ^= 1;
  write_file_atomic(folder_ / "packs" / name.substr(0, 2) / name, ByteView(damaged));
  const std::int64_t second = open_upload(catalogue);
  EXPECT_THROW(read(catalogue, second), PackDamaged);
  bring(catalogue, second);
  EXPECT_EQ(read(catalogue, second), tile_.tile);
}

TEST_F(AdoptedPack, IsRemovedWithTheLastPendingVerdict) {
  CandidateCatalogue catalogue(location(), CandidateCatalogue::Access::write);
  const std::int64_t first = open_upload(catalogue), second = open_upload(catalogue);
  bring(catalogue, first);
  reject(catalogue, first);
  catalogue.remove_unused(finish(catalogue, first), remove_);
  EXPECT_EQ(read(catalogue, second), tile_.tile) << "the second upload brought nothing, and waits";
  reject(catalogue, second);
  catalogue.remove_unused(finish(catalogue, second), remove_);
  EXPECT_TRUE(store_.packs().empty());
}

TEST_F(AdoptedPack, IsRemovedWithTheLastUploadThatNeedsIt) {
  CandidateCatalogue catalogue(location(), CandidateCatalogue::Access::write);
  const std::int64_t first = open_upload(catalogue), second = open_upload(catalogue);
  bring(catalogue, first);
  reject(catalogue, first);
  catalogue.remove_unused(finish(catalogue, first), remove_);
  EXPECT_EQ(store_.packs().size(), 1U);
  catalogue.remove_unused(catalogue.forget_upload(second), remove_);
  EXPECT_TRUE(store_.packs().empty());
}

// Whatever was damaged in it: nothing lies there any more.
TEST_F(AdoptedPack, WithoutRemainingTilesIsRemovedWithItsUpload) {
  CandidateCatalogue catalogue(location(), CandidateCatalogue::Access::write);
  const std::int64_t upload = open_upload(catalogue);
  bring(catalogue, upload);
  judge(catalogue, upload, true);
  catalogue.remove_unused(finish(catalogue, upload), remove_);
  EXPECT_TRUE(store_.packs().empty());
}

// Two workers: on PostGIS each with a connection of its own, on SpatiaLite both with the service's.
class ClaimedAddress : public AdoptedPack {
 protected:
  void SetUp() override {
    if (!server()) return;
    CandidateCatalogue other(location(), CandidateCatalogue::Access::write);  // what other tests have left
    for (const UploadRow& upload : other.uploads_in(UploadState::judging)) other.forget_upload(upload.id);
  }
  bool server() const { return location().kind == CatalogueLocation::Kind::postgres; }
  AddressWork& second() {
    if (!server()) return first_.work();
    if (!second_) second_.emplace(location(), CandidateCatalogue::Access::write);
    return second_->work();
  }
  std::vector<Candidate> row(std::uint32_t count) const {
    std::vector<Candidate> tiles;
    for (const TileKey& key : test::keys_in_a_row(count)) tiles.push_back(flight_.candidate(key));
    return tiles;
  }
  std::int64_t judging(const std::vector<Candidate>& tiles) {
    const std::int64_t upload = open_upload(first_, tiles);
    bring(first_, upload, tiles);
    first_.start_judging(upload);
    return upload;
  }
  static std::vector<TileKey> keys_of(const AddressWork::Claim& claim) {
    std::vector<TileKey> keys;
    for (const AddressTask& address : claim.addresses) keys.push_back(address.key);
    return keys;
  }
  // As a worker that accepts everything, without a vote.
  static std::vector<AddressResult> accepting(const AddressWork::Claim& claim) {
    std::vector<AddressResult> results;
    for (const AddressTask& address : claim.addresses) {
      AddressResult& result = results.emplace_back(AddressResult{.key = address.key});
      for (const TileRow& tile : address.waiting)
        result.judged.push_back({.verdict = {.tile = tile.id}, .keyid = tile.keyid, .sha256 = tile.sha256});
    }
    return results;
  }

  CandidateCatalogue first_{location(), CandidateCatalogue::Access::write};
  std::optional<CandidateCatalogue> second_;
};

TEST_F(ClaimedAddress, IsOfOneWorkerUntilItsEnd) {
  const auto tiles = row(3);
  const std::int64_t upload = judging(tiles);
  const AddressWork::Claim two = first_.work().claim_tiles(upload, 2);
  EXPECT_EQ(two.addresses.size(), 2U);
  EXPECT_TRUE(two.more);
  const AddressWork::Claim rest = second().claim_tiles(upload, 2);
  EXPECT_EQ(keys_of(rest), std::vector<TileKey>{tiles[2].sidecar.key});
  EXPECT_FALSE(rest.more);
  first_.work().release(two);
  second().release(rest);
  EXPECT_EQ(second().claim_tiles(upload, 10).addresses.size(), 3U) << "what is given back is there again";
}

TEST_F(ClaimedAddress, BringsTheTilesOfEveryCompleteUpload) {
  const auto tiles = row(1);
  const std::int64_t one = judging(tiles), two = judging(tiles);
  open_upload(first_, tiles);  // not complete
  AddressWork::Claim claim = second().claim_tiles(two, 10);
  ASSERT_EQ(claim.addresses.size(), 1U);
  ASSERT_EQ(claim.addresses[0].waiting.size(), 2U);
  EXPECT_EQ(claim.addresses[0].waiting[0].upload, one) << "in the order of their announcement";
  auto results = accepting(claim);
  ASSERT_TRUE(second().write(claim, results, 1, {}));
  EXPECT_TRUE(first_.work().claim_tiles(one, 10).addresses.empty());
  claim = second().claim_votes(10);
  ASSERT_EQ(claim.addresses.size(), 1U) << "the vote is due";
  EXPECT_EQ(claim.addresses[0].standing.candidates.size(), 2U);
  second().release(claim);
  EXPECT_TRUE(first_.finish_judging(one));
  EXPECT_FALSE(first_.finish_judging(one)) << "once";
}

TEST_F(ClaimedAddress, MayBeOneOfThousands) {
  std::set<TileKey> unreadable;
  for (const TileKey& key : test::keys_in_a_row(3000, 7)) unreadable.insert(key);
  first_.work().release(first_.work().claim_votes(10, unreadable));
}

TEST_F(ClaimedAddress, ThatWasLostIsNotWritten) {
  const std::int64_t upload = judging(row(2));
  const AddressWork::Claim claim = first_.work().claim_tiles(upload, 10);
  auto results = accepting(claim);
  first_.work().release(claim);
  EXPECT_FALSE(first_.work().write(claim, results, 1, {}));
  const AddressWork::Claim again = second().claim_tiles(upload, 10);
  auto others = accepting(again);
  EXPECT_TRUE(second().write(again, others, 1, {}));
}

// Ground stations do not wait for workers: while one holds an address, others announce, send and complete.
TEST_F(ClaimedAddress, KeepsNoStationWaiting) {
  const auto tiles = row(1);
  const std::int64_t upload = judging(tiles);
  const AddressWork::Claim claim = second().claim_tiles(upload, 10);
  const std::int64_t next = judging(tiles);
  auto results = accepting(claim);
  ASSERT_TRUE(second().write(claim, results, 1, {}));
  EXPECT_EQ(first_.work().claim_tiles(next, 10).addresses.size(), 1U);
}

TEST_F(ClaimedAddress, OfARevokedKeyIsRejected) {
  const std::int64_t upload = judging(row(2));
  const AddressWork::Claim claim = second().claim_tiles(upload, 10);
  auto results = accepting(claim);
  std::set<std::string> revoked{tile_.signature.keyid};
  first_.work().withdraw(revoked);
  if (server()) revoked.clear();  // a worker elsewhere does not know the newest root: the catalogue does
  ASSERT_TRUE(second().write(claim, results, 1, revoked));
  for (const TileRow& tile : first_.tiles_of(upload, CandidateCatalogue::Detail::verdicts))
    EXPECT_EQ(tile.code, ReasonCode::airframe_revoked);
}

class SparePack : public test::ServiceFixture {};

// Both announce it before either has sent it: each is asked to send, and the bytes are stored once.
TEST_F(SparePack, OfAnotherUploadLeavesNoFile) {
  const auto tiles = candidates(first_, test::keys_in_a_row(2));
  const std::string one = announced(first_.batch(tiles, 1)).upload;
  const Announcement other = announced(first_.batch({tiles[0]}, 2));
  ASSERT_EQ(other.missing.size(), 1U);
  const Bytes both = test::pack_of(tiles), alone = test::pack_of({tiles[0]});
  ASSERT_TRUE(std::holds_alternative<PackOffset>(send(one, both)));
  ASSERT_TRUE(std::holds_alternative<PackOffset>(send(other.upload, alone)));
  const PackStore store(options_.data / "packs");
  EXPECT_EQ(store.packs(), std::vector<Sha256>{sha256(both)});
  const auto offset = service().offset(client_, other.upload, sha256(alone));
  EXPECT_EQ(std::get<PackOffset>(offset).offset, alone.size()) << "its sender has sent all of it";
  restarted();
  std::optional<std::int64_t> judge;
  service().complete(client_, one, judge);
  service().complete(client_, other.upload, judge);
  judge_all();
  EXPECT_EQ(verdicts(one)[0].verdict, Verdict::accepted);
  EXPECT_EQ(verdicts(other.upload)[0].verdict, Verdict::duplicate);
  EXPECT_EQ(store.packs(), std::vector<Sha256>{sha256(both)});
}

// Killed when the last part had come, and before the pack was looked at.
TEST_F(SparePack, ReceivedCompletelyBeforeAKillLeavesNoFile) {
  const auto tiles = candidates(first_, test::keys_in_a_row(2));
  const std::string one = announced(first_.batch(tiles, 1)).upload,
                    other = announced(first_.batch({tiles[0]}, 2)).upload;
  const Bytes both = test::pack_of(tiles), alone = test::pack_of({tiles[0]});
  ASSERT_TRUE(std::holds_alternative<PackOffset>(send(one, both)));
  service_.reset();
  IncomingPacks incoming(options_.data / "incoming");
  IncomingPack pack = incoming.begin(other, sha256(alone), alone.size());
  incoming.append(pack, alone, clock_.now());
  restarted();
  EXPECT_EQ(PackStore(options_.data / "packs").packs(), std::vector<Sha256>{sha256(both)});
  EXPECT_FALSE(incoming.find(other, sha256(alone)));
  std::optional<std::int64_t> judge;
  EXPECT_TRUE(std::holds_alternative<Completion>(service().complete(client_, other, judge)));
}

// Killed when its file was in place, and before its rows were: put there by hand.
TEST_F(SparePack, MovedIntoPlaceBeforeAKillIsRemovedAtStart) {
  const auto tiles = candidates(first_, test::keys_in_a_row(2));
  ASSERT_TRUE(std::holds_alternative<PackOffset>(send(announced(first_.batch(tiles, 1)).upload, test::pack_of(tiles))));
  PackStore store(options_.data / "packs");
  const Bytes alone = test::pack_of({tiles[0]});
  write_file_atomic(folder_ / "come", ByteView(alone));
  store.adopt(folder_ / "come", sha256(alone));
  EXPECT_EQ(store.packs().size(), 2U);
  restarted();
  EXPECT_EQ(store.packs(), std::vector<Sha256>{sha256(test::pack_of(tiles))});
}

}  // namespace
}  // namespace nadir
