#include "candidates/address_work.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <tuple>

#include "base/error.hpp"

namespace nadir {
namespace {

using Insert = CatalogueDatabase::Insert;

constexpr int kWorkOfSilence = 3;  // the last address may take as long again, and the machine be busy

// No two claims of a process have the same number: one of a connection that broke is none of its successor.
std::uint64_t next_claim_number() {
  static std::atomic<std::uint64_t> last = 0;
  return ++last;
}

template <typename Keys>
std::string values_of(const Keys& keys) {
  std::string text;
  for (const TileKey& key : keys)
    text += fmt::format("{}({},{},{})", text.empty() ? "VALUES " : ",", key.z, key.x, key.y);
  return text;
}

// The rows of `table` at these addresses, as t: found by its index for each of them, and not by a walk over the table,
// which a server may prefer by statistics that lag behind.
std::string rows_at(std::span<const TileKey> keys, const std::string& table, const char* t) {
  return fmt::format("({0}) k JOIN {1} {2} ON {2}.z = k.column1 AND {2}.x = k.column2 AND {2}.y = k.column3",
                     values_of(keys), table, t);
}

// A condition more: not at any of these. As one list: SQLite takes at most a thousand conditions in a row.
template <typename Keys>
std::string at_none(const char* t, const Keys& keys) {
  if (keys.empty()) return {};
  return fmt::format(" AND ({0}.z, {0}.x, {0}.y) NOT IN ({1})", t, values_of(keys));
}

// The one at this address. They are in the order of their keys.
AddressTask& of(std::vector<AddressTask>& addresses, const TileKey& key) {
  return *std::lower_bound(addresses.begin(), addresses.end(), key,
                           [](const AddressTask& address, const TileKey& wanted) { return address.key < wanted; });
}

void append_id(std::string& list, std::int64_t id) { list += fmt::format("{}{}", list.empty() ? "" : ",", id); }

// Public keys' ids; what is none cannot have been revoked.
template <typename Ids>
std::string quoted_keys(const Ids& ids) {
  std::string list;
  for (const std::string& id : ids) {
    if (Sha256::from_hex(id)) list += fmt::format("{}'{}'", list.empty() ? "" : ",", id);
  }
  return list;
}

}  // namespace

// The transaction that writes a claim's results and ends it, whatever comes of it. Others that write meanwhile are
// workers at other addresses.
class AddressWork::Writing {
 public:
  Writing(AddressWork& work, const Claim& claim) : database_(work.database_) {
    if (database_.is_server()) {
      if (work.locking_ == 0 || work.locking_ != claim.number) return;
      work.locking_ = 0;
    } else {
      if (work.claimed_.erase(claim.number) == 0) return;
      database_.begin();
    }
    open_ = true;
    if (!database_.is_server()) return;
    try {
      database_.join_writers();
    } catch (...) {
      database_.roll_back();
      throw;
    }
  }
  ~Writing() {
    if (open_) database_.roll_back();
  }
  Writing(const Writing&) = delete;
  Writing& operator=(const Writing&) = delete;

  explicit operator bool() const { return open_; }  // false: the claim was lost
  void commit() {
    database_.commit();
    open_ = false;
  }

