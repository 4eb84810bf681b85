// The upload of candidate tiles: sidecars and stores, uploaded batches, the service's replies, the outbox.
#include "base/digest.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "fuzz/any_rows.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "ortho/candidate_store.hpp"
#include "upload/batch.hpp"
#include "upload/outbox.hpp"
#include "upload/outbox_upkeep.hpp"
#include "upload/pack.hpp"
#include "upload/service_client.hpp"
#include "upload/staging.hpp"
#include "upload/transfer.hpp"

namespace nadir::fuzz {

// Candidate tiles from an aircraft that an attacker may have accessed: sidecars, and the rows of a store.

void candidate(std::string_view bytes) {
  refusing([&] {
    const CandidateSidecar sidecar = parse_candidate(bytes, "fuzz");
    require(candidate_json(sidecar) == bytes, "two spellings of one sidecar");
    require(sidecar.key.valid(), "an address outside of the grid");
    require(cost_mm(sidecar) >= 0, "a cost below zero");
  });
}

void candidate_rows(std::string_view bytes) {
  const std::filesystem::path path = scratch_folder() / kCandidateFile;
  std::filesystem::remove(path);
  {
    const SqliteDatabase database = SqliteDatabase::create(path);
    database.execute(
        "PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; BEGIN; CREATE TABLE metadata (name, value);"
        "CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data);"
        "CREATE TABLE nadir_candidates (zoom_level, tile_column, tile_row, sidecar, keyid, signature)");
    Source source(bytes);
    auto tile = database.prepare("INSERT INTO tiles VALUES (?, ?, ?, ?)");
    auto datum = database.prepare("INSERT INTO metadata VALUES (?, ?)");
    auto row_of_candidates = database.prepare("INSERT INTO nadir_candidates VALUES (?, ?, ?, ?, ?, ?)");
    for (int row = 0; row < 64 && !source.empty(); ++row) {
      const int kind = source.byte() % 3;
      SqliteStatement& insert = kind == 0 ? tile : kind == 1 ? datum : row_of_candidates;
      for (int column = 1; column <= (kind == 0 ? 4 : kind == 1 ? 2 : 6); ++column) bind_any(insert, column, source);
      insert.run();
    }
    database.execute("COMMIT");
  }
  refusing([&] {
    CandidateReader reader(scratch_folder().path());
    static_cast<void>(reader.clean_shutdown());
    Findings findings;
    std::uint64_t read = 0;
    while (const auto candidate = reader.next(findings)) {
      ++read;
      require(sha256(candidate->tile) == candidate->sidecar.sha256, "a tile of another digest");
      require(candidate_json(candidate->sidecar) == candidate->sidecar_bytes,
              "another sidecar than the one that is read");
    }
    require(findings.has_errors() == !findings.items().empty(), "a damaged row that is no refusal");
    // A candidate comes once for each of its tiles: a table without a key may hold several.
    require(read + findings.items().size() >= reader.rows(), "a row that is neither read nor reported");
  });
}

// What an attacker may upload: announcements and packs of tiles.

void batch(std::string_view bytes) {
  refusing([&] {
    const SignedBatch read = parse_batch(bytes, "fuzz");
    require(is_uuid(read.batch.id), "an id that is none");
    const SignedBatch again = parse_batch(read.json(), "fuzz");
    require(again.json() == read.json(), "a batch changes when it is written");
    for (const BatchTile& tile : read.batch.tiles) {
      require(candidate_json(tile.sidecar) == tile.sidecar_bytes, "a sidecar changes when it is written");
    }
  });
}

void pack(std::string_view bytes) {
  refusing([&] {
    Bytes tiles;
    PackReader reader(
        bytes.size(), [](const PackEntry& entry) { return entry.size != 77; },
        [&](const PackEntry& entry, ByteView tile) {
          require(sha256(tile) == entry.sha256, "a tile of another digest");
          tiles.insert(tiles.end(), tile.begin(), tile.end());
        });
    // Chunks of growing sizes, so that every boundary is crossed.
    for (std::size_t at = 0, piece = 1; at < bytes.size(); at += piece, ++piece) {
      reader.feed(as_bytes(bytes.substr(at, piece)));
    }
    reader.finish();
    Bytes whole = pack_head(reader.entries());
    whole.insert(whole.end(), tiles.begin(), tiles.end());
    require(as_text(whole) == bytes, "a pack changes when it is written");
  });
}

// The replies of a candidate service, or of an impostor, to the uploader.

namespace {

// A name from the service is used in paths.
void require_plain(const std::string& upload) {
  require(!upload.empty() && upload.find_first_of("/.%?# \r\n") == std::string::npos, "a name that is more than one");
}

}  // namespace

void reply(std::string_view bytes) {
  refusing([&] {
    const AnnouncementReply read = parse_announcement(bytes);
    require_plain(read.upload);
    require(read.part_max >= 4096, "parts of next to nothing");
    for (const RefusedReply& refused : read.refused) {
      require(printable(refused.detail) == refused.detail, "words that a terminal obeys");
    }
  });
  refusing([&] {
    const StatusReply read = parse_upload_status(bytes);
    require_plain(read.upload);
    for (const VerdictReply& tile : read.tiles) {
      require((tile.kind == VerdictReply::Kind::rejected) == !tile.code.empty(), "a reason without need, or none");
      require(printable(tile.detail) == tile.detail, "words that a terminal obeys");
    }
  });
  const std::string words = problem_text(bytes);
  require(!words.empty() && printable(words) == words, "no words, or such that a terminal obeys");
}

void http_date(std::string_view bytes) {
  const auto time = parse_http_date(bytes);
  require(!time || parse_utc(to_rfc3339(*time)) == *time, "a date that is none");
}

// An outbox from a damaged disk or an attacker: what nadir sync status, retry, stage, push and prune read from it, as a
// whole file and as rows of valid tables.

namespace {

constexpr std::int64_t kNow_ms = 1'795'000'000'000;

std::int64_t number(const OutboxDatabase& outbox, std::string_view sql) {
  auto row = outbox.prepare(sql);
  row.step();
  return row.integer(0);
}

// Images of tiles without a final verdict.
std::int64_t needed(const OutboxDatabase& outbox) {
  return number(outbox,
                "SELECT count(*) FROM blob JOIN tile ON tile.id = blob.tile"
                " WHERE state NOT IN ('ACCEPTED', 'REJECTED', 'DUPLICATE', 'REFUSED', 'DAMAGED')");
}

void push(OutboxDatabase& outbox) {
  Transfer transfer(outbox);
  transfer.recover(kNow_ms);
  static_cast<void>(transfer.service_not_before_ms());
  static_cast<void>(transfer.unsent_tiles());
  const auto batch = transfer.next_batch(kNow_ms);
  if (!batch) return;
  static_cast<void>(transfer.document(*batch));
  if (const auto pack = transfer.next_pack(*batch)) {
    require(transfer.pack_bytes(*pack).size() == pack->size, "a pack of another size than its row says");
    transfer.pack_begins(*pack, kNow_ms);
    transfer.pack_waits(*pack, kNow_ms);
  }
  transfer.forgotten(*batch, kNow_ms);
  transfer.park(*batch, "fuzz", kNow_ms);
}

// The folder as the commands find it, one after the other.
void walk(const std::filesystem::path& folder) {
  static const PrivateKey key = PrivateKey::generate();
  refusing([&] {
    const OutboxDatabase outbox(folder, OutboxDatabase::Access::read);
    for (const BatchReport& batch : report_outbox(outbox).batches) {
      require(batch.not_before_ms >= 0, "an attempt before 1970");
    }
    require(failed_tiles(outbox, 3).size() <= 3, "more tiles than asked for");
  });
  refusing([&] {
    OutboxDatabase outbox(folder, OutboxDatabase::Access::make);
    outbox.prepare("PRAGMA synchronous = OFF").step();  // no disk is waited for
    outbox.prepare("PRAGMA journal_mode = MEMORY").step();
    const std::int64_t before = needed(outbox);
    refusing([&] { push(outbox); });
    refusing([&] { retry_parked(outbox, kNow_ms); });
    refusing([&] { prune_blobs(outbox, kNow_ms, false); });
    require(needed(outbox) == before, "a picture is gone that has no final verdict");
    refusing([&] { repair_damaged_batches(outbox, key.public_key(), kNow_ms); });
    refusing([&] { restage(outbox, "quota", kNow_ms); });
    refusing([&] {
      std::uint8_t uuids = 0;
      seal_batches(outbox, key, kNow_ms, [&uuids] { return std::array<std::uint8_t, 16>{++uuids}; });
    });
  });
}

// A file beside the folder, which no outbox may access.
std::filesystem::path fresh_folder() {
  const std::filesystem::path folder = scratch_folder() / "outbox";
  std::filesystem::remove_all(folder);
  std::filesystem::create_directory(folder);
  static const auto outside = scratch_file("outside", "not the outbox's");
  require(std::filesystem::exists(outside), "a file outside of the folder is gone");
  return folder;
}

void walk_and_look_around(const std::filesystem::path& folder) {
  walk(folder);
  require(read_text_file(scratch_folder() / "outside") == "not the outbox's", "a file outside of the folder changed");
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename();
    require(name == "lock" || name.starts_with(kOutboxFile), "a file that is none of the outbox's");
  }
}

void put_rows(const SqliteDatabase& database, Source source) {
  struct Table {
    const char* insert;
    int columns;
  };
  static constexpr std::array<Table, 6> kTables{{{"tile VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", 16},
                                                 {"blob VALUES (?, ?)", 2},
                                                 {"batch VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", 11},
                                                 {"document VALUES (?, ?)", 2},
                                                 {"pack VALUES (?, ?, ?, ?, ?)", 5},
                                                 {"strike VALUES (?, ?, ?)", 3}}};
  for (int row = 0; row < 64 && !source.empty(); ++row) {
    const Table& table = kTables.at(source.byte() % kTables.size());
    auto insert = database.prepare(std::string("INSERT OR IGNORE INTO ") + table.insert);
    for (int column = 1; column <= table.columns; ++column) bind_any(insert, column, source);
    // A rowid column accepts integers only.
    refusing([&] { insert.run(); });
  }
}

}  // namespace

void outbox(std::string_view bytes) {
  const std::filesystem::path folder = fresh_folder();
  scratch_file("outbox/" + std::string(kOutboxFile), bytes);
  walk_and_look_around(folder);
}

void outbox_rows(std::string_view bytes) {
  const std::filesystem::path folder = fresh_folder();
  {
    const SqliteDatabase database = SqliteDatabase::create(folder / kOutboxFile);
    database.execute(
        "PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; PRAGMA ignore_check_constraints = ON; BEGIN");
    for (std::int64_t version = 1; version <= kOutboxVersion; ++version) {
      database.execute(std::string(outbox_statements(version)));
    }
    auto begins = database.prepare("SELECT sql FROM sqlite_master WHERE name = 'tile_begins'");
    begins.step();
    const std::string trigger(begins.text(0));
    begins.reset();
    database.execute("DROP TRIGGER tile_begins");  // so that rows come in any state
    put_rows(database, Source(bytes));
    database.execute(trigger);
    database.execute("PRAGMA application_id = 1313099586; PRAGMA user_version = " + std::to_string(kOutboxVersion) +
                     "; COMMIT");
  }
  walk_and_look_around(folder);
}

}  // namespace nadir::fuzz
