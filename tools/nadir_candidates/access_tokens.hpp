// Who may call the service, and for what: bearer tokens, each with an id, a scope, an expiry and the airframes that it
// may upload for. On disk stands a token's SHA-256 alone: whoever reads the file can call nobody.
//   {"schema": "nadir.tokens/1", "tokens": [{"id", "client", "scope": ["upload", "read"], "airframes": […],
//    "expires", "sha256"}]}
// docs/formats/tokens.md. The file is made by `nadir-candidates token`; a running service reads it again when it
// changes.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "base/digest.hpp"
#include "base/time.hpp"
#include "candidates/candidate_service.hpp"

namespace nadir {

enum class TokenScope {
  upload,  // announce, send, complete, ask for verdicts, bring aircraft's reports
  read     // what aircraft reported
};
std::string_view name_of(TokenScope scope);

inline constexpr std::size_t kMaxTokens = 1024;
inline constexpr std::uint64_t kMaxTokenFile = std::uint64_t{1} << 20;

struct AccessToken {
  std::string id;      // 1 to 64 of A-Z a-z 0-9 . _ -
  std::string client;  // whose uploads they are: a token that follows another keeps its client
  std::set<TokenScope> scopes{};
  std::vector<std::string> airframes{};  // empty: all
  std::optional<UtcTime> expires{};      // none: only of --token-file
  Sha256 sha256{};                       // of the token
};

// Form only; throws Error, naming the member. No id and no token twice.
std::vector<AccessToken> parse_tokens(std::string_view text, std::string_view name);
std::string tokens_json(const std::vector<AccessToken>& tokens);

// The tokens of one service, from files of two kinds.
class Clients {
 public:
  struct Client {
    UploadClient client;
    AccessToken token;
  };

  // token_files: each "FILE", for every airframe, or "AIRFRAME=FILE", with one token that does not expire; the same
  // file may be given for several airframes, and its name is the client's. tokens: a file of parse_tokens(). Throws
  // Error, and UsageError where two would share an id or a token.
  explicit Clients(const std::vector<std::string>& token_files,
                   std::optional<std::filesystem::path> tokens = std::nullopt);

  // Null: unknown. Expired ones are found, so that the caller learns why.
  std::shared_ptr<const Client> find(std::string_view authorization) const;

  // Reads the file of tokens again; true when other tokens hold now. One that is missing or malformed changes nothing,
  // and fault() says why.
  bool reload();
  std::string fault() const;  // empty: none

  std::vector<AccessToken> all() const;
  std::filesystem::path file() const { return file_.value_or(std::filesystem::path()); }  // of parse_tokens()

 private:
  using ByDigest = std::map<Sha256, std::shared_ptr<const Client>>;
  ByDigest read_tokens(const std::string& text) const;

  const std::optional<std::filesystem::path> file_;
  ByDigest fixed_;  // of --token-file
  mutable std::mutex mutex_;
  ByDigest clients_;
  std::string text_;
  std::string fault_;
};

}  // namespace nadir
