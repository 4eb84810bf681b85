// The transitions that follow from what the service says about each tile, and the packs made of what it lacks.
#include <fmt/format.h>

#include <map>

#include "base/error.hpp"
#include "upload/pack.hpp"
#include "upload/stored_tile.hpp"
#include "upload/transfer.hpp"

namespace nadir {
namespace {

struct TileRow {
  std::int64_t id = 0;
  TileState state = TileState::sealed;
};

[[noreturn]] void refuse(std::string expected, std::string found) {
  throw WrongAnswer({.what = "the service's answer is not about this batch",
                     .where = "its tiles",
                     .expected = std::move(expected),
                     .found = std::move(found)});
}

[[noreturn]] void refuse_damaged(std::string_view what, const Sha256& digest) {
  throw DamagedBatch({.what = "the outbox is damaged",
                      .where = fmt::format("{} {}", what, digest.hex()),
                      .expected = "the bytes that were staged",
                      .found = "others, or none",
                      .fix = "check the disk; nadir sync retry --key takes the sound tiles into a new batch"});
}

// Rows that make no pack are no rows of ours.
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

// Each tile of the answer is one of the batch, none comes twice, and none that waits for an answer is left out.
class Partition {
 public:
  Partition(const std::map<Sha256, TileRow>& tiles, TileState awaited) : tiles_(tiles), awaited_(awaited) {}

  const TileRow& take(const Sha256& digest) {
    const auto found = tiles_.find(digest);
    if (found == tiles_.end()) refuse("tiles of the batch", digest.hex());
    if (!taken_.emplace(digest, true).second) refuse("each tile once", digest.hex() + " twice");
    return found->second;
  }

  void check_whole() const {
    for (const auto& [digest, row] : tiles_) {
      if (row.state == awaited_ && !taken_.contains(digest))
        refuse("every tile of the batch", "nothing of " + digest.hex());
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
    // After the service forgot an upload, tiles that have their verdict stay what they are. But where it lost them as
    // well, it judges none of the batch until it has all: what is still there of them goes along.
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
      const ByteView picture = blob.bind(1, rows[from + i]).step() ? blob.blob(0) : ByteView();
      if (picture.size() != part[i].size || !is_picture(picture, part[i].sha256.bytes)) {
        refuse_damaged("the picture of tile", part[i].sha256);
      }
      stream.update(picture);
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
    if (!is_picture(bytes, digest)) refuse_damaged("the picture of tile", entry.sha256);
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
  if (answer.upload != batch.upload || answer.batch != batch.uuid) refuse("upload " + batch.upload, answer.upload);
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
      set_stage(batch.id, "announced");  // the service did not keep that all is there: say it again
    }
  });
  return sum;
}

}  // namespace nadir
