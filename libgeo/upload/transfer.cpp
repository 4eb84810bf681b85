#include "upload/transfer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "base/error.hpp"
#include "upload/pack.hpp"
#include "upload/staging.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kLongestDelay_ms = 86'400'000;  // the longest that a service may ask us to wait
constexpr std::string_view kVerdictsAwaited = "the verdicts are awaited";  // not an error

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

// A batch that waits after an error waits for the service; all other batches have to wait for it as well.
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

int Transfer::count_failure(const OpenBatch& batch, std::string_view kind) {
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

void Transfer::reset_failures(const OpenBatch& batch, std::initializer_list<std::string_view> kinds) {
  std::vector<std::string> there;  // usually none; then nothing is written
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

// The transitions that follow from the service's reply about each tile, and the packs of the tiles that it lacks.

namespace {

struct TileRow {
  std::int64_t id = 0;
  TileState state = TileState::sealed;
};

[[noreturn]] void refuse_reply(std::string expected, std::string found) {
  throw WrongAnswer({.what = "the service's answer is not about this batch",
                     .where = "its tiles",
                     .expected = std::move(expected),
                     .found = std::move(found)});
}

[[noreturn]] void refuse_damaged(std::string_view what, const Sha256& digest) {
  throw DamagedBatch({.what = "the outbox is damaged",
                      .where = fmt::format("{} {}", what, digest.hex()),
                      .expected = "the bytes that were staged",
                      .found = "other bytes, or none",
                      .fix = "check the disk; nadir sync retry --key puts the intact tiles into a new batch"});
}

// Rows that form no valid pack were not written by us.
Bytes head_of(std::span<const PackEntry> entries) {
  try {
    return pack_head(entries);
  } catch (const Error& error) {
    throw DamagedBatch(error.text());
  }
}

std::map<Sha256, TileRow> tiles_of(const OutboxDatabase& outbox, std::int64_t batch) {
  std::map<Sha256, TileRow> tiles;
  auto rows = outbox.prepare("SELECT id, sha256, state FROM tile WHERE batch = ?");
  rows.bind(1, batch);
  while (rows.step()) {
    Sha256 digest;
    const ByteView bytes = rows.blob(1);
    std::copy_n(bytes.begin(), std::min(bytes.size(), digest.bytes.size()), digest.bytes.begin());
    tiles[digest] = {rows.integer(0), parse_tile_state(rows.text(2)).value_or(TileState::parked)};
  }
  return tiles;
}

class TileMover {
 public:
  TileMover(const OutboxDatabase& outbox, std::int64_t now_ms)
      : update_(outbox.prepare("UPDATE tile SET state = ?, code = ?, detail = ?, changed_ms = ? WHERE id = ?")),
        now_ms_(now_ms) {}

  void move(std::int64_t tile, TileState after, std::string_view code = "", std::string_view detail = "") {
    update_.bind(1, name_of(after)).bind(2, code).bind(3, detail).bind(4, now_ms_).bind(5, tile).run();
  }

 private:
  SqliteStatement update_;
  std::int64_t now_ms_;
};

// Each tile of the reply belongs to the batch, none occurs twice, and none that awaits a reply is missing.
class Partition {
 public:
  Partition(const std::map<Sha256, TileRow>& tiles, TileState awaited) : tiles_(tiles), awaited_(awaited) {}

  const TileRow& take(const Sha256& digest) {
    const auto found = tiles_.find(digest);
    if (found == tiles_.end()) refuse_reply("tiles of the batch", digest.hex());
    if (!taken_.emplace(digest, true).second) refuse_reply("each tile once", digest.hex() + " twice");
    return found->second;
  }

  void check_whole() const {
    for (const auto& [digest, row] : tiles_) {
      if (row.state == awaited_ && !taken_.contains(digest))
        refuse_reply("every tile of the batch", "no verdict for " + digest.hex());
    }
  }

 private:
  const std::map<Sha256, TileRow>& tiles_;
  TileState awaited_;
  std::map<Sha256, bool> taken_;
};

TileState state_of(VerdictReply::Kind kind) {
  if (kind == VerdictReply::Kind::accepted) return TileState::accepted;
  return kind == VerdictReply::Kind::rejected ? TileState::rejected : TileState::duplicate;
}

}  // namespace

void Transfer::announced(const OpenBatch& batch, const AnnouncementReply& answer, std::int64_t now_ms) {
  const auto tiles = tiles_of(outbox_, batch.id);
  Partition partition(tiles, TileState::sealed);
  outbox_.transition("announce", [&] {
    TileMover mover(outbox_, now_ms);
    // After the service has deleted an upload, tiles with a verdict keep it. If it has lost those as well, it evaluates
    // none of the batch until it has all: those of them that are still stored here are sent again.
    std::vector<std::int64_t> again;
    const auto move = [&](const Sha256& digest, TileState after, std::string_view code, std::string_view detail) {
      const TileRow& row = partition.take(digest);
      if (row.state == TileState::sealed) {
        mover.move(row.id, after, code, detail);
      } else if (after == TileState::announced && is_final(row.state)) {
        again.push_back(row.id);
      }
    };
    for (const Sha256& digest : answer.missing) move(digest, TileState::announced, "", "");
    for (const Sha256& digest : answer.known) move(digest, TileState::sent, "", "");
    for (const RefusedReply& refusal : answer.refused)
      move(refusal.sha256, TileState::refused, refusal.code, refusal.detail);
    partition.check_whole();
    make_packs(batch.id, again);
    auto open = outbox_.prepare("SELECT count(*) FROM tile WHERE batch = ? AND state IN ('ANNOUNCED', 'SENT')");
    open.bind(1, batch.id).step();
    set_stage(batch.id, open.integer(0) > 0 ? "announced" : "done");
    outbox_.prepare("UPDATE batch SET upload = ?, part_max = ? WHERE id = ?")
        .bind(1, answer.upload)
        .bind(2, static_cast<std::int64_t>(answer.part_max))
        .bind(3, batch.id)
        .run();
  });
}

// Within a transition: packs of the tiles that the service lacks, in the order of the batch.
void Transfer::make_packs(std::int64_t batch, const std::vector<std::int64_t>& again) {
  outbox_.prepare("UPDATE tile SET pack = NULL WHERE batch = ?").bind(1, batch).run();
  outbox_.prepare("DELETE FROM pack WHERE batch = ?").bind(1, batch).run();
  std::vector<PackEntry> entries;
  std::vector<std::int64_t> rows;
  std::string ids;
  for (const std::int64_t id : again) ids += fmt::format("{}{}", ids.empty() ? "" : ",", id);
  auto missing = outbox_.prepare(
      fmt::format("SELECT id, sha256, size FROM tile WHERE batch = ? AND (state = 'ANNOUNCED' OR id IN ({}) AND id IN "
                  "(SELECT tile FROM blob)) ORDER BY id",
                  ids));
  missing.bind(1, batch);
  while (missing.step()) {
    PackEntry entry{{}, static_cast<std::uint32_t>(missing.integer(2))};
    const ByteView digest = missing.blob(1);
    std::copy_n(digest.begin(), std::min(digest.size(), entry.sha256.bytes.size()), entry.sha256.bytes.begin());
    entries.push_back(entry);
    rows.push_back(missing.integer(0));
  }
  auto insert = outbox_.prepare("INSERT INTO pack (batch, sha256, size, stage) VALUES (?, ?, ?, 'new') RETURNING id");
  auto assign = outbox_.prepare("UPDATE tile SET pack = ? WHERE id = ?");
  auto blob = outbox_.prepare("SELECT bytes FROM blob WHERE tile = ?");
  for (std::size_t from = 0; from < entries.size();) {
    const std::span<const PackEntry> rest = std::span(entries).subspan(from);
    const auto part = rest.first(entries_of_next_pack(rest));
    Sha256Stream stream;
    stream.update(head_of(part));
    for (std::size_t i = 0; i < part.size(); ++i) {
      const ByteView image = blob.bind(1, rows[from + i]).step() ? blob.blob(0) : ByteView();
      if (image.size() != part[i].size || !matches_digest(image, part[i].sha256.bytes)) {
        refuse_damaged("the image of tile", part[i].sha256);
      }
      stream.update(image);
      blob.reset();
    }
    const Sha256 digest = stream.finish();
    insert.bind(1, batch).bind(2, ByteView(digest.bytes)).bind(3, static_cast<std::int64_t>(pack_size(part))).step();
    const std::int64_t pack = insert.integer(0);
    insert.reset();
    for (std::size_t i = 0; i < part.size(); ++i) assign.bind(1, pack).bind(2, rows[from + i]).run();
    from += part.size();
  }
}

Bytes Transfer::pack_bytes(const OpenPack& pack) const {
  std::vector<PackEntry> entries;
  Bytes tiles;
  auto rows =
      outbox_.prepare("SELECT sha256, bytes FROM tile JOIN blob ON blob.tile = tile.id WHERE pack = ? ORDER BY id");
  rows.bind(1, pack.id);
  while (rows.step()) {
    PackEntry entry;
    const ByteView digest = rows.blob(0), bytes = rows.blob(1);
    std::copy_n(digest.begin(), std::min(digest.size(), entry.sha256.bytes.size()), entry.sha256.bytes.begin());
    if (!matches_digest(bytes, digest)) refuse_damaged("the image of tile", entry.sha256);
    entry.size = static_cast<std::uint32_t>(bytes.size());
    entries.push_back(entry);
    tiles.insert(tiles.end(), bytes.begin(), bytes.end());
  }
  Bytes result = head_of(entries);
  result.insert(result.end(), tiles.begin(), tiles.end());
  if (result.size() != pack.size || sha256(result) != pack.sha256) refuse_damaged("pack", pack.sha256);
  return result;
}

VerdictSum Transfer::verdicts(const OpenBatch& batch, const StatusReply& answer, std::int64_t now_ms) {
  if (answer.upload != batch.upload || answer.batch != batch.uuid)
    refuse_reply("upload " + batch.upload, answer.upload);
  const auto tiles = tiles_of(outbox_, batch.id);
  Partition partition(tiles, TileState::sent);
  VerdictSum sum;
  outbox_.transition("verdicts", [&] {
    TileMover mover(outbox_, now_ms);
    for (const VerdictReply& verdict : answer.tiles) {
      const TileRow& row = partition.take(verdict.sha256);
      if (row.state != TileState::sent) continue;  // it has its verdict
      if (verdict.kind == VerdictReply::Kind::pending) {
        ++sum.pending;
        continue;
      }
      mover.move(row.id, state_of(verdict.kind), verdict.code, verdict.detail);
      ++(verdict.kind == VerdictReply::Kind::accepted   ? sum.accepted
         : verdict.kind == VerdictReply::Kind::rejected ? sum.rejected
                                                        : sum.duplicate);
    }
    partition.check_whole();
    if (sum.pending == 0) {
      set_stage(batch.id, "done");
    } else if (!answer.complete) {
      set_stage(batch.id, "announced");  // the service lost the completion: announce it again
    }
  });
  return sum;
}

std::vector<Transfer::OpenReport> Transfer::open_reports() const {
  std::vector<OpenReport> reports;
  auto rows = outbox_.prepare("SELECT airframe, number, document FROM installed WHERE stage = 'new' ORDER BY airframe");
  while (rows.step()) reports.push_back({std::string(rows.text(0)), rows.integer(1), std::string(rows.text(2))});
  return reports;
}

void Transfer::report_sent(const OpenReport& report) { end_report(report, "sent", {}); }

void Transfer::report_refused(const OpenReport& report, const std::string& why) { end_report(report, "refused", why); }

void Transfer::end_report(const OpenReport& report, std::string_view stage, const std::string& why) {
  outbox_.transition("report", [&] {
    outbox_.prepare("UPDATE installed SET stage = ?, detail = ? WHERE airframe = ? AND number = ?")
        .bind(1, stage)
        .bind(2, why)
        .bind(3, report.airframe)
        .bind(4, report.number)
        .run();
  });
}

}  // namespace nadir
