#include "upload/outbox_tables.hpp"

#include <array>

#include "upload/outbox_sql.hpp"

namespace nadir {

std::string_view outbox_statements(std::int64_t version) {
  const std::array<std::string_view, kOutboxVersion> all{outbox_sql::tables, outbox_sql::strikes, outbox_sql::damaged};
  return all.at(static_cast<std::size_t>(version - 1));
}

}  // namespace nadir
