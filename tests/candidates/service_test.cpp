// The candidate service without HTTP: the way of a tile from announcement to promotion, repeated and interrupted.
#include <gtest/gtest.h>
#include <fstream>

#include "base/error.hpp"
#include "candidates/promoted_imagery.hpp"
#include "candidates/service_fixture.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "package/manifest.hpp"
#include "package/mission_check.hpp"
#include "package/package_maker.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

class Service : public test::ServiceFixture {};

TEST_F(Service, ATileGoesFromAnnouncementToVerdict) {
  const auto tiles = candidates(first_, test::keys_in_a_row(3));
  const Announcement announcement = announced(first_.batch(tiles));
  EXPECT_TRUE(announcement.opened);
  EXPECT_EQ(announcement.missing.size(), 3U);
  EXPECT_TRUE(announcement.refused.empty());
  for (const TileRow& tile : verdicts(announcement.upload)) EXPECT_FALSE(tile.verdict);
  for (const TileRow& tile : upload(first_, tiles)) EXPECT_EQ(tile.verdict, Verdict::accepted) << tile.detail;
  const CatalogueCounts counts = service().counts();
  EXPECT_EQ(counts.accepted, 3);
  EXPECT_EQ(counts.to_vote, 0);
  EXPECT_EQ(counts.promoted, 0) << "one flight promotes nothing";
}

TEST_F(Service, FlightsThatAgreePromote) {
  const auto keys = test::keys_in_a_row(4);
  upload(first_, candidates(first_, keys), 1);
  second_.options().sigma_mm = 900;  // the better one
  upload(second_, candidates(second_, keys), 2);
  EXPECT_EQ(service().counts().promoted, 4);
  test::FlightMaker third{{.airframe = "mini-09", .flight = "flight-3", .ground = 5, .noise = 3}};
  write_file_atomic(folder_ / "root.json", test::root_text({&first_, &second_, &third}, signer_, 2));
  upload(third, candidates(third, keys), 3);
  EXPECT_EQ(service().counts().promoted, 4) << "one that saw other ground changes nothing";
  service_.reset();
  CandidateCatalogue catalogue(options_.catalogue, CandidateCatalogue::Access::read);
  catalogue.each_promoted([](const PromotedTile& tile) { EXPECT_EQ(tile.sidecar.airframe, "mini-08"); });
}

TEST_F(Service, APromotedTileIsNoMoreCertainThanItsFlights) {
  const auto keys = test::keys_in_a_row(1);
  first_.options().sigma_mm = 1;  // as it says
  second_.options().sigma_mm = 2'400;
  upload(first_, candidates(first_, keys), 1);
  upload(second_, candidates(second_, keys), 2);
  service_.reset();
  std::vector<PromotedTile> tiles;
  CandidateCatalogue(options_.catalogue, CandidateCatalogue::Access::read)
      .each_promoted([&tiles](const PromotedTile& tile) { tiles.push_back(tile); });
  ASSERT_EQ(tiles.size(), 1U);
  EXPECT_EQ(tiles[0].sidecar.airframe, "mini-07");
  fs::create_directories(folder_ / "out");
  NoProgress progress;
  const auto images = write_promoted(tiles, PackStore(options_.data / "packs"), folder_ / "out", progress);
  ASSERT_EQ(images.size(), 1U);
  EXPECT_NEAR(images[0].ce90_m, 2.146 * 2.4, 1e-9);
}

TEST_F(Service, FlightsBeyondTheAllowedDisplacementDoNotPromote) {
  second_.options().off_px = 25;  // 10 m; 6.4 are allowed
  const auto keys = test::keys_in_a_row(2);
  upload(first_, candidates(first_, keys), 1);
  upload(second_, candidates(second_, keys), 2);
  EXPECT_EQ(service().counts().accepted, 4);
  EXPECT_EQ(service().counts().promoted, 0);
}