 private:
  CatalogueDatabase& database_;
  bool open_ = false;
};

void AddressWork::release(const Claim& claim) {
  claimed_.erase(claim.number);
  if (locking_ == 0 || locking_ != claim.number) return;
  locking_ = 0;
  database_.roll_back();
}

std::string AddressWork::but_claimed() const {
  std::vector<TileKey> keys;
  for (const auto& [number, addresses] : claimed_) keys.insert(keys.end(), addresses.begin(), addresses.end());
  return at_none("t", keys);
}

// Those of tiles t that a statement finds, once for each tile; PostGIS: locked, until the transaction ends.
std::vector<TileKey> AddressWork::lock_addresses(const std::string& from, const std::string& where,
                                                 const std::string& order, std::size_t limit) {
  const bool server = database_.is_server();
  const std::string join =
      server ? fmt::format(" JOIN {} a ON a.z = t.z AND a.x = t.x AND a.y = t.y", database_.of("addresses")) : "";
  std::vector<TileKey> keys;
  if (server) database_.begin_beside_others();
  try {
    database_.select(fmt::format("SELECT t.z AS z, t.x AS x, t.y AS y FROM {}{} WHERE {}{} {} LIMIT {}{}", from, join,
                                 where, but_claimed(), order, limit, server ? " FOR UPDATE OF a SKIP LOCKED" : ""),
                     [&keys](const CatalogueRow& row) { keys.push_back(candidate_rows::key(row)); });
  } catch (...) {
    if (server) database_.roll_back();
    throw;
  }
  if (server && keys.empty()) {
    database_.roll_back();
    end_hung_claims();
  }
  return keys;
}

// The server ends a session that is idle within a transaction for too long. One whose client hangs in the middle of an
// answer, or of rows that it sends, is not idle: the server waits for the rest as long as the client's connection
// stands.
void AddressWork::end_hung_claims() {
  const std::string hung = fmt::format(
      "SELECT a.pid AS pid FROM pg_stat_activity a WHERE a.datname = current_database() AND a.usename = current_user "
      "AND a.state = 'active' AND a.wait_event_type = 'Client' "
      "AND clock_timestamp() - a.state_change > '{} ms'::interval "
      "AND EXISTS (SELECT 1 FROM pg_locks l WHERE l.pid = a.pid AND l.mode = 'RowShareLock' "
      "AND l.relation = '{}'::regclass)",
      database_.silence()->count(), database_.of("addresses"));
  database_.select(fmt::format("SELECT pg_terminate_backend(h.pid) AS ended FROM ({}) h", hung),
                   [](const CatalogueRow&) {});
}

AddressWork::Claim AddressWork::claim_tiles(std::int64_t upload, std::size_t limit, const std::set<std::int64_t>& but) {
  std::string others;
  for (const std::int64_t tile : but) append_id(others, tile);
  if (!others.empty()) others = fmt::format(" AND t.id NOT IN ({})", others);
  std::vector<TileKey> keys =
      lock_addresses(fmt::format("{} t JOIN {} b ON b.sha256 = t.sha256", database_.of("tiles"), database_.of("blobs")),
                     fmt::format("t.upload = {} AND NOT EXISTS (SELECT 1 FROM {} v WHERE v.tile = t.id){}", upload,
                                 database_.of("verdicts"), others),
                     "ORDER BY t.place", limit);
  const bool more = keys.size() == limit;
  Claim claimed = claim(std::move(keys), others);
  claimed.more = more;
  return claimed;
}

AddressWork::Claim AddressWork::claim_votes(std::size_t limit, const std::set<TileKey>& but) {
  return claim(
      lock_addresses(fmt::format("{} v JOIN {} t ON t.id = v.tile", database_.of("verdicts"), database_.of("tiles")),
                     "v.to_vote = 1" + at_none("t", but), "", limit),
      "");
}

// Reads what is at the addresses once they are ours: who had them before has committed. PostGIS: they are locked.
AddressWork::Claim AddressWork::claim(std::vector<TileKey> keys, const std::string& but_tiles) {
  if (keys.empty()) return {};
  std::ranges::sort(keys);
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());  // several tiles may have asked for one
  Claim claim{.number = next_claim_number()};
  if (const auto silence = database_.silence()) claim.work_time = *silence / kWorkOfSilence;
  std::vector<AddressTask>& addresses = claim.addresses;
  for (const TileKey& key : keys) addresses.push_back({.key = key, .standing = {.key = key}});
  if (database_.is_server()) {
    locking_ = claim.number;
  } else {
    claimed_.emplace(claim.number, keys);
  }
  try {
    read_waiting(addresses, keys, but_tiles);
    read_standing(addresses, keys);
  } catch (...) {
    release(claim);
    throw;
  }
  return claim;
}

void AddressWork::read_waiting(std::vector<AddressTask>& addresses, std::span<const TileKey> keys,
                               const std::string& but_tiles) {
  std::vector<TileRow> waiting =
      candidate_rows::select_tiles(database_, rows_at(keys, database_.of("tiles"), "t"),
                                   fmt::format("u.state = {} AND v.id IS NULL AND b.id IS NOT NULL{}",
                                               static_cast<int>(UploadState::judging), but_tiles),
                                   true);
  std::ranges::sort(waiting, {}, &TileRow::id);
  for (TileRow& tile : waiting) of(addresses, tile.key).waiting.push_back(std::move(tile));
}

