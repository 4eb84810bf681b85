#include "candidates/clients.hpp"

#include <algorithm>
#include <filesystem>

#include "base/error.hpp"
#include "http/access.hpp"
#include "trust/bearer_token.hpp"

namespace nadir {
namespace fs = std::filesystem;

Clients::Clients(const std::vector<std::string>& token_files) {
  std::map<fs::path, std::vector<std::string>> airframes;  // of each file; empty: all
  for (const std::string& text : token_files) {
    const std::size_t equals = text.find('=');
    const bool named = equals != std::string::npos && !fs::exists(text);
    std::vector<std::string>& of_file = airframes[named ? text.substr(equals + 1) : text];
    if (named) of_file.push_back(text.substr(0, equals));
  }
  for (auto& [file, names] : airframes) {
    UploadClient client{.name = file.stem().string(), .airframes = std::move(names)};
    const bool taken = std::any_of(clients_.begin(), clients_.end(),
                                   [&client](const auto& known) { return known.second.name == client.name; });
    if (taken) {
      throw UsageError({.what = "two token files have one name",
                        .where = file,
                        .expected = "names that tell the clients apart",
                        .fix = "rename one of them"});
    }
    if (!clients_.emplace(sha256(as_bytes(read_bearer_token(file))), std::move(client)).second) {
      throw UsageError({.what = "two clients have one token",
                        .where = file,
                        .fix = "(umask 077; openssl rand -hex 24 > " + file.string() + ")"});
    }
  }
}

const UploadClient* Clients::find(std::string_view authorization) const {
  const auto digest = bearer_digest(authorization);
  const auto found = digest ? clients_.find(*digest) : clients_.end();
  return found == clients_.end() ? nullptr : &found->second;
}

}  // namespace nadir
