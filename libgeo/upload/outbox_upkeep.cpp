#include "upload/outbox_upkeep.hpp"

#include <algorithm>
#include <vector>

#include "base/error.hpp"
#include "upload/staging.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kLatest_ms = 253'402'300'799'999;  // 9999-12-31T23:59:59.999Z

[[noreturn]] void refuse_setting(std::string expected, std::string_view found) {
  throw Error(
      {.what = "the outbox is damaged",
       .expected = std::move(expected),
       .found = std::string(found.substr(0, 80)),
       .fix = "check the disk; stage the flight into a new outbox: tiles that have arrived are not sent twice"});
}

}  // namespace

OutboxReport report_outbox(const OutboxDatabase& outbox) {
  OutboxReport report;
  for (const TileState state : kTileStates) report.states[state] = {};
  auto states = outbox.prepare("SELECT state, count(*), sum(size) FROM tile GROUP BY state");
  while (states.step()) {
    const auto state = parse_tile_state(states.text(0));
    if (!state) refuse_setting("a state of a tile", std::string(states.text(0)));
    report.states[*state].tiles += states.integer(1);
    report.states[*state].bytes += states.integer(2);
  }
  auto reasons =
      outbox.prepare("SELECT code, count(*) FROM tile WHERE state IN ('REJECTED', 'REFUSED', 'DAMAGED') GROUP BY code");
  while (reasons.step()) report.reasons[std::string(reasons.text(0))] = reasons.integer(1);
  auto kept = outbox.prepare("SELECT coalesce(sum(size), 0) FROM tile WHERE id IN (SELECT tile FROM blob)");
  kept.step();
  report.kept_bytes = kept.integer(0);
  auto batches = outbox.prepare(
      "SELECT uuid, airframe, flight, stage, attempts, not_before_ms, trouble,"
      " (SELECT count(*) FROM tile WHERE tile.batch = batch.id),"
      " (SELECT count(*) FROM tile JOIN state ON state.name = tile.state WHERE tile.batch = batch.id AND NOT final)"
      " FROM batch WHERE stage <> 'done' ORDER BY id");
  while (batches.step()) {
    const std::int64_t not_before_ms = batches.integer(5);
    if (not_before_ms < 0 || not_before_ms > kLatest_ms)
      refuse_setting("a time before the year 10000", batches.text(5));
    report.batches.push_back({std::string(batches.text(0)), std::string(batches.text(1)), std::string(batches.text(2)),
                              std::string(batches.text(3)), batches.integer(7), batches.integer(8),
                              static_cast<int>(batches.integer(4)), not_before_ms, std::string(batches.text(6))});
  }
  return report;
}

std::vector<FailedTile> failed_tiles(const OutboxDatabase& outbox, std::int64_t most) {
  std::vector<FailedTile> tiles;
  auto rows = outbox.prepare(
      "SELECT lower(hex(sha256)), flight, state, code, detail FROM tile WHERE state IN ('REJECTED', 'REFUSED', "
      "'DAMAGED')"
      " ORDER BY id LIMIT ?");
  rows.bind(1, most);
  while (rows.step()) {
    tiles.push_back({std::string(rows.text(0)), std::string(rows.text(1)), std::string(rows.text(2)),
                     std::string(rows.text(3)), std::string(rows.text(4))});
  }
  return tiles;
}

std::int64_t retry_parked(OutboxDatabase& outbox, std::int64_t now_ms) {
  std::int64_t batches = 0;
  outbox.transition("retry", [&] {
    std::vector<std::int64_t> parked;
    auto rows = outbox.prepare("SELECT id FROM batch WHERE stage = 'parked'");
    while (rows.step()) parked.push_back(rows.integer(0));
    for (const std::int64_t batch : parked) outbox.move_tiles(batch, TileState::parked, TileState::sealed, now_ms);
    outbox.prepare("UPDATE batch SET stage = 'sealed', upload = NULL WHERE stage = 'parked'").run();
    outbox.prepare("UPDATE batch SET attempts = 0, not_before_ms = 0, trouble = '' WHERE stage <> 'done'").run();
    batches = outbox.changes();
    outbox.prepare("DELETE FROM strike").run();
  });
  return batches;
}

