// Strict JSON (RFC 8259) for documents that are signed or come from outside.
//
// nlohmann/json reads more than we want to trust: this refuses duplicate keys, deep nesting and (for manifests)
// floating-point numbers before a document is built.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace nadir {

struct JsonLimits {
  int max_depth = 16;
  bool allow_floats = true;
};

// Throws Error (what, where = name, found) for anything that is not exactly one acceptable document.
nlohmann::json parse_json(std::string_view text, std::string_view name, const JsonLimits& limits = {});

}  // namespace nadir
