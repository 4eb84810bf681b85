// Attacks of a hostile sender, by name, and their results.
#include <nlohmann/json.hpp>

#include "candidates/service_fixture.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using Kind = Denial::Kind;

class Attack : public test::ServiceFixture {
 protected:
  // Every tile of the batch is refused with this code, and no byte of them is taken.
  void all_refused(const SignedBatch& batch, std::string_view code) {
    const Announcement announcement = announced(batch);
    EXPECT_TRUE(announcement.missing.empty());
    EXPECT_EQ(announcement.refused.size(), batch.batch.tiles.size());
    for (const auto& [sha256, refusal] : announcement.refused) EXPECT_EQ(name_of(refusal.code), code) << refusal.detail;
  }
  template <typename Result>
  void denied(const Answer<Result>& answer, Kind kind) {
    ASSERT_TRUE(std::holds_alternative<Denial>(answer));
    EXPECT_EQ(std::get<Denial>(answer).kind, kind) << std::get<Denial>(answer).detail;
  }
  Sha256 any_ = sha256(as_bytes("any"));
};

TEST_F(Attack, ReplayedBatchGainsNothing) {
  const auto tiles = candidates(first_, test::keys_in_a_row(2));
  upload(first_, tiles, 1);
  upload(first_, tiles, 1);  // word for word
  EXPECT_EQ(service().counts().accepted, 2);
  EXPECT_EQ(service().counts().uploads, 1);
  // The same tiles in a new batch of the same airframe.
  for (const TileRow& tile : upload(first_, tiles, 2)) EXPECT_EQ(tile.verdict, Verdict::duplicate);
  // By another client, which has intercepted it: a separate upload, and again no second vote.
  client_.name = "eavesdropper";
  const Announcement theirs = announced(first_.batch(tiles, 1));
  EXPECT_EQ(theirs.known.size(), 2U);
  EXPECT_EQ(service().counts().accepted, 2);
  EXPECT_EQ(service().counts().promoted, 0);
}

TEST_F(Attack, SwappedSidecarIsRejected) {
  auto tiles = candidates(first_, test::keys_in_a_row(2));
  std::swap(tiles[0].signature, tiles[1].signature);
  all_refused(first_.batch(tiles), "batch_signature");
}

TEST_F(Attack, SwappedTileIsRejectedWithItsPack) {
  const auto tiles = candidates(first_, test::keys_in_a_row(2));
  const std::string name = announced(first_.batch(tiles)).upload;
  auto swapped = tiles;
  swapped[0].tile = first_.candidate(test::keys_in_a_row(3)[2]).tile;
  denied(send(name, test::pack_of(swapped)), Kind::pack_invalid);
  denied(service().offset(client_, name, sha256(test::pack_of(swapped))), Kind::pack_unknown);
}

TEST_F(Attack, UnannouncedTileIsRejectedWithItsPack) {
  const auto tiles = candidates(first_, test::keys_in_a_row(3));
  const std::string name = announced(first_.batch({tiles[0]})).upload;
  denied(send(name, test::pack_of({tiles[0], tiles[1]})), Kind::pack_invalid);
}

TEST_F(Attack, ForgedAirframeIsRejected) {
  test::FlightMaker untrusted{{.airframe = "mini-07"}};  // our name, another key
  all_refused(untrusted.batch(candidates(untrusted, test::keys_in_a_row(2)), 1), "batch_signature");
  test::FlightMaker unknown{{.airframe = "mini-99"}};
  all_refused(unknown.batch(candidates(unknown, test::keys_in_a_row(2)), 2), "batch_signature");
  // A key that is ours, but another airframe's.
  test::FlightMaker other{{.airframe = "mini-07"}, PrivateKey::generate()};
  const auto tiles = candidates(second_, test::keys_in_a_row(1));
  SignedBatch batch = second_.batch(tiles, 3);
  batch.batch.airframe = "mini-07";
  EXPECT_ANY_THROW(sign_batch(batch.batch, second_.key())) << "a batch's tiles are its airframe's";
}

TEST_F(Attack, TilesOfAnotherAirframeAreRejected) {
  // mini-08 sends tiles in mini-07's name, with its own signature.
  test::FlightMaker impostor{{.airframe = "mini-07"}, PrivateKey::generate()};
  write_file_atomic(folder_ / "root.json", test::root_text({&first_, &second_}, signer_));
  all_refused(impostor.batch(candidates(impostor, test::keys_in_a_row(1))), "batch_signature");
}

