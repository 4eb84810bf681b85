#include "upload/staging.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "upload/batch.hpp"

namespace nadir {
namespace {

constexpr std::size_t kSignatureSize = 64;

bool is_digest(ByteView bytes, const Sha256& digest) { return std::ranges::equal(bytes, digest.bytes); }

// Throws Error where the row is not what was staged; returns what is wrong with the image.
std::string read_row(const SqliteStatement& row, BatchTile& tile) {
  tile.sidecar_bytes = std::string(row.text(7));
  if (!is_digest(row.blob(1), sha256(as_bytes(tile.sidecar_bytes))))
    return "its sidecar is not the one that was staged";
  tile.sidecar = parse_candidate(tile.sidecar_bytes, "its sidecar");
  const CandidateSidecar& sidecar = tile.sidecar;
  const bool same = is_digest(row.blob(2), sidecar.sha256) &&
                    row.integer(3) == static_cast<std::int64_t>(sidecar.size) && row.text(4) == sidecar.airframe &&
                    row.text(5) == sidecar.flight && is_digest(row.blob(6), sidecar.base_package);
  if (!same) return "its row contradicts its sidecar";
  const ByteView signature = row.blob(9);
  tile.signature = {std::string(row.text(8)), Bytes(signature.begin(), signature.end())};
  if (!Sha256::from_hex(tile.signature.keyid) || signature.size() != kSignatureSize) {
    return "its signature is malformed";
  }
  if (row.is_null(10)) return "its image is missing";
  if (!matches_digest(row.blob(10), row.blob(2))) return "its image is not the one that was staged";
  return {};
}

}  // namespace

StoredTile read_stored_tile(const SqliteStatement& row) {
  StoredTile stored{.id = row.integer(0), .tile = {}, .damage = {}};
  try {
    stored.damage = read_row(row, stored.tile);
  } catch (const Error& error) {
    stored.damage = error.what();
  }
  return stored;
}

bool matches_digest(ByteView bytes, ByteView digest) { return is_digest(digest, sha256(bytes)); }

Finding set_aside(const OutboxDatabase& outbox, const StoredTile& tile, std::int64_t now_ms) {
  auto update = outbox.prepare(
      "UPDATE tile SET state = ?, code = 'damaged', detail = ?, batch = NULL, pack = NULL, changed_ms = ? WHERE id = ?"
      " RETURNING lower(hex(candidate)), flight");
  update.bind(1, name_of(TileState::damaged)).bind(2, tile.damage).bind(3, now_ms).bind(4, tile.id).step();
  return {.code = "outbox.damaged",
          .where = printable(fmt::format("candidate {:.64} of flight {:.64}", update.text(0), update.text(1))),
          .expected = "a tile as it was staged",
          .found = tile.damage,
          .fix = "check the disk; stage the flight again: an intact copy replaces this one"};
}

namespace {

struct StagedBatch {
  Batch batch;
  std::vector<std::int64_t> tiles;  // rows
  std::vector<StoredTile> damaged;
};

// The oldest staged tile and what goes with it, as much as one batch holds, and the damaged ones on the way.
std::optional<StagedBatch> next_batch(const OutboxDatabase& outbox) {
  auto rows = outbox.prepare(std::string(kSelectStoredTiles) +
                             "WHERE state = 'STAGED' AND (airframe, flight, base_package) IS (SELECT airframe, flight,"
                             " base_package FROM tile WHERE state = 'STAGED' ORDER BY id LIMIT 1) ORDER BY tile.id");
  StagedBatch result;
  std::set<Sha256> seen;
  std::uint64_t size = kBatchFrame;
  while (result.tiles.size() < kMaxBatchTiles && rows.step()) {
    StoredTile stored = read_stored_tile(rows);
    if (!stored.damage.empty()) {
      result.damaged.push_back(std::move(stored));
      continue;
    }
    BatchTile& tile = stored.tile;
    if (seen.contains(tile.sidecar.sha256)) continue;  // the same bytes at another place: the next batch's
    size += batch_share(tile);
    if (size > kMaxBatchSize) break;
    seen.insert(tile.sidecar.sha256);
    result.tiles.push_back(stored.id);
    result.batch.tiles.push_back(std::move(tile));
  }
  if (result.tiles.empty()) return result.damaged.empty() ? std::nullopt : std::optional(std::move(result));
  const CandidateSidecar& first = result.batch.tiles.front().sidecar;
  result.batch.airframe = first.airframe;
  result.batch.flight = first.flight;
  result.batch.base_package = first.base_package;
  return result;
}

void put_batch(OutboxDatabase& outbox, const SignedBatch& batch, const std::vector<std::int64_t>& tiles,
               std::int64_t now_ms) {
  auto insert = outbox.prepare(
      "INSERT INTO batch (uuid, airframe, flight, stage, sealed_ms) VALUES (?, ?, ?, 'sealed', ?) RETURNING id");
  insert.bind(1, batch.batch.id).bind(2, batch.batch.airframe).bind(3, batch.batch.flight).bind(4, now_ms);
  insert.step();
  const std::int64_t id = insert.integer(0);
  insert.reset();
  outbox.prepare("INSERT INTO document VALUES (?, ?)").bind(1, id).bind(2, batch.json()).run();
  auto update = outbox.prepare("UPDATE tile SET state = 'SEALED', batch = ?, changed_ms = ? WHERE id = ?");
  for (const std::int64_t tile : tiles) update.bind(1, id).bind(2, now_ms).bind(3, tile).run();
}

}  // namespace

std::int64_t stage_candidates(OutboxDatabase& outbox, std::span<const Candidate> candidates, std::int64_t now_ms) {
  std::int64_t staged = 0;
  outbox.transition("stage", [&] {
    auto insert = outbox.prepare(
        "INSERT INTO tile (candidate, sha256, size, airframe, flight, base_package, sidecar, keyid, signature, state,"
        " changed_ms) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, 'STAGED', ?) ON CONFLICT (candidate) DO UPDATE SET"
        " sha256 = excluded.sha256, size = excluded.size, airframe = excluded.airframe, flight = excluded.flight,"
        " base_package = excluded.base_package, sidecar = excluded.sidecar, keyid = excluded.keyid,"
        " signature = excluded.signature, state = 'STAGED', code = '', detail = '', changed_ms = excluded.changed_ms"
        " WHERE tile.state = 'DAMAGED' RETURNING id");
    auto make_way =
        outbox.prepare("DELETE FROM blob WHERE tile = (SELECT id FROM tile WHERE candidate = ? AND state = 'DAMAGED')");
    auto blob = outbox.prepare("INSERT INTO blob VALUES (?, ?)");
    for (const Candidate& candidate : candidates) {
      const CandidateSidecar& sidecar = candidate.sidecar;
      const Sha256 name = sha256(as_bytes(candidate.sidecar_bytes));
      make_way.bind(1, ByteView(name.bytes)).run();
      insert.bind(1, ByteView(name.bytes)).bind(2, ByteView(sidecar.sha256.bytes));
      insert.bind(3, static_cast<std::int64_t>(sidecar.size)).bind(4, sidecar.airframe).bind(5, sidecar.flight);
      insert.bind(6, ByteView(sidecar.base_package.bytes)).bind(7, candidate.sidecar_bytes);
      insert.bind(8, candidate.signature.keyid).bind(9, ByteView(candidate.signature.signature)).bind(10, now_ms);
      const bool added = insert.step();
      const std::int64_t id = added ? insert.integer(0) : 0;
      insert.reset();
      if (!added) continue;
      blob.bind(1, id).bind(2, ByteView(candidate.tile)).run();
      ++staged;
    }
  });
  return staged;
}

SealedSum seal_batches(OutboxDatabase& outbox, const PrivateKey& key, std::int64_t now_ms,
                       const std::function<std::array<std::uint8_t, 16>()>& random_bytes) {
  SealedSum sum;
  while (auto staged = next_batch(outbox)) {
    if (!staged->damaged.empty()) {
      Findings findings;
      outbox.transition("set-aside", [&] {
        for (const StoredTile& tile : staged->damaged) findings.add(set_aside(outbox, tile, now_ms));
      });
      sum.findings.add(findings);
    }
    if (staged->tiles.empty()) continue;
    staged->batch.id = uuid_from(random_bytes());
    staged->batch.created_at = {now_ms / 1'000};
    const SignedBatch batch = sign_batch(staged->batch, key);
    outbox.transition("seal", [&] { put_batch(outbox, batch, staged->tiles, now_ms); });
    ++sum.batches;
    sum.tiles += static_cast<std::int64_t>(staged->tiles.size());
  }
  return sum;
}

bool stage_installed(OutboxDatabase& outbox, const SignedInstalledReport& report) {
  bool taken = false;
  outbox.transition("stage_installed", [&] {
    auto insert = outbox.prepare(
        "INSERT INTO installed (airframe, number, document, stage) VALUES (?, ?, ?, 'new') ON CONFLICT (airframe) DO"
        " UPDATE SET number = excluded.number, document = excluded.document, stage = 'new', detail = ''"
        " WHERE excluded.number > installed.number");
    insert.bind(1, report.report.airframe).bind(2, report.report.number).bind(3, report.json()).run();
    taken = outbox.changes() > 0;
  });
  return taken;
}

}  // namespace nadir
