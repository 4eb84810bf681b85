// The statements that make an outbox: the texts of outbox.sql and, since version 2, outbox_strikes.sql.
#pragma once

#include <string_view>

namespace nadir::outbox_sql {

extern const std::string_view tables;
extern const std::string_view strikes;

}  // namespace nadir::outbox_sql
