// What to do about a database that fails: the messages of SQLite and PostgreSQL, and the advice that goes with each.
#pragma once

#include <string>
#include <string_view>

namespace nadir {

// The first advice whose sign is in the message; a general one when none is.
std::string advice_for_database_message(std::string_view message);

}  // namespace nadir
