#include "upload/outbox_report.hpp"

#include "base/error.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kLatest_ms = 253'402'300'799'999;  // 9999-12-31T23:59:59.999Z

[[noreturn]] void refuse(std::string expected, std::string_view found) {
  throw Error({.what = "the outbox is damaged",
               .expected = std::move(expected),
               .found = std::string(found.substr(0, 80)),
               .fix = "check the disk; stage the flight into a new outbox: what has arrived is not sent twice"});
}

}  // namespace

OutboxReport report_outbox(const OutboxDatabase& outbox) {
  OutboxReport report;
  for (const TileState state : kTileStates) report.states[state] = {};
  auto states = outbox.prepare("SELECT state, count(*), sum(size) FROM tile GROUP BY state");
  while (states.step()) {
    const auto state = parse_tile_state(states.text(0));
    if (!state) refuse("a state of a tile", std::string(states.text(0)));
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
    if (not_before_ms < 0 || not_before_ms > kLatest_ms) refuse("a time before the year 10000", batches.text(5));
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

}  // namespace nadir