void AddressWork::read_standing(std::vector<AddressTask>& addresses, std::span<const TileKey> keys) {
  bool several = false;  // else there are no votes to be read
  database_.select(
      fmt::format("SELECT t.id AS id, t.z AS z, t.x AS x, t.y AS y, t.sidecar AS sidecar, b.pack AS pack, "
                  "b.start AS start, b.bytes AS bytes, v.to_vote AS to_vote FROM {} JOIN {} v ON v.tile = t.id "
                  "JOIN {} b ON b.sha256 = t.sha256 WHERE v.verdict = 0",
                  rows_at(keys, database_.of("tiles"), "t"), database_.of("verdicts"), database_.of("blobs")),
      [&](const CatalogueRow& row) {
        AddressCandidates& standing = of(addresses, candidate_rows::key(row)).standing;
        standing.candidates.push_back({.tile = row.integer("id"),
                                       .sidecar = parse_candidate(row.text("sidecar"), "the catalogue's sidecar"),
                                       .blob = candidate_rows::blob(row)});
        standing.open = standing.open || row.integer("to_vote") == 1;
        several = several || standing.candidates.size() > 1;
      });
  for (AddressTask& address : addresses) std::ranges::sort(address.standing.candidates, {}, &AcceptedCandidate::tile);
  if (!several) return;
  database_.select(
      fmt::format("SELECT t.z AS z, t.x AS x, t.y AS y, w.tile AS tile, w.other AS other, w.shift_mm AS "
                  "shift_mm, w.allowed_mm AS allowed_mm, w.correlation_ppm AS correlation_ppm, w.agrees AS "
                  "agrees FROM {} JOIN {} w ON w.tile = t.id",
                  rows_at(keys, database_.of("tiles"), "t"), database_.of("votes")),
      [&addresses](const CatalogueRow& row) {
        of(addresses, candidate_rows::key(row))
            .standing.votes.push_back({.tile = row.integer("tile"),
                                       .other = row.integer("other"),
                                       .shift_mm = row.integer("shift_mm"),
                                       .allowed_mm = row.integer("allowed_mm"),
                                       .correlation_ppm = row.integer("correlation_ppm"),
                                       .agrees = row.integer("agrees") == 1});
      });
  database_.select(fmt::format("SELECT p.z AS z, p.x AS x, p.y AS y, p.tile AS tile, p.evidence AS evidence FROM {} "
                               "WHERE p.current = 1",
                               rows_at(keys, database_.of("promotions"), "p")),
                   [&addresses](const CatalogueRow& row) {
                     AddressCandidates& standing = of(addresses, candidate_rows::key(row)).standing;
                     standing.promoted = row.integer("tile"), standing.evidence = row.text("evidence");
                   });
}

bool AddressWork::write(const Claim& claim, std::span<AddressResult> results, std::int64_t now_ms,
                        const std::set<std::string>& revoked) {
  if (results.empty()) {
    release(claim);
    return true;
  }
  Writing writing(*this, claim);
  if (!writing) return false;
  const std::set<std::string> revoked_now = with_noted_keys(revoked, results);
  const std::set<std::int64_t> withdrawn = withdrawn_among(results);
  std::vector<TileVerdict> verdicts;
  std::vector<Vote> votes;
  std::vector<Promotion> promotions;
  std::vector<TileKey> replaced;
  std::vector<Sha256> damaged;
  std::string closed;
  for (AddressResult& result : results) {
    bool stands = std::ranges::none_of(result.standing, [&](std::int64_t tile) { return withdrawn.contains(tile); });
    for (AddressResult::Judged& tile : result.judged) {
      if (tile.damaged) damaged.push_back(tile.sha256);
      if (!revoked_now.contains(tile.keyid)) continue;
      stands = stands && tile.verdict.verdict != Verdict::accepted;
      tile.verdict = revoked_verdict(tile.verdict.tile);
    }
    const bool voted = stands && result.outcome;
    for (AddressResult::Judged& tile : result.judged) {
      tile.verdict.voted = voted;
      verdicts.push_back(std::move(tile.verdict));
    }
    if (!voted) continue;
    for (const std::int64_t tile : result.standing) append_id(closed, tile);
    votes.insert(votes.end(), result.outcome->new_votes.begin(), result.outcome->new_votes.end());
    if (!result.outcome->promotion) continue;
    promotions.push_back(*result.outcome->promotion);
    if (result.promoted) replaced.push_back(result.key);
  }
  candidate_rows::insert_verdicts(database_, verdicts, now_ms);
  add_votes(votes);
  if (!closed.empty()) {
    database_.change(
        fmt::format("UPDATE {} SET to_vote = 0 WHERE to_vote = 1 AND tile IN ({})", database_.of("verdicts"), closed),
        "closing a vote");
  }
  if (!replaced.empty()) {
    database_.change(fmt::format("UPDATE {} SET current = 0 WHERE current = 1 AND (z, x, y) IN ({})",
                                 database_.of("promotions"), values_of(replaced)),
                     "replacing promoted tiles");
  }
  add_promotions(promotions);
  forget_bytes(damaged);
  writing.commit();
  return true;
}

// And those that a service has withdrawn since, of the ones that signed.
std::set<std::string> AddressWork::with_noted_keys(std::set<std::string> revoked,
                                                   std::span<const AddressResult> results) {
  std::set<std::string> signers;
  for (const AddressResult& result : results) {
    for (const AddressResult::Judged& tile : result.judged) signers.insert(tile.keyid);
  }
  const std::string list = quoted_keys(signers);
  if (!database_.is_server() || list.empty()) return revoked;
  database_.select(fmt::format("SELECT keyid FROM {} WHERE keyid IN ({})", database_.of("revoked_keys"), list),
                   [&revoked](const CatalogueRow& row) { revoked.insert(row.text("keyid")); });
  return revoked;
}

