#include "upload/outbox_upkeep.hpp"

#include <vector>

namespace nadir {

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

}  // namespace nadir
