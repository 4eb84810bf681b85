// The statements that make an empty outbox: the text of outbox.sql.
#pragma once

#include <string_view>

namespace nadir::outbox_sql {

extern const std::string_view tables;

}  // namespace nadir::outbox_sql