TEST_F(Service, TheSameBatchIsTheSameUpload) {
  const auto tiles = candidates(first_, test::keys_in_a_row(2));
  const SignedBatch batch = first_.batch(tiles);
  const Announcement one = announced(batch), again = announced(batch);
  EXPECT_TRUE(one.opened);
  EXPECT_FALSE(again.opened);
  EXPECT_EQ(one.upload, again.upload);
  EXPECT_EQ(again.missing.size(), 2U);
  ASSERT_TRUE(std::holds_alternative<PackOffset>(send(one.upload, test::pack_of(tiles))));
  EXPECT_EQ(announced(batch).known.size(), 2U);
  const SignedBatch other = first_.batch({tiles[0]});  // the same id, other contents
  const auto answer = announce(other);
  ASSERT_TRUE(std::holds_alternative<Denial>(answer));
  EXPECT_EQ(std::get<Denial>(answer).kind, Denial::Kind::key_reused);
}

TEST_F(Service, APackResumesAtAnyByteAfterARestart) {
  const auto tiles = candidates(first_, test::keys_in_a_row(2));
  const Bytes pack = test::pack_of(tiles);
  const std::string name = announced(first_.batch(tiles)).upload;
  std::uint64_t at = 0;
  for (const std::uint64_t bytes : {std::uint64_t{1}, std::uint64_t{47}, std::uint64_t{5'000}, ~std::uint64_t{0}}) {
    const auto sent = send(name, pack, at, bytes);
    ASSERT_TRUE(std::holds_alternative<PackOffset>(sent)) << std::get<Denial>(sent).detail;
    at = std::get<PackOffset>(sent).offset;
    const auto offset = restarted().offset(client_, name, sha256(pack));
    ASSERT_TRUE(std::holds_alternative<PackOffset>(offset));
    EXPECT_EQ(std::get<PackOffset>(offset).offset, at);
  }
  EXPECT_EQ(at, pack.size());
  const auto again = send(name, pack, 0, 10);
  ASSERT_TRUE(std::holds_alternative<Denial>(again)) << "it is already stored";
  EXPECT_EQ(std::get<Denial>(again).kind, Denial::Kind::offset_mismatch);
  EXPECT_EQ(std::get<Denial>(again).offset, pack.size());
}

TEST_F(Service, APackReceivedCompletelyBeforeAKillIsStored) {
  const auto tiles = candidates(first_, test::keys_in_a_row(2));
  const Bytes pack = test::pack_of(tiles);
  const std::string name = announced(first_.batch(tiles)).upload;
  // As if the process had been killed between the last byte and the catalogue.
  fs::create_directories(options_.data / "incoming" / name);
  write_file_atomic(options_.data / "incoming" / name / (sha256(pack).hex() + "." + std::to_string(pack.size())),
                    ByteView(pack));
  std::optional<std::int64_t> judge;
  const auto completed = restarted().complete(client_, name, judge);
  EXPECT_TRUE(std::holds_alternative<Completion>(completed));
  EXPECT_TRUE(judge);
  EXPECT_TRUE(fs::is_empty(options_.data / "incoming"));
}

TEST_F(Service, EvaluationContinuesAfterARestart) {
  const auto tiles = candidates(first_, test::keys_in_a_row(3));
  const std::string name = announced(first_.batch(tiles)).upload;
  send(name, test::pack_of(tiles));
  std::optional<std::int64_t> judge;
  ASSERT_TRUE(std::holds_alternative<Completion>(service().complete(client_, name, judge)));
  restarted();
  ASSERT_EQ(service().pending_evaluations().size(), 1U);
  judge_all();
  for (const TileRow& tile : verdicts(name)) EXPECT_EQ(tile.verdict, Verdict::accepted);
}

TEST_F(Service, UnknownPacksAreRemoved) {
  service();
  PackStore packs(options_.data / "packs");
  write_file_atomic(folder_ / "orphan", "orphan");
  packs.adopt(folder_ / "orphan", sha256(as_bytes("orphan")));
  restarted();
  EXPECT_TRUE(packs.packs().empty());
}

TEST_F(Service, CompleteListsMissingPacks) {
  const auto tiles = candidates(first_, test::keys_in_a_row(3));
  const std::string name = announced(first_.batch(tiles)).upload;
  send(name, test::pack_of({tiles[1]}));
  std::optional<std::int64_t> judge;
  const auto answer = service().complete(client_, name, judge);
  ASSERT_TRUE(std::holds_alternative<Denial>(answer));
  EXPECT_EQ(std::get<Denial>(answer).kind, Denial::Kind::incomplete);
  EXPECT_EQ(std::get<Denial>(answer).missing.size(), 2U);
  EXPECT_FALSE(judge);
}

TEST_F(Service, ABetterTileOfTheSameFlightStays) {
  const TileKey key = test::keys_in_a_row(1)[0];
  upload(first_, {first_.candidate(key)}, 1);
  first_.options().noise = 7;  // another frame
  first_.options().sigma_mm = 3'000;
  EXPECT_EQ(test::code_of(upload(first_, {first_.candidate(key)}, 2)[0]), "better_tile_exists");
  first_.options().sigma_mm = 500;
  first_.options().noise = 8;
  EXPECT_EQ(upload(first_, {first_.candidate(key)}, 3)[0].verdict, Verdict::accepted);
}

TEST_F(Service, ABadImageIsRejectedAndItsPackRemoved) {
  const cv::Mat grey(256, 256, CV_8UC3, cv::Scalar(90, 91, 92));
  const auto rows = upload(first_, {first_.candidate(test::keys_in_a_row(1)[0], grey)});
  EXPECT_EQ(test::code_of(rows[0]), "low_texture") << "whatever its sidecar says";
  EXPECT_TRUE(PackStore(options_.data / "packs").packs().empty());
}

TEST_F(Service, ADamagedPackDoesNotBlockOtherVotes) {
  const auto keys = test::keys_in_a_row(3);
  const std::vector<Candidate> one{first_.candidate(keys[0])};
  accepted(first_, one, 1);
  accepted(first_, {first_.candidate(keys[1]), first_.candidate(keys[2])}, 2);
  const std::string name = sha256(test::pack_of(one)).hex();
  const fs::path pack = options_.data / "packs" / name.substr(0, 2) / name, aside = folder_ / "aside";
  fs::rename(pack, aside);
  accepted(second_, candidates(second_, keys), 3);
  EXPECT_EQ(service().counts().promoted, 2);
  EXPECT_TRUE(service().vote_some());
  EXPECT_THROW(service().vote_some(), Error) << "it must be reported to the operator";
  EXPECT_EQ(service().counts().promoted, 2);
  EXPECT_EQ(service().counts().to_vote, 1);
  fs::rename(aside, pack);
  while (service().vote_some()) {
  }
  EXPECT_EQ(service().counts().promoted, 3);
}

class DamagedPack : public Service {
 protected:
  fs::path stored(const Bytes& pack) const {
    const std::string name = sha256(pack).hex();
    return options_.data / "packs" / name.substr(0, 2) / name;
  }
  // Each group of tiles in a pack of its own, complete and not evaluated. Returns the upload's name.
  std::string sent(const std::vector<std::vector<Candidate>>& groups, std::int64_t& id) {
    std::vector<Candidate> all;
    for (const auto& group : groups) all.insert(all.end(), group.begin(), group.end());
    const std::string name = announced(first_.batch(all)).upload;
    for (const auto& group : groups) {
      EXPECT_TRUE(std::holds_alternative<PackOffset>(send(name, test::pack_of(group))));
    }
    std::optional<std::int64_t> judge;
    service().complete(client_, name, judge);
    id = judge.value_or(0);
    return name;
  }
  static void damage(const fs::path& pack, std::uint64_t at) {
    Bytes bytes = read_file(pack);
    bytes.at(at) ^= 1;
    write_file_atomic(pack, ByteView(bytes));
  }
};

TEST_F(DamagedPack, IsRejectedAndCanBeSentAgain) {
  const auto tiles = candidates(first_, test::keys_in_a_row(3));
  const std::vector<Candidate> one{tiles[0]};
  std::int64_t id = 0;
  const std::string name = sent({one, {tiles[1], tiles[2]}}, id);
  damage(stored(test::pack_of(one)), kPackHeadSize + kPackEntrySize);
  EXPECT_THROW(service().evaluate_some(id), Error) << "it must be reported to the operator";
  const auto rows = verdicts(name);
  EXPECT_EQ(test::code_of(rows[0]), "hash_mismatch");
  EXPECT_EQ(rows[1].verdict, Verdict::accepted);
  EXPECT_EQ(rows[2].verdict, Verdict::accepted);
  EXPECT_TRUE(service().pending_evaluations().empty()) << "it is evaluated";
  const auto again = upload(first_, one, 2);  // the very pack that is damaged
  EXPECT_EQ(again[0].verdict, Verdict::accepted) << again[0].detail;
}

TEST_F(DamagedPack, LosesOnlyTheDamagedTile) {
  const auto tiles = candidates(first_, test::keys_in_a_row(3));
  std::int64_t id = 0;
  const std::string name = sent({tiles}, id);
  damage(stored(test::pack_of(tiles)), kPackHeadSize + 3 * kPackEntrySize + tiles[0].tile.size());
  EXPECT_THROW(service().evaluate_some(id), Error);
  const auto rows = verdicts(name);
  EXPECT_EQ(rows[0].verdict, Verdict::accepted);
  EXPECT_EQ(test::code_of(rows[1]), "hash_mismatch");
  EXPECT_EQ(rows[2].verdict, Verdict::accepted);
  const auto again = upload(first_, {tiles[1]}, 2);
  EXPECT_EQ(again[0].verdict, Verdict::accepted) << again[0].detail;
}

TEST_F(DamagedPack, AMissingPackIsAwaited) {
  const auto tiles = candidates(first_, test::keys_in_a_row(131));
  const std::vector<Candidate> many(tiles.begin(), tiles.end() - 2), few(tiles.end() - 2, tiles.end());
  std::int64_t id = 0;
  const std::string name = sent({many, few}, id);  // more than are judged at once
  const fs::path pack = stored(test::pack_of(many)), aside = folder_ / "aside";
  fs::rename(pack, aside);
  for (int round = 0; round < 2; ++round) {
    EXPECT_TRUE(service().evaluate_some(id));
    EXPECT_THROW(service().evaluate_some(id), Error);
    const auto rows = verdicts(name);
    EXPECT_FALSE(rows[0].verdict);
    EXPECT_FALSE(rows[128].verdict);
    EXPECT_EQ(rows[129].verdict, Verdict::accepted);
    EXPECT_EQ(rows[130].verdict, Verdict::accepted);
    EXPECT_EQ(service().pending_evaluations().size(), 1U);
  }
  fs::rename(aside, pack);
  judge_all();
  for (const TileRow& row : verdicts(name)) EXPECT_EQ(row.verdict, Verdict::accepted) << row.detail;
  EXPECT_TRUE(service().pending_evaluations().empty());
}

TEST_F(DamagedPack, IsKeptWhileAnotherUploadNeedsTheTile) {
  const auto tiles = candidates(first_, test::keys_in_a_row(1));
  std::int64_t id = 0;
  const std::string name = sent({tiles}, id);
  const Announcement other = announced(first_.batch(tiles, 2));
  EXPECT_EQ(other.known.size(), 1U);
  damage(stored(test::pack_of(tiles)), kPackHeadSize + kPackEntrySize);
  EXPECT_THROW(service().evaluate_some(id), Error);
  std::optional<std::int64_t> judge;
  ASSERT_TRUE(std::holds_alternative<Completion>(service().complete(client_, other.upload, judge)));
  EXPECT_THROW(service().evaluate_some(*judge), Error);
  EXPECT_EQ(test::code_of(verdicts(other.upload)[0]), "hash_mismatch");
  EXPECT_EQ(upload(first_, tiles, 3)[0].verdict, Verdict::accepted);
}

TEST_F(Service, AbandonedPacksMakeRoomForOthers) {
  options_.packs.packs_at_once = 2;
  const auto tiles = candidates(first_, test::keys_in_a_row(4));
  const std::string name = announced(first_.batch(tiles)).upload;
  const auto begin = [&](std::size_t tile) { return send(name, test::pack_of({tiles[tile]}), 0, 100); };
  const auto advance = [this](std::int64_t seconds) { clock_ = FixedClock({clock_.now().unix_s + seconds}); };
  EXPECT_TRUE(std::holds_alternative<PackOffset>(begin(0)));
  advance(200);
  EXPECT_TRUE(std::holds_alternative<PackOffset>(begin(1)));
  advance(99);
  ASSERT_TRUE(std::holds_alternative<Denial>(begin(2))) << "both have grown lately";
  EXPECT_EQ(std::get<Denial>(begin(2)).kind, Denial::Kind::too_many);
  advance(1);
  EXPECT_TRUE(std::holds_alternative<PackOffset>(begin(2))) << "the first has been idle for 300 s";
  const auto first = service().offset(client_, name, sha256(test::pack_of({tiles[0]})));
  ASSERT_TRUE(std::holds_alternative<Denial>(first));
  EXPECT_EQ(std::get<Denial>(first).kind, Denial::Kind::pack_unknown);
  const auto second = service().offset(client_, name, sha256(test::pack_of({tiles[1]})));
  EXPECT_EQ(std::get<PackOffset>(second).offset, 100U);
  EXPECT_TRUE(std::holds_alternative<Denial>(begin(3)));
  advance(7 * 24 * 3600);  // and the upload itself is forgotten, as ever
  EXPECT_TRUE(std::holds_alternative<Denial>(service().status(client_, name)));
}

TEST_F(Service, AnUploadThatIsNotCompleteExpires) {
  options_.upload_life_ms = -1;
  const auto tiles = candidates(first_, test::keys_in_a_row(1));
  const Announcement one = announced(first_.batch(tiles));
  EXPECT_TRUE(std::holds_alternative<Denial>(service().status(client_, one.upload)));
  const Announcement next = announced(first_.batch(tiles));
  EXPECT_TRUE(next.opened);
  EXPECT_NE(next.upload, one.upload);
}

TEST_F(Service, AFullDiskAcceptsNothing) {
  options_.packs.keep_free_bytes = ~std::uint64_t{0} / 2;
  const auto answer = announce(first_.batch(candidates(first_, test::keys_in_a_row(1))));
  ASSERT_TRUE(std::holds_alternative<Denial>(answer));
  EXPECT_EQ(std::get<Denial>(answer).kind, Denial::Kind::storage_full);
  EXPECT_TRUE(service().fault().fails);
}

TEST_F(Service, ReportsALostCatalogueAndReconnects) {
  const auto tiles = candidates(first_, test::keys_in_a_row(1));
  const std::string name = announced(first_.batch(tiles)).upload;
  const fs::path file = options_.data / "catalogue.sqlite", aside = options_.data / "aside.sqlite";
  service_.reset();
  service();
  fs::rename(file, aside);
  std::ofstream(file)
      << "this is no database, but it is longer than a header of one hundred bytes would be, to be sure of it";
  service_.reset();
  EXPECT_THROW(service(), Error);
  fs::rename(aside, file);
  EXPECT_EQ(std::get<UploadStatus>(service().status(client_, name)).tiles.size(), 1U);
  EXPECT_FALSE(service().fault().fails);
}

// Tiles that are displaced from their stated position, by comparison with the base package's map and with other
// flights; and tiles nearly as far off, which pass. The map's ground is that of the flights, seen by another sensor on
// another day.

constexpr std::int64_t kMapCe90_mm = 4'000;  // a sigma of 1.86 m

class Misaligned : public test::ServiceFixture {
 protected:
  void SetUp() override {
    ServiceFixture::SetUp();
    test::PackageMaker maker;
    write_file_atomic(folder_ / "signer.key.pem", signer_.pem(), 0600);
    maker.signer = PrivateKey::read(folder_ / "signer.key.pem");
    const test::FlightMaker satellite({.noise = 77});
    maker.edit_tile = [&](Sidecar& sidecar, Bytes& tile) {
      tile = encode_image(satellite.picture(sidecar.key), ImageFormat::jpeg, 75);
      sidecar.ce90_mm = kMapCe90_mm;
      return true;
    };
    const auto package = maker.make(folder_);
    options_.packages = {package};
    package_ = package;
    manifest_ = sha256_file(package / kManifestFile);
    key_ = required_tiles(parse_mission(maker.mission, "mission").mission.value(), 18).front();
    const LonLatBox box = bounds_of(key_);
    pixel_m_ = ground_resolution_m(key_.z, (box.south_deg + box.north_deg) / 2);
  }

  TileRow judged(double off_m, std::int64_t sigma_mm, std::uint64_t ground = 1) {
    test::FlightOptions& options = first_.options();
    options.off_px = off_m / pixel_m_, options.ground = ground;
    options.sigma_mm = sigma_mm, options.base_package = manifest_;
    return upload(first_, {first_.candidate(key_)}).front();
  }

  std::string refusal() {
    try {
      service();
    } catch (const Error& error) {
      return error.what();
    }
    return {};
  }

  std::filesystem::path package_;
  Sha256 manifest_;
  TileKey key_;
  double pixel_m_ = 0;
};

// A map that decides which tiles are in the right place must be signed by the root's signers. Its mission has expired
// long ago: its flights are over.
TEST_F(Misaligned, AnUnsignedBasePackageIsRejected) {
  EXPECT_EQ(refusal(), "");
  service_.reset();
  const auto envelope = read_text_file(package_ / kSignatureFile);
  std::filesystem::remove(package_ / kSignatureFile);
  EXPECT_NE(refusal().find("cannot be trusted: signature.missing"), std::string::npos) << refusal();
  test::PackageMaker untrusted;
  untrusted.sign(package_);
  EXPECT_NE(refusal().find("cannot be trusted: key.unknown"), std::string::npos) << refusal();
  write_file_atomic(package_ / kSignatureFile, envelope);
  EXPECT_EQ(refusal(), "");
}

TEST_F(Misaligned, AModifiedBasePackageIsRejected) {
  std::filesystem::resize_file(package_ / kImageryFile, std::filesystem::file_size(package_ / kImageryFile) + 4096);
  EXPECT_NE(refusal().find("cannot be trusted: artifact.size"), std::string::npos) << refusal();
  folder_.write("package/manifest.json", "{}");
  EXPECT_NE(refusal().find("cannot be trusted: signature.invalid"), std::string::npos) << refusal();
  std::filesystem::remove_all(package_);
  EXPECT_NE(refusal(), "");
}

// 3 sigma of both: 3 · hypot(1.5, 1.86) = 7.2 m.
TEST_F(Misaligned, ATileDisplacedFromTheMapIsRejected) {
  const TileRow tile = judged(8, 1'500);
  EXPECT_EQ(test::code_of(tile), "misaligned");
  EXPECT_NE(tile.detail.find("off the base package's map; at most 717"), std::string::npos) << tile.detail;
}

TEST_F(Misaligned, ADisplacementJustBelowTheLimitIsAccepted) {
  const TileRow tile = judged(6.4, 1'500);
  EXPECT_EQ(tile.verdict, Verdict::accepted) << test::code_of(tile) << " " << tile.detail;
}

// 3 · hypot(0.3, 1.86) = 5.7 m: a smaller stated sigma means a stricter limit.
TEST_F(Misaligned, AMoreCertainTileHasAStricterLimit) { EXPECT_EQ(test::code_of(judged(6.4, 300)), "misaligned"); }

// Other ground does not correlate: it has changed, or it is another place; the map does not show which; other flights
// do.
TEST_F(Misaligned, ChangedGroundIsNotMisaligned) { EXPECT_EQ(judged(8, 1'500, 5).verdict, Verdict::accepted); }

TEST_F(Misaligned, WithoutAMapTileAlignmentIsUnknown) {
  key_.x += 40;
  EXPECT_EQ(judged(8, 1'500).verdict, Verdict::accepted);
}

// Between flights, 3 · hypot(1.5, 1.5) = 6.4 m: none is rejected, but only those that agree are promoted.
TEST_F(Misaligned, FlightsAgreeOnlyWithinTheAllowedDisplacement) {
  options_.packages.clear();
  const auto promoted = [this](double off_m, std::uint32_t row) {
    const auto keys = test::keys_in_a_row(1, row);
    second_.options().off_px = off_m / ground_resolution_m(18, 47.3);
    EXPECT_EQ(upload(first_, candidates(first_, keys), static_cast<int>(2 * row)).front().verdict, Verdict::accepted);
    EXPECT_EQ(upload(second_, candidates(second_, keys), static_cast<int>(2 * row + 1)).front().verdict,
              Verdict::accepted);
    return service().counts().promoted;
  };
  EXPECT_EQ(promoted(7.2, 1), 0);
  EXPECT_EQ(promoted(5.6, 2), 1);
}

}  // namespace
}  // namespace nadir
