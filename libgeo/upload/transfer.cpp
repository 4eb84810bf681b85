#include "upload/transfer.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.hpp"
#include "upload/pack.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kLongestDelay_ms = 86'400'000;                      // as long as a service may ask us to wait
constexpr std::string_view kVerdictsAwaited = "the verdicts are awaited";  // no trouble

BatchStage stage_of(std::string_view name) {
  if (name == "sealed") return BatchStage::sealed;
  return name == "announced" ? BatchStage::announced : BatchStage::complete;
}

Sha256 digest_of(ByteView blob) {
  Sha256 digest;
  if (blob.size() == digest.bytes.size()) std::copy(blob.begin(), blob.end(), digest.bytes.begin());
  return digest;
}

}  // namespace

// Within a transition.
void Transfer::interrupt(std::int64_t batch, std::int64_t now_ms) {
  outbox_.move_tiles(batch, TileState::sending, TileState::waiting, now_ms);
  outbox_.prepare("UPDATE pack SET stage = 'waiting' WHERE batch = ? AND stage = 'sending'").bind(1, batch).run();
}

void Transfer::set_stage(std::int64_t batch, const char* stage) {
  outbox_.prepare("UPDATE batch SET stage = ?, attempts = 0, not_before_ms = 0, trouble = '' WHERE id = ?")
      .bind(1, std::string_view(stage))
      .bind(2, batch)
      .run();
}

void Transfer::recover(std::int64_t now_ms) {
  std::vector<std::int64_t> batches;
  auto rows = outbox_.prepare("SELECT DISTINCT batch FROM pack WHERE stage = 'sending'");
  while (rows.step()) batches.push_back(rows.integer(0));
  rows.reset();
  const std::int64_t latest_ms = now_ms + kLongestDelay_ms;
  auto late = outbox_.prepare("SELECT 1 FROM batch WHERE not_before_ms > ?");
  const bool put_off = late.bind(1, latest_ms).step();
  late.reset();
  if (batches.empty() && !put_off) return;
  outbox_.transition("recover", [&] {
    for (const std::int64_t batch : batches) interrupt(batch, now_ms);
    outbox_.prepare("UPDATE batch SET not_before_ms = min(not_before_ms, ?)").bind(1, latest_ms).run();
  });
}

// Whoever waits in trouble waits for the service, and so did all others.
std::int64_t Transfer::service_not_before_ms() const {
  auto row = outbox_.prepare(
      "SELECT coalesce(max(not_before_ms), 0) FROM batch WHERE stage IN ('sealed', 'announced', 'complete')"
      " AND attempts > 0 AND trouble <> ?");
  row.bind(1, kVerdictsAwaited).step();
  return row.integer(0);
}

std::optional<OpenBatch> Transfer::next_batch(std::int64_t now_ms) const {
  auto rows = outbox_.prepare(
      "SELECT id, uuid, stage, upload, part_max, attempts, not_before_ms FROM batch"
      " WHERE stage IN ('sealed', 'announced', 'complete') ORDER BY max(not_before_ms, ?), id LIMIT 1");
  if (!rows.bind(1, now_ms).step()) return std::nullopt;
  return OpenBatch{rows.integer(0),
                   std::string(rows.text(1)),
                   stage_of(rows.text(2)),
                   std::string(rows.text(3)),
                   static_cast<std::uint64_t>(rows.integer(4)),
                   static_cast<int>(rows.integer(5)),
                   rows.integer(6)};
}

std::string Transfer::document(const OpenBatch& batch) const {
  auto row = outbox_.prepare("SELECT text FROM document WHERE batch = ?");
  row.bind(1, batch.id).step();
  return std::string(row.text(0));
}

std::int64_t Transfer::unsent_tiles() const {
  auto row = outbox_.prepare("SELECT count(*) FROM tile WHERE state IN ('SEALED', 'ANNOUNCED', 'SENDING', 'WAITING')");
  row.step();
  return row.integer(0);
}

std::optional<OpenPack> Transfer::next_pack(const OpenBatch& batch) const {
  auto rows = outbox_.prepare(
      "SELECT id, batch, sha256, size, stage <> 'new' FROM pack WHERE batch = ? AND stage <> 'sent' ORDER BY id LIMIT "
      "1");
  if (!rows.bind(1, batch.id).step()) return std::nullopt;
  return OpenPack{rows.integer(0), rows.integer(1), digest_of(rows.blob(2)),
                  static_cast<std::uint64_t>(rows.integer(3)), rows.integer(4) != 0};
}

