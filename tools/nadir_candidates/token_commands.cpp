// nadir-candidates token create, list and revoke.
#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/random.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/input_file.hpp"
#include "base/printable.hpp"
#include "candidates/file_lock.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "nadir_candidates/access_tokens.hpp"
#include "nadir_candidates/commands.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr int kDefaultTokenDays = 90;
constexpr int kMostTokenDays = 730;
constexpr std::int64_t kTokenDay_s = 86'400;
constexpr std::chrono::seconds kTokenLockPatience{3};  // another command takes milliseconds

// The file of tokens while it is changed: one process at a time, or the change of one of them would be lost.
class TokenFile {
 public:
  enum class Missing { refused, empty };
  TokenFile(fs::path path, Missing missing) : path_(std::move(path)) {
    const fs::path folder = path_.has_parent_path() ? path_.parent_path() : fs::path(".");
    folder_ = FileDescriptor(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (!folder_) {
      throw Error({.what = "cannot use the folder of the token file",
                   .where = folder,
                   .found = system_error_text(errno),
                   .fix = "create the folder, or check its owner"});
    }
    lock_.emplace(folder_.get(), kTokenLockPatience, "the folder of the token file", folder);
    if (missing == Missing::empty && !fs::exists(fs::symlink_status(path_))) return;
    tokens = parse_tokens(read_text_file(path_, kMaxTokenFile), path_.string());
  }

  void write() const {
    const std::string text = tokens_json(tokens);
    parse_tokens(text, path_.string());  // what a service would refuse is not written
    write_file_atomic(path_, text, 0600);
  }

  std::vector<AccessToken> tokens;

 private:
  fs::path path_;
  FileDescriptor folder_;
  std::optional<FileLock> lock_;  // before folder_ is closed
};

// 192 bits of the operating system's randomness.
std::string new_secret() {
  std::array<std::uint8_t, 24> bytes{};
  if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    throw Error({.what = "the operating system provides no randomness for a token"});
  }
  std::string secret;
  for (const std::uint8_t byte : bytes) secret += fmt::format("{:02x}", byte);
  return secret;
}

std::string scopes_text(const AccessToken& token) {
  std::vector<std::string_view> names;
  for (const TokenScope scope : token.scopes) names.push_back(name_of(scope));
  return fmt::format("{}", fmt::join(names, ","));
}

class TokenCreateCommand final : public Command {
 public:
  std::string_view group() const override { return "token"; }
  std::string_view name() const override { return "create"; }
  std::string_view summary() const override { return "create a client's token, with scope and expiry"; }
  std::string_view details() const override {
    return R"(The token goes to --out, readable by its owner only: give that file to the client. --tokens keeps its
SHA-256 alone. A running service takes the new token within a second. A token that replaces another one gets
the same --client, so that uploads which the old one opened go on.)";
  }
  std::string_view examples() const override {
    return R"(nadir-candidates token create --tokens tokens.json --id ground-1 --out ground-1.token
nadir-candidates token create --tokens tokens.json --id ground-1b --client ground-1 --airframe mini-07 \
    --days 30 --out ground-1b.token
nadir-candidates token create --tokens tokens.json --id dashboard --scope read --out dashboard.token)";
  }
  void setup(Options& options) override {
    options.value("--tokens", tokens_, "FILE", "file of the service's tokens; created if missing").required();
    options.value("--id", id_, "ID", "the token's name in lists and in the audit log").required();
    options.value("--out", out_, "FILE", "file to create with the token").required();
    options.value("--client", client_, "NAME", "whose uploads these are; the id without it");
    options.value("--scope", scope_, "SCOPE", "what it may do: upload, read, or both")
        .one_of({"upload", "read", "both"});
    options.values("--airframe", airframes_, "AIRFRAME", "airframes that it may upload for; all without it");
    options.value("--days", days_, "N", "days until it expires").between(1, kMostTokenDays);
  }
  int run(Context& context) override {
    if (fs::exists(fs::symlink_status(out_))) {
      throw UsageError({.what = "the output already exists", .where = out_, .fix = "choose another --out"});
    }
    TokenFile file(tokens_, TokenFile::Missing::empty);
    const bool taken = std::any_of(file.tokens.begin(), file.tokens.end(),
                                   [this](const AccessToken& token) { return token.id == id_; });
    if (taken) {
      throw UsageError({.what = "another token already has this id",
                        .where = tokens_,
                        .found = printable(id_),
                        .fix = "choose another --id; with the same --client it continues the uploads of this one"});
    }
    const std::string secret = new_secret();
    AccessToken token{.id = id_,
                      .client = client_.value_or(id_),
                      .airframes = airframes_,
                      .expires = UtcTime{context.clock.now().unix_s + days_ * kTokenDay_s},
                      .sha256 = sha256(as_bytes(secret))};
    if (scope_ != "read") token.scopes.insert(TokenScope::upload);
    if (scope_ != "upload") token.scopes.insert(TokenScope::read);
    file.tokens.push_back(token);
    write_file_atomic(out_, secret + "\n", 0600);
    try {
      file.write();
    } catch (...) {
      fs::remove(out_);  // a token that nobody knows
      throw;
    }
    context.out << fmt::format("{}: {} until {}\n", token.id, scopes_text(token), to_rfc3339(*token.expires));
    return kAccepted;
  }

 private:
  fs::path tokens_, out_;
  std::string id_;
  std::optional<std::string> client_;
  std::string scope_ = "upload";
  std::vector<std::string> airframes_;
  int days_ = kDefaultTokenDays;
};

