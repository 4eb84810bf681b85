// The catalogue's votes and promotions.
#include <fmt/format.h>

#include <algorithm>

#include "candidates/candidate_catalogue.hpp"
#include "candidates/catalogue_transaction.hpp"
#include "catalogue/geometry.hpp"

namespace nadir {
namespace {

using Insert = CatalogueDatabase::Insert;

TileKey key_from(const CatalogueRow& row) {
  return {static_cast<std::uint8_t>(row.integer("z")), static_cast<std::uint32_t>(row.integer("x")),
          static_cast<std::uint32_t>(row.integer("y"))};
}

// Every tile of these addresses, which the caller has sorted.
std::string at_any(const char* table, std::span<const Ballot> ballots) {
  std::string text;
  for (const Ballot& ballot : ballots) {
    text += fmt::format("{0}({1}.z={2} AND {1}.x={3} AND {1}.y={4})", text.empty() ? "" : " OR ", table, ballot.key.z,
                        ballot.key.x, ballot.key.y);
  }
  return text;
}

Ballot& of(std::vector<Ballot>& ballots, const TileKey& key) {
  return *std::lower_bound(ballots.begin(), ballots.end(), key,
                           [](const Ballot& ballot, const TileKey& wanted) { return ballot.key < wanted; });
}

// The voters' ids as SQL lists them, to go on with after others.
std::string ids_of(const Ballot& ballot, bool first) {
  std::string text;
  for (const Voter& voter : ballot.voters) text += fmt::format("{}{}", first && text.empty() ? "" : ",", voter.tile);
  return text;
}

}  // namespace

std::vector<Ballot> CandidateCatalogue::ballots(std::size_t limit, const std::set<TileKey>& but) {
  std::vector<Ballot> ballots;
  std::string others;
  for (const TileKey& key : but) {
    others +=
        fmt::format("{}({},{},{})", others.empty() ? " AND (t.z, t.x, t.y) NOT IN (VALUES " : ",", key.z, key.x, key.y);
  }
  if (!others.empty()) others += ")";
  database_.select(fmt::format("SELECT DISTINCT t.z AS z, t.x AS x, t.y AS y FROM {} v JOIN {} t ON t.id = v.tile "
                               "WHERE v.to_vote = 1{} LIMIT {}",
                               database_.of("verdicts"), database_.of("tiles"), others, limit),
                   [&ballots](const CatalogueRow& row) { ballots.push_back({.key = key_from(row)}); });
  if (ballots.empty()) return ballots;
  std::sort(ballots.begin(), ballots.end(), [](const Ballot& a, const Ballot& b) { return a.key < b.key; });
  database_.select(
      fmt::format("SELECT t.id AS id, t.z AS z, t.x AS x, t.y AS y, t.sidecar AS sidecar, b.pack AS pack, "
                  "b.start AS start, b.bytes AS bytes FROM {} t JOIN {} v ON v.tile = t.id JOIN {} b ON "
                  "b.sha256 = t.sha256 WHERE v.verdict = 0 AND ({}) ORDER BY t.id",
                  database_.of("tiles"), database_.of("verdicts"), database_.of("blobs"), at_any("t", ballots)),
      [&ballots](const CatalogueRow& row) {
        of(ballots, key_from(row))
            .voters.push_back({.tile = row.integer("id"),
                               .sidecar = parse_candidate(row.text("sidecar"), "the catalogue's sidecar"),
                               .blob = blob_from(row)});
      });
  database_.select(
      fmt::format("SELECT t.z AS z, t.x AS x, t.y AS y, w.tile AS tile, w.other AS other, w.shift_mm AS "
                  "shift_mm, w.allowed_mm AS allowed_mm, w.correlation_ppm AS correlation_ppm, w.agrees AS "
                  "agrees FROM {} w JOIN {} t ON t.id = w.tile WHERE {} ORDER BY w.id",
                  database_.of("votes"), database_.of("tiles"), at_any("t", ballots)),
      [&ballots](const CatalogueRow& row) {
        of(ballots, key_from(row))
            .votes.push_back({.tile = row.integer("tile"),
                              .other = row.integer("other"),
                              .shift_mm = row.integer("shift_mm"),
                              .allowed_mm = row.integer("allowed_mm"),
                              .correlation_ppm = row.integer("correlation_ppm"),
                              .agrees = row.integer("agrees") == 1});
      });
  database_.select(
      fmt::format("SELECT p.z AS z, p.x AS x, p.y AS y, p.tile AS tile FROM {} p WHERE p.current = 1 AND ({})",
                  database_.of("promotions"), at_any("p", ballots)),
      [&ballots](const CatalogueRow& row) { of(ballots, key_from(row)).promoted = row.integer("tile"); });
  return ballots;
}

void CandidateCatalogue::close(std::span<const Ballot> ballots, std::span<const Outcome> outcomes) {
  CatalogueTransaction transaction(database_);
  std::string voters;
  for (const Ballot& ballot : ballots) voters += ids_of(ballot, voters.empty());
  if (voters.empty()) return;
  std::set<std::int64_t> gone;  // withdrawn while they were voted on
  database_.select(
      fmt::format("SELECT tile FROM {} WHERE verdict <> 0 AND tile IN ({})", database_.of("verdicts"), voters),
      [&gone](const CatalogueRow& row) { gone.insert(row.integer("tile")); });
  const auto stands = [&gone](const Ballot& ballot) {
    return std::none_of(ballot.voters.begin(), ballot.voters.end(),
                        [&gone](const Voter& voter) { return gone.contains(voter.tile); });
  };
  std::string closed;
  bool voted = false;
  for (std::size_t i = 0; i < ballots.size(); ++i) {
    for (const Vote& vote : outcomes[i].new_votes) {
      CatalogueRow row = database_.new_row("votes");
      row.set("tile", vote.tile)
          .set("other", vote.other)
          .set("shift_mm", vote.shift_mm)
          .set("allowed_mm", vote.allowed_mm)
          .set("correlation_ppm", vote.correlation_ppm)
          .set("agrees", std::int64_t{vote.agrees ? 1 : 0});
      database_.insert("votes", row, Insert::bulk);
      voted = true;
    }
    if (stands(ballots[i])) closed += ids_of(ballots[i], closed.empty());
  }
  if (voted) database_.finish_bulk("votes");
  if (!closed.empty()) {
    database_.change(
        fmt::format("UPDATE {} SET to_vote = 0 WHERE to_vote = 1 AND tile IN ({})", database_.of("verdicts"), closed),
        "closing a vote");
  }
  for (std::size_t i = 0; i < ballots.size(); ++i) {
    if (outcomes[i].promotion && stands(ballots[i])) promote(*outcomes[i].promotion);
  }
  transaction.commit();
}

void CandidateCatalogue::promote(const Promotion& promotion) {
  const TileKey& key = promotion.key;
  database_.change(fmt::format("UPDATE {} SET current = 0 WHERE current = 1 AND z = {} AND x = {} AND y = {}",
                               database_.of("promotions"), key.z, key.x, key.y),
                   "replacing a promoted tile");
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
  database_.insert("promotions", row, Insert::one);
}

std::int64_t CandidateCatalogue::withdraw(const std::set<std::string>& keys) {
  std::string list;
  for (const std::string& key : keys) {
    if (Sha256::from_hex(key)) list += fmt::format("{}'{}'", list.empty() ? "" : ",", key);
  }
  if (list.empty()) return 0;
  const std::string tiles = database_.of("tiles"), verdicts = database_.of("verdicts");
  const std::string theirs = fmt::format("FROM {} t JOIN {} v ON v.tile = t.id WHERE v.verdict = 0 AND t.keyid IN ({})",
                                         tiles, verdicts, list);
  CatalogueTransaction transaction(database_);
  const std::int64_t count = number("SELECT count(*) AS n " + theirs);
  if (count == 0) return 0;
  const std::string there = fmt::format("(z, x, y) IN (SELECT t.z, t.x, t.y {})", theirs);
  database_.change(fmt::format("UPDATE {} SET current = 0 WHERE current = 1 AND {}", database_.of("promotions"), there),
                   "taking promotions back");
  database_.change(fmt::format("UPDATE {} SET to_vote = 1 WHERE verdict = 0 AND tile IN (SELECT id FROM {} WHERE {})",
                               verdicts, tiles, there),
                   "asking for votes again");
  database_.change(fmt::format("UPDATE {} SET verdict = {}, code = '{}', detail = '{}', to_vote = 0 WHERE verdict = 0 "
                               "AND tile IN (SELECT id FROM {} WHERE keyid IN ({}))",
                               verdicts, static_cast<int>(Verdict::rejected), name_of(ReasonCode::airframe_revoked),
                               kRevokedLater, tiles, list),
                   "taking verdicts back");
  transaction.commit();
  return count;
}

void CandidateCatalogue::each_promoted(const std::function<void(const PromotedTile&)>& visit) {
  database_.select(
      fmt::format(
          "SELECT p.tile AS tile, p.z AS z, p.x AS x, p.y AS y, p.decided_at AS decided_at, p.flights AS flights, "
          "p.evidence AS evidence, t.sidecar AS sidecar, b.pack AS pack, b.start AS start, b.bytes AS bytes "
          "FROM {} p JOIN {} t ON t.id = p.tile JOIN {} b ON b.sha256 = t.sha256 WHERE p.current = 1 "
          "ORDER BY p.z, p.x, p.y",
          database_.of("promotions"), database_.of("tiles"), database_.of("blobs")),
      [&visit](const CatalogueRow& row) {
        visit({.promotion = {.tile = row.integer("tile"),
                             .key = key_from(row),
                             .decided_ms = row.time("decided_at").value_or(UtcTime()).unix_s * 1000,
                             .flights = row.integer("flights"),
                             .evidence = row.text("evidence")},
               .sidecar = parse_candidate(row.text("sidecar"), "the catalogue's sidecar"),
               .blob = blob_from(row)});
      });
}

}  // namespace nadir