void Transfer::pack_begins(const OpenPack& pack, std::int64_t now_ms) {
  outbox_.transition("pack-begins", [&] {
    outbox_.prepare("UPDATE pack SET stage = 'sending' WHERE id = ?").bind(1, pack.id).run();
    outbox_
        .prepare(
            "UPDATE tile SET state = 'SENDING', changed_ms = ? WHERE pack = ? AND state IN ('ANNOUNCED', 'WAITING')")
        .bind(1, now_ms)
        .bind(2, pack.id)
        .run();
  });
}

void Transfer::pack_waits(const OpenPack& pack, std::int64_t now_ms) {
  outbox_.transition("pack-waits", [&] { interrupt(pack.batch, now_ms); });
}

std::int64_t Transfer::pack_sent(const OpenPack& pack, std::int64_t now_ms) {
  std::int64_t tiles = 0;
  outbox_.transition("pack-sent", [&] {
    outbox_.prepare("UPDATE pack SET stage = 'sent' WHERE id = ?").bind(1, pack.id).run();
    outbox_.prepare("UPDATE tile SET state = 'SENT', changed_ms = ? WHERE pack = ? AND state = 'SENDING'")
        .bind(1, now_ms)
        .bind(2, pack.id)
        .run();
    tiles = outbox_.changes();
    outbox_.prepare("UPDATE batch SET attempts = 0, not_before_ms = 0, trouble = '' WHERE id = ?")
        .bind(1, pack.batch)
        .run();
  });
  return tiles;
}

void Transfer::completed(const OpenBatch& batch) {
  outbox_.transition("complete", [&] { set_stage(batch.id, "complete"); });
}

void Transfer::forgotten(const OpenBatch& batch, std::int64_t now_ms) {
  outbox_.transition("forgotten", [&] {
    interrupt(batch.id, now_ms);
    for (const TileState state : {TileState::announced, TileState::waiting, TileState::sent}) {
      outbox_.move_tiles(batch.id, state, TileState::sealed, now_ms);
    }
    outbox_.prepare("UPDATE batch SET stage = 'sealed', upload = NULL WHERE id = ?").bind(1, batch.id).run();
  });
}

std::int64_t Transfer::park(const OpenBatch& batch, const std::string& why, std::int64_t now_ms) {
  std::int64_t tiles = 0;
  outbox_.transition("park", [&] {
    interrupt(batch.id, now_ms);
    for (const TileState state : {TileState::sealed, TileState::announced, TileState::waiting, TileState::sent}) {
      tiles += outbox_.move_tiles(batch.id, state, TileState::parked, now_ms);
    }
    outbox_.prepare("UPDATE batch SET stage = 'parked', trouble = ? WHERE id = ?").bind(1, why).bind(2, batch.id).run();
    outbox_.prepare("DELETE FROM strike WHERE batch = ?").bind(1, batch.id).run();
  });
  return tiles;
}

void Transfer::delay(const OpenBatch& batch, int attempts, std::int64_t not_before_ms, const std::string& why) {
  outbox_.transition("delay", [&] {
    outbox_.prepare("UPDATE batch SET attempts = ?, not_before_ms = ?, trouble = ? WHERE id = ?")
        .bind(1, attempts)
        .bind(2, not_before_ms)
        .bind(3, why)
        .bind(4, batch.id)
        .run();
  });
}

void Transfer::await_verdicts(const OpenBatch& batch, int attempts, std::int64_t not_before_ms) {
  delay(batch, attempts, not_before_ms, std::string(kVerdictsAwaited));
}

int Transfer::strike(const OpenBatch& batch, std::string_view kind) {
  outbox_.transition("strike", [&] {
    outbox_.prepare("INSERT INTO strike VALUES (?, ?, 1) ON CONFLICT (batch, kind) DO UPDATE SET count = count + 1")
        .bind(1, batch.id)
        .bind(2, kind)
        .run();
  });
  auto count = outbox_.prepare("SELECT count FROM strike WHERE batch = ? AND kind = ?");
  count.bind(1, batch.id).bind(2, kind).step();
  return static_cast<int>(count.integer(0));
}

void Transfer::forgive(const OpenBatch& batch, std::initializer_list<std::string_view> kinds) {
  std::vector<std::string> there;  // hardly ever any, and then nothing is written
  auto rows = outbox_.prepare("SELECT kind FROM strike WHERE batch = ?");
  rows.bind(1, batch.id);
  while (rows.step()) {
    if (std::find(kinds.begin(), kinds.end(), rows.text(0)) != kinds.end()) there.emplace_back(rows.text(0));
  }
  rows.reset();
  if (there.empty()) return;
  outbox_.transition("forgive", [&] {
    auto remove = outbox_.prepare("DELETE FROM strike WHERE batch = ? AND kind = ?");
    for (const std::string& kind : there) remove.bind(1, batch.id).bind(2, kind).run();
  });
}

}  // namespace nadir