class TokenListCommand final : public Command {
 public:
  std::string_view group() const override { return "token"; }
  std::string_view name() const override { return "list"; }
  std::string_view summary() const override { return "list the tokens of a service"; }
  std::string_view examples() const override { return "nadir-candidates token list --tokens tokens.json"; }
  bool offers_json() const override { return true; }
  void setup(Options& options) override {
    options.value("--tokens", tokens_, "FILE", "file of the service's tokens").required();
  }
  int run(Context& context) override {
    const std::vector<AccessToken> tokens = parse_tokens(read_text_file(tokens_, kMaxTokenFile), tokens_.string());
    const UtcTime now = context.clock.now();
    nlohmann::json list = nlohmann::json::array();
    for (const AccessToken& token : tokens) {
      const bool expired = *token.expires <= now;
      if (context.json) {
        list.push_back({{"id", token.id},
                        {"client", token.client},
                        {"scope", scopes_text(token)},
                        {"airframes", token.airframes},
                        {"expires", to_rfc3339(*token.expires)},
                        {"expired", expired}});
        continue;
      }
      context.out << fmt::format(
          "{}  client {}  {}  {} {}{}\n", token.id, token.client, scopes_text(token), expired ? "expired" : "until",
          to_rfc3339(*token.expires),
          token.airframes.empty() ? std::string() : fmt::format("  for {}", fmt::join(token.airframes, ", ")));
    }
    if (context.json) print_json(context.out, {{"tokens", std::move(list)}});
    return kAccepted;
  }

 private:
  fs::path tokens_;
};

class TokenRevokeCommand final : public Command {
 public:
  std::string_view group() const override { return "token"; }
  std::string_view name() const override { return "revoke"; }
  std::string_view summary() const override { return "take a token out of the service's file"; }
  std::string_view details() const override {
    return R"(A running service refuses the token within a second. What it uploaded stays, and is judged like any other:
tiles are trusted for their airframe's key, never for the token.)";
  }
  std::string_view examples() const override {
    return "nadir-candidates token revoke --tokens tokens.json --id ground-1";
  }
  void setup(Options& options) override {
    options.value("--tokens", tokens_, "FILE", "file of the service's tokens").required();
    options.value("--id", id_, "ID", "the token's name").required();
  }
  int run(Context& context) override {
    TokenFile file(tokens_, TokenFile::Missing::refused);
    if (std::erase_if(file.tokens, [this](const AccessToken& token) { return token.id == id_; }) == 0) {
      throw UsageError({.what = "no token has this id",
                        .where = tokens_,
                        .found = printable(id_),
                        .fix = "nadir-candidates token list shows the ids"});
    }
    file.write();
    context.out << fmt::format("revoked: {}\n", printable(id_));
    return kAccepted;
  }

 private:
  fs::path tokens_;
  std::string id_;
};

}  // namespace

std::unique_ptr<Command> make_token_create() { return std::make_unique<TokenCreateCommand>(); }
std::unique_ptr<Command> make_token_list() { return std::make_unique<TokenListCommand>(); }
std::unique_ptr<Command> make_token_revoke() { return std::make_unique<TokenRevokeCommand>(); }

}  // namespace nadir
