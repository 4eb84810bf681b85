// The secret that authorizes callers of the service's API. Kept in a file, never on a command line.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace nadir {

// The file holds one line of at least 16 printable characters without spaces, and only its owner may read it. Throws
// Error otherwise.
std::string read_bearer_token(const std::filesystem::path& path);

// The same; a file that is missing is made, with a random token and mode 0600.
std::string read_or_create_bearer_token(const std::filesystem::path& path);

// The same for a token that comes from elsewhere; `where` is for messages, which never contain the token.
std::string checked_bearer_token(std::string token, std::string_view where);

}  // namespace nadir
