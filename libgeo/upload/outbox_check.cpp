#include "upload/outbox_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <set>
#include <string>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "upload/outbox_tables.hpp"

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

[[noreturn]] void refuse(const SqliteDatabase& database, std::string expected, std::string found) {
  throw UsageError({.what = "not an outbox as nadir sync stage makes it",
                    .where = database.path().string(),
                    .expected = std::move(expected),
                    .found = std::move(found),
                    .fix = "somebody has changed it: stage the flight into a new outbox; what has arrived is not sent "
                           "twice"});
}

struct Kind {
  std::string_view name;
  std::string_view rows;  // of one text each
  bool statements;
};

// What a row says with the types that it has: 'STAGED' is another text than X'5354…'.
constexpr std::array<Kind, 3> kKinds{
    {{"tables and triggers", "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL", true},
     {"states", "SELECT quote(name) || ', final ' || quote(final) FROM state", false},
     {"steps", "SELECT quote(before) || ' to ' || quote(after) FROM step", false}}};

void compare(const SqliteDatabase& database, const SqliteDatabase& ours, const Kind& kind, std::int64_t version) {
  const std::string expected = fmt::format("the {} of version {}", kind.name, version);
  const auto text = [&kind](const SqliteStatement& row) {
    return kind.statements ? plain(row.text(0)) : std::string(row.text(0));
  };
  std::set<std::string> missing;
  auto own = ours.prepare(kind.rows);
  while (own.step()) missing.insert(text(own));
  auto rows = database.prepare(kind.rows);
  while (rows.step()) {
    const std::string row = text(rows);
    if (missing.erase(row) == 0) refuse(database, expected, printable("also " + row.substr(0, 80)));
  }
  if (!missing.empty()) refuse(database, expected, "no " + missing.begin()->substr(0, 80));
}

}  // namespace

bool is_empty(const SqliteDatabase& database) { return !database.prepare("SELECT 1 FROM sqlite_master").step(); }

void check_outbox_tables(const SqliteDatabase& database, std::int64_t version) {
  const SqliteDatabase ours = SqliteDatabase::in_memory();
  for (std::int64_t step = 1; step <= version; ++step) ours.execute(std::string(outbox_statements(step)));
  for (const Kind& kind : kKinds) compare(database, ours, kind, version);
}

}  // namespace nadir
