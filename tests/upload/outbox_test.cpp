#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <fstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "upload/batch.hpp"
#include "upload/outbox.hpp"
#include "upload/outbox_fixture.hpp"
#include "upload/outbox_upkeep.hpp"
#include "upload/pack.hpp"

namespace nadir {
namespace {

using test::OutboxFixture;

class Outbox : public OutboxFixture {};

TEST_F(Outbox, StagesACandidateOnce) {
  EXPECT_EQ(stage(3), 3);
  EXPECT_EQ(stage(5), 2);
  EXPECT_EQ(tiles_in(TileState::staged), 5);
}

TEST_F(Outbox, SealsSignedBatchesOfOneFlightEach) {
  stage(3);
  std::vector<Candidate> other{candidate(7)};
  other[0].sidecar.flight = "another";
  other[0].sidecar_bytes = candidate_json(other[0].sidecar);
  stage_candidates(*outbox_, other, 1);
  const SealedSum sum = seal();
  EXPECT_EQ(sum.batches, 2);
  EXPECT_EQ(sum.tiles, 4);
  const SignedBatch batch = parse_batch(transfer_.document(*transfer_.next_batch(0)), "test");
  EXPECT_EQ(batch.batch.tiles.size(), 3U);
  EXPECT_EQ(batch.batch.id, transfer_.next_batch(0)->uuid);
  EXPECT_EQ(seal().batches, 0) << "nothing is left";
}

// The same bytes at two places: an upload knows tiles by their digest, so they go in two batches.
TEST_F(Outbox, ABatchContainsEachDigestOnce) {
  std::vector<Candidate> twice{candidate(1), candidate(1)};
  twice[1].sidecar.key.x += 1;
  twice[1].sidecar_bytes = candidate_json(twice[1].sidecar);
  EXPECT_EQ(stage_candidates(*outbox_, twice, 1), 2);
  EXPECT_EQ(seal().batches, 2);
}

TEST_F(Outbox, RepliesAdvanceTilesAndCreateReadablePacks) {
  stage(4);
  seal();
  const OpenBatch batch = *transfer_.next_batch(0);
  transfer_.announced(batch, answer({0, 1}, {2}, {3}), 5);
  EXPECT_EQ(tiles_in(TileState::announced), 2);
  EXPECT_EQ(tiles_in(TileState::sent), 1);
  EXPECT_EQ(tiles_in(TileState::refused), 1);
  const OpenPack pack = *transfer_.next_pack(*transfer_.next_batch(0));
  const Bytes bytes = transfer_.pack_bytes(pack);
  EXPECT_EQ(bytes.size(), pack.size);
  EXPECT_EQ(sha256(bytes), pack.sha256);
  std::vector<Sha256> seen;
  PackReader reader(
      bytes.size(), [](const PackEntry&) { return true; },
      [&](const PackEntry& entry, ByteView) { seen.push_back(entry.sha256); });
  reader.feed(bytes);
  reader.finish();
  EXPECT_EQ(seen, (std::vector<Sha256>{candidate(0).sidecar.sha256, candidate(1).sidecar.sha256}));

  transfer_.pack_begins(pack, 6);
  EXPECT_EQ(tiles_in(TileState::sending), 2);
  transfer_.recover(7);
  EXPECT_EQ(tiles_in(TileState::waiting), 2);
  EXPECT_TRUE(transfer_.next_pack(batch)->begun);
  transfer_.pack_begins(pack, 8);
  EXPECT_EQ(transfer_.pack_sent(pack, 9), 2);
  EXPECT_EQ(tiles_in(TileState::sent), 3);
  EXPECT_FALSE(transfer_.next_pack(batch));
}

TEST_F(Outbox, RepliesAboutOtherTilesChangeNothing) {
  stage(3);
  seal();
  const OpenBatch batch = *transfer_.next_batch(0);
  AnnouncementReply foreign = answer({0, 1, 2}, {}, {});
  foreign.missing.push_back(candidate(9).sidecar.sha256);
  for (const AnnouncementReply& wrong :
       {answer({0, 1}, {}, {}), answer({0, 1, 2}, {2}, {}), answer({0, 1, 2, 2}, {}, {}), foreign}) {
    EXPECT_THROW(transfer_.announced(batch, wrong, 5), WrongAnswer);
    EXPECT_EQ(tiles_in(TileState::sealed), 3);
    EXPECT_FALSE(transfer_.next_pack(batch));
  }
}

TEST_F(Outbox, VerdictsAreFinal) {
  stage(4);
  seal();
  transfer_.announced(*transfer_.next_batch(0), answer({}, {0, 1, 2, 3}, {}), 5);
  const OpenBatch batch = *transfer_.next_batch(0);
  transfer_.completed(batch);
  StatusReply status = verdicts(batch, {VerdictReply::Kind::accepted, VerdictReply::Kind::rejected,
                                        VerdictReply::Kind::pending, VerdictReply::Kind::duplicate});
  VerdictSum sum = transfer_.verdicts(batch, status, 6);
  EXPECT_EQ(sum.pending, 1);
  EXPECT_EQ(tiles_in(TileState::accepted), 1);
  // A verdict is final, whatever the service says later; what was pending gets its verdict.
  status = verdicts(batch, {VerdictReply::Kind::rejected, VerdictReply::Kind::accepted, VerdictReply::Kind::accepted,
                            VerdictReply::Kind::accepted});
  sum = transfer_.verdicts(batch, status, 7);
  EXPECT_EQ(sum.pending, 0);
  EXPECT_EQ(tiles_in(TileState::accepted), 2);
  EXPECT_EQ(tiles_in(TileState::rejected), 1);
  EXPECT_EQ(tiles_in(TileState::duplicate), 1);
  EXPECT_FALSE(transfer_.next_batch(0)) << "nothing is open";
  status.tiles.pop_back();
  EXPECT_NO_THROW(transfer_.verdicts(batch, status, 8)) << "nothing was awaited";
  status.batch = "another";
  EXPECT_THROW(transfer_.verdicts(batch, status, 8), WrongAnswer);
}

TEST_F(Outbox, AnExpiredUploadRestartsWithoutTilesThatHaveVerdicts) {
  stage(4);
  seal();
  transfer_.announced(*transfer_.next_batch(0), answer({0, 1}, {2}, {3}), 5);
  OpenBatch batch = *transfer_.next_batch(0);
  transfer_.pack_begins(*transfer_.next_pack(batch), 6);
  transfer_.forgotten(batch, 7);
  EXPECT_EQ(tiles_in(TileState::sealed), 3);
  EXPECT_EQ(tiles_in(TileState::refused), 1);
  batch = *transfer_.next_batch(0);
  EXPECT_EQ(batch.stage, BatchStage::sealed);
  transfer_.announced(batch, answer({1, 2}, {0}, {3}), 8);
  EXPECT_EQ(tiles_in(TileState::announced), 2);
  EXPECT_EQ(tiles_in(TileState::sent), 1);
  EXPECT_FALSE(transfer_.next_pack(batch)->begun);
}

// For example, it was restored from an older copy: it no longer knows tiles that it has evaluated.
TEST_F(Outbox, ResendsTilesThatTheServiceHasLost) {
  stage(3);
  seal();
  transfer_.announced(*transfer_.next_batch(0), answer({}, {0, 1, 2}, {}), 5);
  transfer_.completed(*transfer_.next_batch(0));
  OpenBatch batch = *transfer_.next_batch(0);
  using enum VerdictReply::Kind;
  transfer_.verdicts(batch, verdicts(batch, {accepted, pending, pending}), 6);
  transfer_.forgotten(batch, 7);
  transfer_.announced(*transfer_.next_batch(0), answer({0, 1, 2}, {}, {}), 8);
  batch = *transfer_.next_batch(0);
  const OpenPack pack = *transfer_.next_pack(batch);
  const Bytes bytes = transfer_.pack_bytes(pack);
  EXPECT_EQ(as_text(ByteView(bytes).subspan(8, 4)), std::string_view("\0\0\0\3", 4)) << "all three";
  transfer_.pack_begins(pack, 9);
  EXPECT_EQ(tiles_in(TileState::sending), 2);
  transfer_.pack_waits(pack, 10);
  transfer_.pack_begins(pack, 11);
  EXPECT_EQ(transfer_.pack_sent(pack, 12), 2);
  transfer_.completed(batch);
  batch = *transfer_.next_batch(0);
  transfer_.verdicts(batch, verdicts(batch, {pending, accepted, rejected}), 13);
  EXPECT_EQ(tiles_in(TileState::accepted), 2);
  EXPECT_EQ(tiles_in(TileState::rejected), 1);
  EXPECT_FALSE(transfer_.next_batch(0)) << "whatever becomes of the first one now, it has had its verdict";
}

TEST_F(Outbox, ParkedTilesWaitForTheOperator) {
  stage(2);
  seal();
  EXPECT_EQ(transfer_.park(*transfer_.next_batch(0), "422 no", 5), 2);
  EXPECT_FALSE(transfer_.next_batch(0));
  EXPECT_EQ(report_outbox(*outbox_).batches.at(0).trouble, "422 no");
  EXPECT_EQ(retry_parked(*outbox_, 6), 1);
  EXPECT_EQ(tiles_in(TileState::sealed), 2);
  EXPECT_TRUE(transfer_.next_batch(0));
}

TEST_F(Outbox, ADelayedBatchLetsOthersGoFirst) {
  stage(1);
  seal();
  stage(2);
  seal();
  const OpenBatch first = *transfer_.next_batch(100);
  transfer_.delay(first, 3, 5'000, "503 busy");
  EXPECT_NE(transfer_.next_batch(100)->id, first.id);
  EXPECT_EQ(transfer_.next_batch(5'000)->id, first.id);
  EXPECT_EQ(transfer_.next_batch(5'000)->attempts, 3);
}

TEST_F(Outbox, ImagesAreKeptUntilTheVerdict) {
  stage(2);
  seal();
  EXPECT_EQ(prune_blobs(*outbox_, 1'000'000, false).tiles, 0);
  transfer_.announced(*transfer_.next_batch(0), answer({}, {0}, {1}), 500);
  EXPECT_EQ(prune_blobs(*outbox_, 500, false).tiles, 0) << "its retention is not over";
  EXPECT_EQ(prune_blobs(*outbox_, 501, true).tiles, 1);
  EXPECT_EQ(prune_blobs(*outbox_, 501, false).tiles, 1);
  EXPECT_EQ(prune_blobs(*outbox_, 501, false).tiles, 0);
  EXPECT_EQ(restage(*outbox_, "too_old", 600), 0) << "without its image it cannot be sent again";
}

TEST_F(Outbox, TilesAreRetriedOnceTheirBatchIsDone) {
  stage(2);
  seal();
  transfer_.announced(*transfer_.next_batch(0), answer({}, {0}, {1}), 5);
  const OpenBatch batch = *transfer_.next_batch(0);
  EXPECT_EQ(restage(*outbox_, "too_old", 6), 0);
  // The service reports all its tiles, also the one that it refused.
  StatusReply status = verdicts(batch, {VerdictReply::Kind::accepted, VerdictReply::Kind::rejected});
  EXPECT_NO_THROW(transfer_.verdicts(batch, status, 7));
  EXPECT_EQ(tiles_in(TileState::accepted), 1);
  EXPECT_EQ(restage(*outbox_, "too_old", 8), 1);
  EXPECT_EQ(tiles_in(TileState::staged), 1);
}

TEST_F(Outbox, AFailedTransitionIsRolledBack) {
  stage(2);
  seal();
  EXPECT_THROW(outbox_->transition("test",
                                   [&] {
                                     outbox_->move_tiles(1, TileState::sealed, TileState::announced, 1);
                                     throw Error({.what = "stop"});
                                   }),
               Error);
  EXPECT_EQ(tiles_in(TileState::sealed), 2);
  EXPECT_THROW(outbox_->transition("test", [&] { outbox_->move_tiles(1, TileState::sealed, TileState::accepted, 1); }),
               Error)
      << "no such step";
  EXPECT_EQ(tiles_in(TileState::sealed), 2);
}

TEST_F(Outbox, DamagedBytesAreNotSent) {
  stage(1);
  seal();
  transfer_.announced(*transfer_.next_batch(0), answer({0}, {}, {}), 5);
  const OpenPack pack = *transfer_.next_pack(*transfer_.next_batch(0));
  outbox_->prepare("DROP TRIGGER blob_changes").run();
  outbox_->prepare("UPDATE blob SET bytes = x'00'").run();
  EXPECT_THROW(transfer_.pack_bytes(pack), Error);
}

// The latest report of each airframe, and none twice.
TEST_F(Outbox, KeepsTheLatestReportOfAnInstalledPackage) {
  const auto report = [this](const char* airframe, std::int64_t number) {
    return sign_installed_report({.airframe = airframe,
                                  .number = number,
                                  .reported_at = {1'795'000'000},
                                  .package = Sha256(),
                                  .series = "valley",
                                  .sequence = 1,
                                  .root_version = 1,
                                  .verified_at = {1'795'000'000}},
                                 key_);
  };
  EXPECT_TRUE(stage_installed(*outbox_, report("mini-07", 5)));
  EXPECT_FALSE(stage_installed(*outbox_, report("mini-07", 5)));
  EXPECT_FALSE(stage_installed(*outbox_, report("mini-07", 4)));
  EXPECT_TRUE(stage_installed(*outbox_, report("mini-08", 4)));
  ASSERT_EQ(transfer_.open_reports().size(), 2U);
  transfer_.report_sent(transfer_.open_reports()[0]);
  transfer_.report_refused(transfer_.open_reports()[0], "key.revoked");
  EXPECT_TRUE(transfer_.open_reports().empty());
  EXPECT_FALSE(stage_installed(*outbox_, report("mini-07", 5))) << "it was sent";
  EXPECT_TRUE(stage_installed(*outbox_, report("mini-08", 6))) << "a later one gets another chance";
  const Transfer::OpenReport old{.airframe = "mini-08", .number = 4, .document = {}};
  transfer_.report_sent(old);
  ASSERT_EQ(transfer_.open_reports().size(), 1U) << "an answer about the one before is not about this one";
  EXPECT_EQ(transfer_.open_reports()[0].number, 6);
}

TEST_F(Outbox, AllowsOneWriterAndManyReaders) {
  EXPECT_THROW(OutboxDatabase(folder_ / "outbox", OutboxDatabase::Access::write), Error);
  const OutboxDatabase reader(folder_ / "outbox", OutboxDatabase::Access::read);
  stage(1);
  EXPECT_EQ(report_outbox(reader).states.at(TileState::staged).tiles, 1);
}

TEST(OldOutbox, IsReadUnchangedAndMigratedByTheFirstWriter) {
  const test::TemporaryFolder folder;
  {
    const OutboxDatabase outbox(folder / "outbox", OutboxDatabase::Access::make);
    for (const char* back_to_version_1 :
         {"DROP TABLE strike", "DROP TABLE installed", "DELETE FROM step WHERE 'DAMAGED' IN (before, after)",
          "DELETE FROM step WHERE before = 'PARKED' AND after = 'STAGED'", "DELETE FROM state WHERE name = 'DAMAGED'",
          "PRAGMA user_version = 1"}) {
      outbox.prepare(back_to_version_1).run();
    }
  }
  EXPECT_EQ(report_outbox(OutboxDatabase(folder / "outbox", OutboxDatabase::Access::read)).states.size(),
            kTileStates.size());
  const auto version = [&] {
    const OutboxDatabase outbox(folder / "outbox", OutboxDatabase::Access::write);
    outbox.prepare("SELECT count(*) FROM strike").step();
    outbox.prepare("SELECT count(*) FROM installed").step();
    auto pragma = outbox.prepare("PRAGMA user_version");
    pragma.step();
    return pragma.integer(0);
  };
  EXPECT_EQ(version(), kOutboxVersion);
  EXPECT_EQ(version(), kOutboxVersion) << "once";
  {
    const OutboxDatabase outbox(folder / "outbox", OutboxDatabase::Access::write);
    outbox.prepare("PRAGMA user_version = 5").run();
  }
  EXPECT_THROW(OutboxDatabase(folder / "outbox", OutboxDatabase::Access::write), UsageError);
}

// Outboxes that an attacker or a disk has damaged.

using Access = OutboxDatabase::Access;

using OutboxAbuse = test::OutboxFixture;

// SQLite's super-journal: of a transaction over several databases, deleted when it is rolled back.
TEST_F(OutboxAbuse, AJournalThatNamesAnotherFileDeletesNothing) {
  outbox_.reset();
  const std::filesystem::path victim = folder_ / "precious";
  write_file_atomic(victim, "precious");
  const auto big_endian = [](std::uint32_t value) {
    std::string bytes;
    for (const int shift : {24, 16, 8, 0}) bytes += static_cast<char>(value >> shift & 0xFF);
    return bytes;
  };
  const std::string magic = "\xd9\xd5\x05\xf9\x20\xa1\x63\xd7", name = victim.string();
  const auto pages = static_cast<std::uint32_t>(std::filesystem::file_size(file_) / 4096);
  std::string journal = magic + big_endian(0) + big_endian(0) + big_endian(pages) + big_endian(512) + big_endian(4096);
  journal.resize(512);
  std::uint32_t sum = 0;
  for (const char c : name) sum += static_cast<std::uint32_t>(c);
  journal += big_endian((1U << 30) / 4096 + 1) + name + big_endian(static_cast<std::uint32_t>(name.size())) +
             big_endian(sum) + magic;
  write_file_atomic(file_.string() + "-journal", journal);
  for (const Access access : {Access::read, Access::write, Access::make}) {
    EXPECT_THROW(OutboxDatabase(folder_ / "outbox", access), Error);
  }
  EXPECT_EQ(read_text_file(victim), "precious");
  journal.resize(512);  // one that a killed program leaves
  write_file_atomic(file_.string() + "-journal", journal);
  EXPECT_NO_THROW(OutboxDatabase(folder_ / "outbox", Access::read));
}

TEST_F(OutboxAbuse, RejectsOtherTablesOrConstraints) {
  stage(2);
  int number = 0;
  for (const char* sql :
       {"DROP TRIGGER blob_stays", "CREATE TABLE more (a)", "CREATE VIEW more AS SELECT 1",
        "CREATE TRIGGER more AFTER UPDATE ON tile BEGIN DELETE FROM document; END", "DROP INDEX tile_by_pack",
        "DROP TRIGGER blob_stays; CREATE TRIGGER blob_stays BEFORE DELETE ON blob WHEN 0 BEGIN SELECT 1; END",
        "UPDATE state SET final = 1 WHERE name = 'SENT'", "UPDATE state SET final = 0.5 WHERE name = 'SENT'",
        "DELETE FROM state WHERE name = 'SENT'", "UPDATE state SET name = CAST(name AS BLOB)",
        "INSERT INTO state VALUES ('STRANGE', 1)", "ALTER TABLE tile ADD COLUMN path TEXT"}) {
    SCOPED_TRACE(sql);
    outbox_.reset();
    const std::filesystem::path other = folder_ / std::to_string(++number);
    std::filesystem::create_directory(other);
    std::filesystem::copy_file(file_, other / kOutboxFile);
    SqliteDatabase::open_writable(other / kOutboxFile).execute(sql);
    for (const Access access : {Access::read, Access::write, Access::make}) {
      EXPECT_THROW(OutboxDatabase(other, access), UsageError);
    }
  }
  EXPECT_NO_THROW(reopen());
}

// What the triggers go by is a table: with another row, a tile goes another way.
TEST_F(OutboxAbuse, RejectsUnexpectedStateTransitionsAndNamesThem) {
  stage(1);
  int number = 0;
  for (const auto& [sql, named] : std::initializer_list<std::pair<const char*, const char*>>{
           {"INSERT INTO step VALUES ('STAGED', 'ACCEPTED')", "also 'STAGED' to 'ACCEPTED'"},
           {"INSERT INTO step VALUES (X'00', 'SENT')", "also X'00' to 'SENT'"},
           {"DELETE FROM step WHERE before = 'WAITING' AND after = 'PARKED'", "no 'WAITING' to 'PARKED'"},
           {"DELETE FROM step", "no "},
           {"UPDATE step SET after = 'REFUSED' WHERE before = 'SENT' AND after = 'ACCEPTED'",
            "also 'SENT' to 'REFUSED'"},
           {"UPDATE step SET before = CAST(before AS BLOB) WHERE before = 'SEALED'", "also X'5345414C4544' to '"},
           {"INSERT INTO step VALUES (1, hex(zeroblob(100000)))", "also '1' to '0000"}}) {
    SCOPED_TRACE(sql);
    outbox_.reset();
    const std::filesystem::path other = folder_ / ("steps" + std::to_string(++number));
    std::filesystem::create_directory(other);
    std::filesystem::copy_file(file_, other / kOutboxFile);
    SqliteDatabase::open_writable(other / kOutboxFile).execute(sql);
    for (const Access access : {Access::read, Access::write, Access::make}) {
      try {
        OutboxDatabase(other, access);
        ADD_FAILURE() << "it was opened";
      } catch (const UsageError& error) {
        EXPECT_THAT(error.text().expected, ::testing::StartsWith("the steps of version "));
        EXPECT_THAT(error.text().found, ::testing::StartsWith(named));
        EXPECT_LT(error.text().found.size(), 120U);
      }
    }
  }
}

TEST_F(OutboxAbuse, DoesNotCreateTablesInAForeignDatabase) {
  const std::filesystem::path other = folder_ / "foreign";
  std::filesystem::create_directory(other);
  SqliteDatabase::create(other / kOutboxFile).execute("CREATE TABLE letters (a)");
  EXPECT_THROW(OutboxDatabase(other, Access::make), UsageError);
  EXPECT_FALSE(SqliteDatabase::open_writable(other / kOutboxFile).has_table("tile"));
}

TEST_F(OutboxAbuse, ReportsAnImpossibleStateOrTime) {
  stage(1);
  seal();
  change("UPDATE tile SET state = 'NOWHERE'");
  reopen();
  EXPECT_THROW(report_outbox(*outbox_), Error) << "it is not as if every tile had its verdict";
  for (const char* time : {"-1", "9223372036854775807"}) {
    change(std::string("UPDATE tile SET state = 'SEALED'; UPDATE batch SET not_before_ms = ") + time);
    reopen();
    EXPECT_THROW(report_outbox(*outbox_), Error) << time;
  }
}

TEST_F(OutboxAbuse, DoesNotSendAPackWhoseSizeDiffersFromItsRow) {
  stage(1);
  seal();
  transfer_.announced(*transfer_.next_batch(0), answer({0}, {}, {}), 5);
  change("UPDATE pack SET size = size + 1000000");
  reopen();
  EXPECT_THROW(transfer_.pack_bytes(*transfer_.next_pack(*transfer_.next_batch(0))), Error);
}

}  // namespace
}  // namespace nadir