TEST_F(Attack, RevokedKeyIsRejectedImmediately) {
  upload(first_, candidates(first_, test::keys_in_a_row(1)), 1);
  write_root(2, {first_.key().public_key().id()});
  all_refused(first_.batch(candidates(first_, test::keys_in_a_row(2, 1)), 2), "airframe_revoked");
  for (const TileRow& tile : upload(second_, candidates(second_, test::keys_in_a_row(1)), 3)) {
    EXPECT_EQ(tile.verdict, Verdict::accepted);
  }
  // As nadir keys revoke leaves the root: without the airframe, whose only key it was.
  write_file_atomic(folder_ / "root.json", test::root_text({&second_}, signer_, 3, {first_.key().public_key().id()}));
  all_refused(first_.batch(candidates(first_, test::keys_in_a_row(2, 2)), 4), "airframe_revoked");
}

TEST_F(Attack, RevokedKeyBetweenAnnouncementAndVerdictIsRejected) {
  const auto tiles = candidates(first_, test::keys_in_a_row(2));
  const std::string name = announced(first_.batch(tiles)).upload;
  ASSERT_TRUE(std::holds_alternative<PackOffset>(send(name, test::pack_of(tiles))));
  write_root(2, {first_.key().public_key().id()});
  std::optional<std::int64_t> judge;
  ASSERT_TRUE(std::holds_alternative<Completion>(service().complete(client_, name, judge)));
  judge_all();
  for (const TileRow& tile : verdicts(name)) EXPECT_EQ(test::code_of(tile), "airframe_revoked");
}

TEST_F(Attack, RevokedKeyInvalidatesItsVotes) {
  test::FlightMaker third{{.airframe = "mini-09", .flight = "flight-3", .noise = 3}};
  const auto root = [&](std::int64_t version, const std::set<std::string>& revoked) {
    write_file_atomic(folder_ / "root.json", test::root_text({&first_, &second_, &third}, signer_, version, revoked));
  };
  root(1, {});
  first_.options().sigma_mm = 600;  // the best: it is what is promoted
  const auto keys = test::keys_in_a_row(3);
  const std::vector<TileKey> two{keys[0], keys[1]}, one{keys[0]};
  upload(first_, candidates(first_, keys), 1);
  upload(second_, candidates(second_, two), 2);
  upload(third, candidates(third, one), 3);
  ASSERT_EQ(service().counts().promoted, 2);

  root(2, {first_.key().public_key().id()});
  EXPECT_EQ(service().apply_revocations(), 3);
  EXPECT_EQ(service().counts().promoted, 0) << "its own, and those that it had voted on";
  judge_all();
  EXPECT_EQ(service().counts().promoted, 1) << "two others agree about one place";
  EXPECT_EQ(service().counts().rejected_by,
            (std::vector<std::pair<std::string, std::int64_t>>{{"airframe_revoked", 3}}));
  EXPECT_EQ(service().apply_revocations(), 0);
  service_.reset();
  {
    CandidateCatalogue catalogue(options_.catalogue, CandidateCatalogue::Access::read);
    catalogue.each_promoted([](const PromotedTile& tile) { EXPECT_NE(tile.sidecar.airframe, "mini-07"); });
  }
  // Revoked while the service was away.
  root(3, {first_.key().public_key().id(), second_.key().public_key().id()});
  EXPECT_EQ(restarted().counts().promoted, 0);
}

TEST_F(Attack, RevokedKeyDuringAVotePromotesNothing) {
  const std::vector<TileKey> keys = test::keys_in_a_row(1);
  accepted(first_, candidates(first_, keys), 1);
  const std::int64_t upload = complete(second_, candidates(second_, keys), 2);
  service_.reset();
  CandidateCatalogue catalogue(options_.catalogue, CandidateCatalogue::Access::write);
  const AddressWork::Claim claim = catalogue.work().claim_tiles(upload, 10);
  ASSERT_EQ(claim.addresses.size(), 1U);
  const AddressTask& task = claim.addresses[0];
  ASSERT_EQ(task.waiting.size(), 1U);
  ASSERT_EQ(task.standing.candidates.size(), 1U);
  const std::int64_t other = task.standing.candidates[0].tile;
  ASSERT_EQ(catalogue.work().withdraw({first_.key().public_key().id()}), 1);
  AddressResult both{.key = keys[0], .standing = {other}};
  both.judged.push_back({.verdict = {.tile = task.waiting[0].id}, .keyid = task.waiting[0].keyid});
  both.outcome =
      Outcome{.new_votes = {}, .promotion = Promotion{.tile = other, .key = keys[0], .flights = 2, .evidence = "{}"}};
  ASSERT_TRUE(catalogue.work().write(claim, {&both, 1}, 1, {}));
  EXPECT_EQ(catalogue.counts().promoted, 0);
  EXPECT_EQ(catalogue.counts().to_vote, 1) << "the other one is voted on again, alone";
}

TEST_F(Attack, WrongTokenCannotUploadForAnAirframe) {
  client_.airframes = {"mini-08"};
  denied(announce(first_.batch(candidates(first_, test::keys_in_a_row(1)))), Kind::forbidden);
}

