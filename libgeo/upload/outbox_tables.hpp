// The tables of an outbox, version by version (the texts outbox*.sql): they lay one out, bring an older one up to date,
// and say what must stand in one that is opened.
#pragma once

#include <cstdint>
#include <string_view>

namespace nadir {

inline constexpr std::int64_t kOutboxVersion = 3;

// The statements that make this version of the one before it; version 1 of an empty database.
std::string_view outbox_statements(std::int64_t version);

}  // namespace nadir