std::set<std::int64_t> AddressWork::withdrawn_among(std::span<const AddressResult> results) {
  std::string tiles;
  std::set<std::int64_t> withdrawn;
  for (const AddressResult& result : results) {
    for (const std::int64_t tile : result.standing) append_id(tiles, tile);
  }
  if (tiles.empty()) return withdrawn;
  database_.select(
      fmt::format("SELECT tile FROM {} WHERE verdict <> 0 AND tile IN ({})", database_.of("verdicts"), tiles),
      [&withdrawn](const CatalogueRow& row) { withdrawn.insert(row.integer("tile")); });
  return withdrawn;
}

void AddressWork::add_votes(std::span<const Vote> votes) {
  for (const Vote& vote : votes) {
    CatalogueRow row = database_.new_row("votes");
    row.set("tile", vote.tile)
        .set("other", vote.other)
        .set("shift_mm", vote.shift_mm)
        .set("allowed_mm", vote.allowed_mm)
        .set("correlation_ppm", vote.correlation_ppm)
        .set("agrees", std::int64_t{vote.agrees ? 1 : 0});
    database_.insert("votes", row, Insert::bulk);
  }
  if (!votes.empty()) database_.finish_bulk("votes");
}

void AddressWork::forget_bytes(std::span<const Sha256> tiles) {
  if (tiles.empty()) return;
  const std::string digests = candidate_rows::quoted(tiles);
  database_.change(
      fmt::format("DELETE FROM {0} WHERE sha256 IN ({1}) AND sha256 NOT IN (SELECT t.sha256 FROM {2} t LEFT JOIN {3} v "
                  "ON v.tile = t.id WHERE t.sha256 IN ({1}) AND (v.verdict IS NULL OR v.verdict = 0))",
                  database_.of("blobs"), digests, database_.of("tiles"), database_.of("verdicts")),
      "removing damaged tiles");
}

void AddressWork::add_promotions(std::span<const Promotion> promotions) {
  for (const Promotion& promotion : promotions) {
    const TileKey& key = promotion.key;
    CatalogueRow row = database_.new_row("promotions");
    row.set("tile", promotion.tile)
        .set("z", std::int64_t{key.z})
        .set("x", std::int64_t{key.x})
        .set("y", std::int64_t{key.y})
        .set("decided_at", UtcTime{promotion.decided_ms / 1000})
        .set("flights", promotion.flights)
        .set("evidence", promotion.evidence)
        .set("current", std::int64_t{1})
        .shape(polygon_geometry(area_of(key)));
    database_.insert("promotions", row, Insert::bulk);
  }
  if (!promotions.empty()) database_.finish_bulk("promotions");
}

std::int64_t AddressWork::withdraw(const std::set<std::string>& keys) {
  const std::string list = quoted_keys(keys);
  if (list.empty()) return 0;
  const std::string tiles = database_.of("tiles"), verdicts = database_.of("verdicts");
  const std::string theirs = fmt::format("FROM {} t JOIN {} v ON v.tile = t.id WHERE v.verdict = 0 AND t.keyid IN ({})",
                                         tiles, verdicts, list);
  const std::string there = fmt::format("(z, x, y) IN (SELECT t.z, t.x, t.y {})", theirs);
  CatalogueTransaction transaction(database_);
  for (const std::string& key : keys) {  // a worker that is judging its tiles finds it when it writes
    if (!database_.is_server() || !Sha256::from_hex(key)) continue;
    database_.change(
        fmt::format("INSERT INTO {} (keyid) VALUES ('{}') ON CONFLICT DO NOTHING", database_.of("revoked_keys"), key),
        "noting a revoked key");
  }
  std::int64_t count = 0;
  database_.select("SELECT count(*) AS n " + theirs, [&count](const CatalogueRow& row) { count = row.integer("n"); });
  if (count > 0) {
    database_.change(
        fmt::format("UPDATE {} SET current = 0 WHERE current = 1 AND {}", database_.of("promotions"), there),
        "revoking promotions");
    database_.change(fmt::format("UPDATE {} SET to_vote = 1 WHERE verdict = 0 AND tile IN (SELECT id FROM {} WHERE {})",
                                 verdicts, tiles, there),
                     "requesting new votes");
    database_.change(
        fmt::format("UPDATE {} SET verdict = {}, code = '{}', detail = '{}', to_vote = 0 WHERE verdict = 0 "
                    "AND tile IN (SELECT id FROM {} WHERE keyid IN ({}))",
                    verdicts, static_cast<int>(Verdict::rejected), name_of(ReasonCode::airframe_revoked), kRevokedLater,
                    tiles, list),
        "revoking verdicts");
  }
  transaction.commit();
  return count;
}

}  // namespace nadir
