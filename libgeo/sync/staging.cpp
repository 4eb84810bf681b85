#include "sync/staging.hpp"

#include <set>

#include "base/error.hpp"
#include "exchange/batch.hpp"

namespace nadir {
namespace {

struct StagedBatch {
  Batch batch;
  std::vector<std::int64_t> tiles;  // rows
};

// The oldest staged tile and what goes with it, as much as one batch holds.
std::optional<StagedBatch> next_batch(const OutboxDatabase& outbox) {
  auto rows = outbox.prepare(
      "SELECT id, sidecar, keyid, signature FROM tile WHERE state = 'STAGED' AND (airframe, flight, base_package) ="
      " (SELECT airframe, flight, base_package FROM tile WHERE state = 'STAGED' ORDER BY id LIMIT 1) ORDER BY id");
  StagedBatch result;
  std::set<Sha256> seen;
  std::uint64_t size = kBatchFrame;
  while (result.tiles.size() < kMaxBatchTiles && rows.step()) {
    BatchTile tile;
    tile.sidecar_bytes = rows.text(1);
    tile.sidecar = parse_candidate(tile.sidecar_bytes, "a staged tile");
    const ByteView signature = rows.blob(3);
    tile.signature = {std::string(rows.text(2)), Bytes(signature.begin(), signature.end())};
    if (seen.contains(tile.sidecar.sha256)) continue;  // the same bytes at another place: the next batch's
    size += batch_share(tile);
    if (size > kMaxBatchSize) break;
    seen.insert(tile.sidecar.sha256);
    result.tiles.push_back(rows.integer(0));
    result.batch.tiles.push_back(std::move(tile));
  }
  if (result.tiles.empty()) return std::nullopt;
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

bool is_staged(const OutboxDatabase& outbox, const std::string& sidecar_bytes) {
  const Sha256 digest = sha256(as_bytes(sidecar_bytes));
  auto known = outbox.prepare("SELECT 1 FROM tile WHERE candidate = ?");
  return known.bind(1, ByteView(digest.bytes)).step();
}

std::int64_t stage_candidates(OutboxDatabase& outbox, std::span<const Candidate> candidates, std::int64_t now_ms) {
  std::int64_t staged = 0;
  outbox.transition("stage", [&] {
    auto insert = outbox.prepare(
        "INSERT INTO tile (candidate, sha256, size, airframe, flight, base_package, sidecar, keyid, signature, state,"
        " changed_ms) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, 'STAGED', ?) ON CONFLICT (candidate) DO NOTHING RETURNING id");
    auto blob = outbox.prepare("INSERT INTO blob VALUES (?, ?)");
    for (const Candidate& candidate : candidates) {
      const CandidateSidecar& sidecar = candidate.sidecar;
      const Sha256 name = sha256(as_bytes(candidate.sidecar_bytes));
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
    staged->batch.id = uuid_from(random_bytes());
    staged->batch.created_at = {now_ms / 1'000};
    const SignedBatch batch = sign_batch(staged->batch, key);
    outbox.transition("seal", [&] { put_batch(outbox, batch, staged->tiles, now_ms); });
    ++sum.batches;
    sum.tiles += static_cast<std::int64_t>(staged->tiles.size());
  }
  return sum;
}

}  // namespace nadir