TEST_F(Attack, UploadOfAnotherClientIsInaccessible) {
  const auto tiles = candidates(first_, test::keys_in_a_row(1));
  const std::string name = announced(first_.batch(tiles)).upload;
  client_.name = "ground-2";
  denied(service().status(client_, name), Kind::forbidden);
  denied(send(name, test::pack_of(tiles)), Kind::forbidden);
  std::optional<std::int64_t> judge;
  denied(service().complete(client_, name, judge), Kind::forbidden);
}

TEST_F(Attack, PathTricksInNamesAreNotFound) {
  announced(first_.batch(candidates(first_, test::keys_in_a_row(1))));
  for (const char* name : {"..", "../../etc/passwd", "/etc/passwd", "", "%2e%2e", "a' OR '1'='1", "....//", "0"}) {
    denied(service().status(client_, name), Kind::not_found);
    denied(service().offset(client_, name, any_), Kind::not_found);
    denied(send(name, as_bytes("x")), Kind::not_found);
  }
  for (const char* key : {"", "../../x", "0F8B4A52-6C1E-4D0B-9A7E-3B5C2D1E0F9A", "' OR 1=1 --"}) {
    denied(service().announce(client_, key, "{}"), Kind::malformed);
  }
}

TEST_F(Attack, NamesWithQuotesStayText) {
  // Free text goes to the database as a bound value, never as part of a statement.
  client_.name = "ground'); DROP TABLE tiles; --";
  const auto tiles = candidates(first_, test::keys_in_a_row(1));
  EXPECT_EQ(upload(first_, tiles)[0].verdict, Verdict::accepted);
}

TEST_F(Attack, OversizedPackIsRejectedBeforeTransfer) {
  const auto tiles = candidates(first_, test::keys_in_a_row(1));
  const std::string name = announced(first_.batch(tiles)).upload;
  const Bytes part(100, 1);
  denied(service().append(client_, name, any_, {.offset = 0, .length = kMaxPackSize + 1, .digest = sha256(part)}, part),
         Kind::too_large);
  denied(service().append(client_, name, any_, {.offset = 0, .length = 50, .digest = sha256(part)}, part),
         Kind::too_large);
  EXPECT_TRUE(fs::is_empty(options_.data / "incoming") || IncomingPacks(options_.data / "incoming").of(name).empty());
}

TEST_F(Attack, PackWithAFalseTileCountIsRejected) {
  // A bomb: a short pack whose list announces gigabytes.
  const auto tiles = candidates(first_, test::keys_in_a_row(1));
  const std::string name = announced(first_.batch(tiles)).upload;
  Bytes bomb = test::pack_of(tiles);
  std::fill_n(bomb.begin() + 8, 4, std::uint8_t{0xff});  // 4 billion tiles
  denied(send(name, bomb), Kind::pack_invalid);
  Bytes large = test::pack_of(tiles);
  std::fill_n(large.begin() + 12 + 32, 4, std::uint8_t{0xff});  // of 4 GB
  denied(send(name, large), Kind::pack_invalid);
  denied(send(name, Bytes(100, 0x1f)), Kind::pack_invalid);
}

TEST_F(Attack, FalseSizesAreRejected) {
  // The sidecar states another size than the tile has.
  const Candidate oversized =
      first_.candidate(test::keys_in_a_row(1)[0], [](CandidateSidecar& sidecar) { sidecar.size += 1; });
  const std::string name = announced(first_.batch({oversized})).upload;
  denied(send(name, test::pack_of({oversized})), Kind::pack_invalid);
  // The pack states another length than it has: its end never comes, or more follows.
  const Bytes pack = test::pack_of({oversized});
  const auto sent = service().append(client_, name, sha256(pack),
                                     {.offset = 0, .length = pack.size() + 10, .digest = sha256(pack)}, pack);
  ASSERT_TRUE(std::holds_alternative<PackOffset>(sent));
  const Bytes more(10, 0);
  denied(service().append(client_, name, sha256(pack), {.offset = pack.size(), .digest = sha256(more)}, more),
         Kind::pack_invalid);
}

TEST_F(Attack, PartWithAWrongDigestIsDiscarded) {
  const auto tiles = candidates(first_, test::keys_in_a_row(1));
  const std::string name = announced(first_.batch(tiles)).upload;
  const Bytes pack = test::pack_of(tiles);
  denied(service().append(client_, name, sha256(pack), {.offset = 0, .length = pack.size(), .digest = any_}, pack),
         Kind::digest_mismatch);
  denied(service().offset(client_, name, sha256(pack)), Kind::pack_unknown);
}

