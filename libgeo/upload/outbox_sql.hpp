// The statements that make an outbox: the texts of outbox.sql, since version 2 outbox_strikes.sql, and since version 3
// outbox_damaged.sql.
#pragma once

#include <string_view>

namespace nadir::outbox_sql {

extern const std::string_view tables;
extern const std::string_view strikes;
extern const std::string_view damaged;

}  // namespace nadir::outbox_sql
