// Whether an outbox is what our programs made. Its promises (no step but those allowed, no picture gone before its
// verdict) are kept by triggers and two tables inside the file, which may come from a damaged disk or from a stranger.
#pragma once

#include <cstdint>

#include "imagery/sqlite_database.hpp"

namespace nadir {

bool is_empty(const SqliteDatabase& database);  // not one table

// Exactly the tables, indices and triggers of this version, and in the tables that the triggers go by (`state`, `step`)
// exactly its rows. Throws UsageError.
void check_outbox_tables(const SqliteDatabase& database, std::int64_t version);

}  // namespace nadir
