// The candidate service behind HTTP, for tests that talk to it as callers do.
#pragma once

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "base/bytes.hpp"
#include "candidates/service_fixture.hpp"
#include "http/raw_client.hpp"
#include "nadir_candidates/upload_server.hpp"

namespace nadir::test {

inline constexpr const char* kToken = "0123456789abcdef0123";

class UploadServerTest : public ServiceFixture {
 protected:
  void serve(const UploadServerLimits& limits = {}, std::size_t places = 16) {
    if (!tokens_.empty()) write_file_atomic(tokens_file(), tokens_json(tokens_), 0600);
    const auto file = folder_.write("ground-1", std::string(kToken) + "\n");
    const auto other = folder_.write("ground-2", "another-token-0123456789\n");
    for (const auto& path : {file, other}) std::filesystem::permissions(path, std::filesystem::perms(0600));
    clients_.emplace(std::vector<std::string>{file.string(), "mini-08=" + other.string()},
                     tokens_.empty() ? std::nullopt : std::optional(tokens_file()));
    queue_.emplace(2, places);
    api_.emplace(service(), *clients_, true, [] {});
    server_.emplace(*api_, *queue_, ListenAddress{.port = 0}, limits);
  }
  void TearDown() override { server_.reset(); }
  std::filesystem::path tokens_file() const { return folder_ / "tokens.json"; }
  // A token of the file of tokens, which lives for an hour.
  AccessToken token(const std::string& id, const std::string& secret, std::set<TokenScope> scopes,
                    std::vector<std::string> airframes = {}) {
    return {.id = id,
            .client = id,
            .scopes = std::move(scopes),
            .airframes = std::move(airframes),
            .expires = UtcTime{clock_.now().unix_s + 3600},
            .sha256 = sha256(as_bytes(secret))};
  }
  // The lines of the audit log that have these words.
  std::vector<std::string> audited(const std::string& words) {
    std::vector<std::string> lines;
    std::istringstream log(read_text_file(options_.data / "audit" / "audit.jsonl"));
    for (std::string line; std::getline(log, line);) {
      if (line.find(words) != std::string::npos) lines.push_back(line);
    }
    return lines;
  }

  RawClient connect() { return RawClient(server_->port()); }
  static std::string request(const char* method, const std::string& path, const std::string& headers = {},
                             const std::string& body = {}, const char* token = kToken) {
    return fmt::format("{} {} HTTP/1.1\r\nHost: localhost\r\n{}{}{}\r\n{}", method, path,
                       token ? fmt::format("Authorization: Bearer {}\r\n", token) : "", headers,
                       body.empty() ? "" : fmt::format("Content-Length: {}\r\n", body.size()), body);
  }
  // The whole answer on a connection of its own.
  std::string ask(const std::string& text) {
    RawClient client = connect();
    const std::size_t end = text.find("\r\n");
    client.send(text.substr(0, end) + "\r\nConnection: close" + text.substr(end));
    return client.read_to_the_end();
  }
  static std::string patch_headers(std::uint64_t offset, std::uint64_t length, std::string_view part) {
    const Sha256 digest = sha256(as_bytes(part));
    return fmt::format(
        "Content-Type: application/octet-stream\r\nUpload-Offset: {}\r\nUpload-Length: {}\r\n"
        "Content-Digest: sha-256=:{}:\r\n",
        offset, length, to_base64(digest.bytes));
  }

  std::vector<AccessToken> tokens_;  // none: there is no file of tokens
  std::optional<Clients> clients_;
  std::optional<FairQueue> queue_;
  std::optional<UploadApi> api_;
  std::optional<UploadServer> server_;
};

}  // namespace nadir::test