TEST_F(Attack, HoardingUnfinishedPacksIsBounded) {
  const auto tiles = candidates(first_, test::keys_in_a_row(1));
  const std::string name = announced(first_.batch(tiles)).upload;
  const Bytes part(10, 1);
  for (std::uint8_t i = 0; i < options_.packs.packs_at_once; ++i) {
    const auto sent = service().append(client_, name, sha256(Bytes{i}),
                                       {.offset = 0, .length = kMaxPackSize, .digest = sha256(part)}, part);
    EXPECT_TRUE(std::holds_alternative<PackOffset>(sent));
  }
  denied(service().append(client_, name, any_, {.offset = 0, .length = kMaxPackSize, .digest = sha256(part)}, part),
         Kind::too_many);
}

TEST_F(Attack, ManipulatedTimesAreRejected) {
  first_.options().captured_at = {clock_.now().unix_s + test::kDay_s};
  all_refused(first_.batch(candidates(first_, test::keys_in_a_row(1)), 1), "captured_in_future");
  first_.options().captured_at = {clock_.now().unix_s - 91 * test::kDay_s};
  all_refused(first_.batch(candidates(first_, test::keys_in_a_row(1)), 2), "too_old");
}

TEST_F(Attack, QuotaLimitsAnAirframe) {
  const auto tiles = candidates(first_, test::keys_in_a_row(3));
  std::int64_t bytes = std::ssize(tiles) * options_.rules.catalogue_bytes;
  for (const Candidate& tile : tiles) bytes += static_cast<std::int64_t>(tile.sidecar.size);
  options_.rules.quota_bytes = bytes;
  upload(first_, tiles, 1);
  all_refused(first_.batch(candidates(first_, test::keys_in_a_row(1, 1)), 2), "quota");
  EXPECT_FALSE(announced(second_.batch(candidates(second_, test::keys_in_a_row(1)), 3)).missing.empty())
      << "others may";
}

// Rows take space as well: those of tiles with false small sizes, and of rejected batches.
TEST_F(Attack, RejectedBatchesDoNotFillTheDisk) {
  options_.rules.refused_batches = 2;
  const test::FlightMaker untrusted{{.airframe = "mini-07", .flight = "flight-9"}};  // another key
  for (const int number : {1, 2, 2, 1})
    all_refused(untrusted.batch(candidates(untrusted, test::keys_in_a_row(2)), number), "batch_signature");
  denied(announce(untrusted.batch(candidates(untrusted, test::keys_in_a_row(2)), 3)), Kind::too_many);
  EXPECT_EQ(service().counts().tiles, 4);
  EXPECT_EQ(upload(first_, candidates(first_, test::keys_in_a_row(1)), 4)[0].verdict, Verdict::accepted);
  client_.name = "ground-2";
  all_refused(untrusted.batch(candidates(untrusted, test::keys_in_a_row(2)), 5), "batch_signature");
}

TEST_F(Attack, OneAirframeAloneCannotPromoteOnOneDay) {
  const auto keys = test::keys_in_a_row(2);
  for (int flight = 1; flight <= 4; ++flight) {
    first_.options().flight = "flight-" + std::to_string(flight);
    first_.options().noise = static_cast<std::uint64_t>(flight);
    upload(first_, candidates(first_, keys), flight);
  }
  EXPECT_EQ(service().counts().accepted, 8);
  EXPECT_EQ(service().counts().promoted, 0);
}

TEST_F(Attack, CopiedImageIsNotASecondVote) {
  // Another airframe sends the very bytes that the first one made, under its own name.
  const Candidate original = first_.candidate(test::keys_in_a_row(1)[0]);
  upload(first_, {original}, 1);
  Candidate stolen = original;
  stolen.sidecar.airframe = "mini-08";
  stolen.sidecar.flight = "flight-2";
  stolen.sidecar_bytes = candidate_json(stolen.sidecar);
  stolen.signature = sign_candidate(second_.key(), stolen.sidecar_bytes);
  EXPECT_EQ(upload(second_, {stolen}, 2)[0].verdict, Verdict::duplicate);
  EXPECT_EQ(service().counts().promoted, 0);
}

TEST_F(Attack, InvalidDocumentsAreRejected) {
  const std::string key = "0f8b4a52-6c1e-4d0b-9a7e-3b5c2d1e0f9a";
  denied(service().announce(client_, key, ""), Kind::malformed);
  denied(service().announce(client_, key, "{\"a\":1,\"a\":2}"), Kind::malformed);
  denied(service().announce(client_, key, std::string(100'000, '[')), Kind::malformed);
  denied(service().announce(client_, key, "{\"signed\":1.5}"), Kind::batch_invalid);
  denied(service().announce(client_, key, "{}"), Kind::batch_invalid);
  denied(service().announce(client_, key, "null"), Kind::batch_invalid);
  const SignedBatch batch = first_.batch(candidates(first_, test::keys_in_a_row(1)));
  denied(service().announce(client_, key, batch.json()), Kind::batch_invalid);  // another batch's id
}

}  // namespace
}  // namespace nadir
