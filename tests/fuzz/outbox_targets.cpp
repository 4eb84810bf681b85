// An outbox from a damaged disk or from somebody who had it in his hands: what nadir sync status, retry, stage, push
// and prune read of it, as a whole file and as rows between sound tables.
#include "base/files.hpp"
#include "fuzz/any_rows.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "upload/outbox_upkeep.hpp"
#include "upload/outbox.hpp"
#include "upload/staging.hpp"
#include "upload/transfer.hpp"

namespace nadir::fuzz {
namespace {

constexpr std::int64_t kNow_ms = 1'795'000'000'000;

std::int64_t number(const OutboxDatabase& outbox, std::string_view sql) {
  auto row = outbox.prepare(sql);
  row.step();
  return row.integer(0);
}

// Pictures of tiles without a final verdict.
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

// A file beside the folder, that no outbox may reach.
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
    // A column that is the row's number takes nothing else.
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
