#include "sync/outbox_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <string>

#include "base/error.hpp"
#include "sync/outbox_sql.hpp"
#include "sync/tile_state.hpp"

namespace nadir {
namespace {

// SQLite keeps a statement as it was written. Comments and blanks may have changed since.
std::string plain(std::string_view sql) {
  std::string result;
  for (std::size_t at = 0; at < sql.size(); ++at) {
    if (sql.substr(at, 2) == "--") at = std::min(sql.find('\n', at), sql.size());
    const bool blank = at >= sql.size() || sql[at] == ' ' || sql[at] == '\n';
    if (!blank) {
      result += sql[at];
    } else if (!result.empty() && result.back() != ' ') {
      result += ' ';
    }
  }
  return result;
}

std::size_t statements_in(std::string_view sql) {
  std::size_t count = 0;
  for (std::size_t at = sql.find("CREATE "); at != std::string_view::npos; at = sql.find("CREATE ", at + 1)) ++count;
  return count;
}

[[noreturn]] void refuse(const SqliteDatabase& database, std::string expected, std::string found) {
  throw UsageError({.what = "not an outbox as nadir sync stage makes it",
                    .where = database.path().string(),
                    .expected = std::move(expected),
                    .found = std::move(found),
                    .fix = "somebody has changed it: stage the flight into a new outbox; what has arrived is not sent "
                           "twice"});
}

}  // namespace

bool is_empty(const SqliteDatabase& database) { return !database.prepare("SELECT 1 FROM sqlite_master").step(); }

void check_outbox_tables(const SqliteDatabase& database, std::int64_t version) {
  const std::string known = plain(outbox_sql::tables) + (version < 2 ? std::string() : plain(outbox_sql::strikes));
  const std::string expected = fmt::format("the tables of version {}", version);
  std::set<std::string> there;
  auto rows = database.prepare("SELECT name, sql FROM sqlite_master WHERE sql IS NOT NULL");
  while (rows.step()) {
    const std::string statement = plain(rows.text(1)) + ";";
    const bool ours = statement.starts_with("CREATE ") && known.find(statement) != std::string::npos;
    if (!ours || !there.insert(statement).second) refuse(database, expected, "another " + std::string(rows.text(0)));
  }
  if (there.size() != statements_in(known)) refuse(database, expected, "fewer");

  std::set<TileState> states;
  auto state = database.prepare("SELECT name, iif(final, 1, 0) FROM state WHERE typeof(name) = 'text'");
  while (state.step()) {
    const auto name = parse_tile_state(state.text(0));
    if (!name || is_final(*name) != (state.integer(1) != 0)) {
      refuse(database, "the states of this program", fmt::format("{} {}", state.text(0), state.integer(1)));
    }
    states.insert(*name);
  }
  if (states.size() != kTileStates.size()) refuse(database, "the states of this program", "fewer");
}

}  // namespace nadir
