// Makes small real packages for tests: noise as JPEG tiles over a village-sized mission, signed with fresh keys. Every
// part can be spoilt before or after signing.
#pragma once

#include <functional>
#include <map>
#include <string>

#include "package/manifest.hpp"
#include "package/sidecar.hpp"
#include "package/verify.hpp"
#include "support/temporary_folder.hpp"
#include "trust/keys.hpp"
#include "trust/root.hpp"

namespace nadir::test {

// The default mission, with every `from` replaced by its `to`.
std::string mission_yaml(const std::map<std::string, std::string>& replacements = {});

Bytes noise_tile(std::uint64_t seed, int side = 256);

inline constexpr UtcTime kJudged{1'714'003'200};  // 2024-04-25, inside the default mission's dates

class PackageMaker {
 public:
  PackageMaker();

  std::string mission = mission_yaml();
  bool cog = false;  // base.tif and sidecars.sqlite instead of base.mbtiles
  // Called for each required tile before it is written; false leaves the tile out.
  std::function<bool(Sidecar&, Bytes&)> edit_tile = [](Sidecar&, Bytes&) { return true; };
  std::function<void(Manifest&)> edit_manifest = [](Manifest&) {};
  // The manifest's bytes just before they are signed.
  std::function<void(std::string&)> edit_bytes = [](std::string&) {};

  std::filesystem::path make(const TemporaryFolder& folder, const std::string& name = "package") const;
  void sign(const std::filesystem::path& package) const;

  VerifyOptions options(VerifyDepth depth = VerifyDepth::quick) const;
  Verification verify(const std::filesystem::path& package, VerifyDepth depth = VerifyDepth::quick) const;

  std::string_view imagery_file() const { return cog ? kCogFile : kImageryFile; }

  PrivateKey signer = PrivateKey::generate();
  TrustRoot root;
};

// Runs SQL with the sqlite3 command line, as an attacker would.
void sqlite(const std::filesystem::path& database, const std::string& sql);

// "code, code" of all findings, for messages.
std::string codes(const Findings& findings);

}  // namespace nadir::test
