#include "nadir_candidates/access_tokens.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "http/access.hpp"
#include "trust/bearer_token.hpp"

namespace nadir {

namespace fs = std::filesystem;

namespace {

constexpr const char* kTokensSchema = "nadir.tokens/1";
constexpr std::size_t kLongestTokenName = 64;
constexpr std::array kTokenScopes{TokenScope::upload, TokenScope::read};

std::string read_name(const JsonReader& in, JsonKey key) {
  const std::string& name = in.text(key, {.least = 1, .most = kLongestTokenName});
  const bool plain = std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' || c == '_' ||
           c == '-';
  });
  if (!plain) in.refuse(key, "letters, digits, '.', '_' and '-'");
  return name;
}

AccessToken read_token(const JsonReader& in) {
  AccessToken token{.id = read_name(in, "id"), .client = read_name(in, "client")};
  const JsonReader scopes = in.array("scope", {.least = 1, .most = kTokenScopes.size()});
  for (std::size_t i = 0; i < scopes.size(); ++i) {
    if (!token.scopes.insert(scopes.choice(i, kTokenScopes)).second) scopes.refuse(i, "each scope once");
  }
  if (const auto airframes = in.optional_array("airframes", {.least = 1, .most = kMaxTokens})) {
    for (std::size_t i = 0; i < airframes->size(); ++i) token.airframes.push_back(read_name(*airframes, i));
  }
  token.expires = in.time("expires");
  token.sha256 = in.digest("sha256");
  in.finish();
  return token;
}

}  // namespace

std::string_view name_of(TokenScope scope) { return scope == TokenScope::upload ? "upload" : "read"; }

std::vector<AccessToken> parse_tokens(std::string_view text, std::string_view name) {
  const nlohmann::json document = parse_json(text, name, {.max_depth = 5, .allow_floats = false});
  const JsonReader in(document, {.name = std::string(name),
                                 .what = "cannot read this token file",
                                 .fix = "create it with nadir-candidates token create"});
  in.expect("schema", kTokensSchema);
  const JsonReader list = in.array("tokens", {.most = kMaxTokens});
  in.finish();
  std::vector<AccessToken> tokens;
  std::set<std::string> ids;
  std::set<Sha256> digests;
  for (std::size_t i = 0; i < list.size(); ++i) {
    tokens.push_back(read_token(list.object(i)));
    if (!ids.insert(tokens.back().id).second) list.refuse(i, "each id once", tokens.back().id);
    if (!digests.insert(tokens.back().sha256).second) list.refuse(i, "each token once", tokens.back().id);
  }
  return tokens;
}

std::string tokens_json(const std::vector<AccessToken>& tokens) {
  nlohmann::json list = nlohmann::json::array();
  for (const AccessToken& token : tokens) {
    nlohmann::json scopes = nlohmann::json::array();
    for (const TokenScope scope : token.scopes) scopes.push_back(name_of(scope));
    nlohmann::json entry{{"id", token.id},
                         {"client", token.client},
                         {"scope", std::move(scopes)},
                         {"expires", to_rfc3339(token.expires.value())},
                         {"sha256", token.sha256.hex()}};
    if (!token.airframes.empty()) entry["airframes"] = token.airframes;
    list.push_back(std::move(entry));
  }
  return nlohmann::json{{"schema", kTokensSchema}, {"tokens", std::move(list)}}.dump(1) + "\n";
}

Clients::Clients(const std::vector<std::string>& token_files, std::optional<fs::path> tokens)
    : file_(std::move(tokens)) {
  std::map<fs::path, std::vector<std::string>> airframes;  // of each file; empty: all
  for (const std::string& text : token_files) {
    const std::size_t equals = text.find('=');
    const bool named = equals != std::string::npos && !fs::exists(text);
    std::vector<std::string>& of_file = airframes[named ? text.substr(equals + 1) : text];
    if (named) of_file.push_back(text.substr(0, equals));
  }
  for (auto& [file, names] : airframes) {
    const std::string name = file.stem().string();
    const bool taken = std::any_of(fixed_.begin(), fixed_.end(),
                                   [&name](const auto& known) { return known.second->client.name == name; });
    if (taken) {
      throw UsageError({.what = "two token files have the same name",
                        .where = file,
                        .expected = "distinct names: they identify the clients",
                        .found = name + " twice",
                        .fix = "rename one of them"});
    }
    const Sha256 digest = sha256(as_bytes(read_bearer_token(file)));
    const auto client =
        std::make_shared<const Client>(Client{.client = {.name = name, .airframes = names, .token = name},
                                              .token = {.id = name,
                                                        .client = name,
                                                        .scopes = {kTokenScopes.begin(), kTokenScopes.end()},
                                                        .airframes = std::move(names),
                                                        .expires = std::nullopt,
                                                        .sha256 = digest}});
    if (!fixed_.emplace(digest, client).second) {
      throw UsageError({.what = "two clients have the same token",
                        .where = file,
                        .expected = "a token of its own for each client",
                        .fix = "make a new one: (umask 077; openssl rand -hex 24 > " + file.string() + ")"});
    }
  }
  clients_ = fixed_;
  if (!file_) return;
  text_ = read_text_file(*file_, kMaxTokenFile);
  clients_ = read_tokens(text_);
}

Clients::ByDigest Clients::read_tokens(const std::string& text) const {
  ByDigest clients = fixed_;
  for (const AccessToken& token : parse_tokens(text, file_->string())) {
    const bool taken = std::any_of(fixed_.begin(), fixed_.end(),
                                   [&token](const auto& known) { return known.second->token.id == token.id; });
    const UploadClient client{.name = token.client, .airframes = token.airframes, .token = token.id};
    if (taken || !clients.emplace(token.sha256, std::make_shared<const Client>(Client{client, token})).second) {
      throw UsageError({.what = "a token of --tokens is also one of --token-file",
                        .where = file_->string(),
                        .expected = "each id and each token in one of the two",
                        .found = token.id,
                        .fix = "leave out the --token-file, or revoke it: nadir-candidates token revoke"});
    }
  }
  return clients;
}

bool Clients::reload() {
  if (!file_) return false;
  const std::lock_guard lock(mutex_);
  try {
    std::string text = read_text_file(*file_, kMaxTokenFile);
    if (text == text_) return false;
    text_ = std::move(text);
    clients_ = read_tokens(text_);
    fault_.clear();
    return true;
  } catch (const Error& error) {
    fault_ = std::string("the token file is rejected, and the tokens before it stay valid: ") + error.what();
    text_.clear();
  }
  return false;
}

std::string Clients::fault() const {
  const std::lock_guard lock(mutex_);
  return fault_;
}

std::shared_ptr<const Clients::Client> Clients::find(std::string_view authorization) const {
  const auto digest = bearer_digest(authorization);
  if (!digest) return nullptr;
  const std::lock_guard lock(mutex_);
  const auto found = clients_.find(*digest);
  return found == clients_.end() ? nullptr : found->second;
}

std::vector<AccessToken> Clients::all() const {
  const std::lock_guard lock(mutex_);
  std::vector<AccessToken> tokens;
  for (const auto& [digest, client] : clients_) tokens.push_back(client->token);
  return tokens;
}

}  // namespace nadir
