#include "recorder/withheld.hpp"

#include <algorithm>
#include <cctype>

namespace nadir {

std::string without_secrets(std::string_view name, std::string_view value) {
  std::string lower(name);
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  bool secret = value.find("PRIVATE KEY") != std::string_view::npos;
  for (const char* word : {"key", "signature", "passphrase", "password", "secret", "token"}) {
    secret = secret || lower.find(word) != std::string::npos;
  }
  return secret ? "[withheld]" : std::string(value);
}

}  // namespace nadir
