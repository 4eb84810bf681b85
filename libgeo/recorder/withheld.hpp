// Keys never enter a recording, whatever a caller puts among the settings.
#pragma once

#include <string>
#include <string_view>

namespace nadir {

// The value, or "[withheld]" for one whose name speaks of a key, signature, passphrase, password, secret or token, or
// that contains a private key.
std::string without_secrets(std::string_view name, std::string_view value);

}  // namespace nadir
