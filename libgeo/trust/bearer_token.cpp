#include "trust/bearer_token.hpp"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cstdint>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMinToken = 16;
constexpr std::uint64_t kMaxFile = 4096;

}  // namespace

std::string read_bearer_token(const fs::path& path) {
  std::string token = read_text_file(path, kMaxFile);
  const fs::perms of_others = fs::perms::group_all | fs::perms::others_all;
  if ((fs::status(path).permissions() & of_others) != fs::perms::none) {
    throw Error({.what = "the token file is readable by other users",
                 .where = path.string(),
                 .expected = "mode 0600 or stricter",
                 .fix = fmt::format("chmod 600 {}", path.string())});
  }
  return checked_bearer_token(std::move(token), path.string());
}

std::string read_or_create_bearer_token(const fs::path& path) {
  if (!fs::exists(fs::symlink_status(path))) {
    std::array<std::uint8_t, 24> bytes{};
    if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
      throw Error({.what = "the operating system provides no randomness for a token", .where = path.string()});
    }
    std::string token;
    for (const std::uint8_t byte : bytes) token += fmt::format("{:02x}", byte);
    write_file_atomic(path, token + "\n", 0600);
  }
  return read_bearer_token(path);
}

std::string checked_bearer_token(std::string token, std::string_view where) {
  while (!token.empty() && (token.back() == '\n' || token.back() == '\r')) token.pop_back();
  const bool printable = std::all_of(token.begin(), token.end(), [](char c) { return c > ' ' && c < 0x7f; });
  if (token.size() < kMinToken || !printable) {
    throw Error({.what = "this is not a valid token",
                 .where = std::string(where),
                 .expected = fmt::format("one line of at least {} printable characters without spaces", kMinToken),
                 .fix = "(umask 077; openssl rand -hex 24 > FILE)"});
  }
  return token;
}

}  // namespace nadir
