#include "upload/outbox_mend.hpp"

#include <algorithm>
#include <vector>

#include "base/error.hpp"
#include "upload/stored_tile.hpp"

namespace nadir {
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

MendedSum take_damaged_apart(OutboxDatabase& outbox, const PublicKey& key, std::int64_t now_ms) {
  MendedSum sum;
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
