// The secret by which a caller of the service's API shows that it may call. Kept in a file, never on a command line.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace nadir {

// The file holds one line of at least 16 printable characters without spaces, and only its owner may read it. Throws
// Error otherwise.
std::string read_bearer_token(const std::filesystem::path& path);

// The same for a token that comes from elsewhere, with the name of the place for messages. The token is never in them.
std::string checked_bearer_token(std::string token, std::string_view where);

}  // namespace nadir