std::int64_t restage(OutboxDatabase& outbox, std::string_view code, std::int64_t now_ms) {
  std::int64_t tiles = 0;
  outbox.transition("restage", [&] {
    outbox
        .prepare(
            "UPDATE tile SET state = 'STAGED', code = '', detail = '', batch = NULL, pack = NULL, changed_ms = ?"
            " WHERE state IN ('REJECTED', 'REFUSED') AND code = ? AND id IN (SELECT tile FROM blob)"
            " AND batch IN (SELECT id FROM batch WHERE stage = 'done')")
        .bind(1, now_ms)
        .bind(2, code)
        .run();
    tiles = outbox.changes();
  });
  return tiles;
}

PruneSum prune_blobs(OutboxDatabase& outbox, std::int64_t before_ms, bool only_count) {
  PruneSum sum;
  auto count = outbox.prepare(
      "SELECT count(*), coalesce(sum(size), 0) FROM tile JOIN state ON state.name = tile.state"
      " WHERE final AND changed_ms < ? AND id IN (SELECT tile FROM blob)");
  count.bind(1, before_ms).step();
  sum = {count.integer(0), count.integer(1)};
  count.reset();
  if (only_count || sum.tiles == 0) return sum;
  outbox.transition("prune", [&] {
    outbox
        .prepare(
            "DELETE FROM blob WHERE tile IN (SELECT id FROM tile JOIN state ON state.name = tile.state"
            " WHERE final AND changed_ms < ?)")
        .bind(1, before_ms)
        .run();
  });
  outbox.shrink();
  return sum;
}

namespace {

struct ParkedBatch {
  std::int64_t id = 0;
  std::string uuid;
};

std::vector<ParkedBatch> parked_batches(const OutboxDatabase& outbox) {
  std::vector<ParkedBatch> batches;
  auto rows = outbox.prepare("SELECT id, uuid FROM batch WHERE stage = 'parked' ORDER BY id");
  while (rows.step()) batches.push_back({rows.integer(0), std::string(rows.text(1))});
  return batches;
}

bool document_is_sound(const OutboxDatabase& outbox, const ParkedBatch& batch, const PublicKey& key) {
  auto row = outbox.prepare("SELECT text FROM document WHERE batch = ?");
  if (!row.bind(1, batch.id).step()) return false;
  try {
    const SignedBatch sealed = parse_batch(row.text(0), "a sealed batch");
    const Bytes message = pre_authentication_encoding(kBatchPayloadType, as_bytes(sealed.document.signed_bytes));
    return sealed.batch.id == batch.uuid &&
           std::ranges::all_of(sealed.document.signatures, [&](const EnvelopeSignature& signature) {
             return signature.keyid != key.id() || key.verifies(message, signature.signature);
           });
  } catch (const Error&) {
    return false;
  }
}

std::vector<StoredTile> damaged_tiles(const OutboxDatabase& outbox, std::int64_t batch) {
  std::vector<StoredTile> damaged;
  auto rows = outbox.prepare(std::string(kSelectStoredTiles) + "WHERE batch = ? AND state = 'PARKED' ORDER BY id");
  rows.bind(1, batch);
  while (rows.step()) {
    StoredTile tile = read_stored_tile(rows);
    if (!tile.damage.empty()) damaged.push_back(std::move(tile));
  }
  return damaged;
}

}  // namespace

RepairSum repair_damaged_batches(OutboxDatabase& outbox, const PublicKey& key, std::int64_t now_ms) {
  RepairSum sum;
  for (const ParkedBatch& batch : parked_batches(outbox)) {
    const std::vector<StoredTile> damaged = damaged_tiles(outbox, batch.id);
    if (damaged.empty() && document_is_sound(outbox, batch, key)) continue;
    Findings findings;
    std::int64_t tiles = 0;
    outbox.transition("take-apart", [&] {
      for (const StoredTile& tile : damaged) findings.add(set_aside(outbox, tile, now_ms));
      outbox
          .prepare(
              "UPDATE tile SET state = 'STAGED', batch = NULL, pack = NULL, changed_ms = ?"
              " WHERE batch = ? AND state = 'PARKED'")
          .bind(1, now_ms)
          .bind(2, batch.id)
          .run();
      tiles = outbox.changes();
      outbox.prepare("UPDATE batch SET stage = 'done' WHERE id = ?").bind(1, batch.id).run();
    });
    ++sum.batches;
    sum.tiles += tiles;
    sum.findings.add(findings);
  }
  return sum;
}

}  // namespace nadir
