// The root of trust: which keys may sign packages, how many of them must, until when, and which are revoked. A subset
// of TUF's root role (theupdateframework.github.io/specification, 5.3). The file is readable JSON that carries its own
// signatures:
//   {"signed": {"schema": "nadir.root/1", "version", "expires", "keys", "roles", "revoked"}, "signatures": […]}
// Signed are the bytes of "signed" written without blanks and with sorted keys, in DSSE's pre-authentication encoding.
//
// The first root is installed by hand. Every later one must be signed by the threshold of the root keys before it and
// by that of its own, and its version is exactly one more.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "base/time.hpp"
#include "trust/keys.hpp"
#include "trust/signed_document.hpp"

namespace nadir {

inline constexpr std::uint64_t kMaxRootSize = std::uint64_t{1} << 20;
inline constexpr std::string_view kRootSchema = "nadir.root/1";
inline constexpr std::string_view kRootPayloadType = "application/vnd.nadir.root.v1+json";

struct TrustedKey {
  PublicKey key;
  std::optional<UtcTime> expires;  // of this key alone
};

struct Role {
  std::set<std::string> key_ids;
  std::uint32_t threshold = 1;
};

struct TrustRoot {
  std::int64_t version = 1;
  UtcTime expires;
  std::map<std::string, TrustedKey> keys;  // by id
  Role root;
  Role package_signer;
  std::map<std::string, Role> tile_signers;  // by airframe
  std::optional<Role> airframe_signer;       // who provisions aircraft; without it airframes need no signature
  std::set<std::string> revoked;             // key ids, of keys above or of earlier roots

  void add_key(const PublicKey& key);
};

struct SignedRoot {
  TrustRoot root;
  std::vector<EnvelopeSignature> signatures;
  std::string signed_bytes;  // canonical form of "signed"

  std::string json() const;
};

SignedRoot sign_root(TrustRoot root, const std::vector<const PrivateKey*>& keys);

// Adds a signature, so that several people can sign one root; an older one by the same key is replaced.
void add_signature(SignedRoot& root, const PrivateKey& key);

// Checks the form alone; throws Error. Before the root is trusted, check_self() or check_succession() must pass.
SignedRoot parse_root(std::string_view json, std::string_view name);

// Reads a root that the operator trusts and checks that it is signed by its own threshold. Throws Error.
TrustRoot read_trusted_root(const std::filesystem::path& path);

// Findings signature.invalid and signature.missing: is it signed by the threshold of its own root keys?
Findings check_self(const SignedRoot& root);

// Is `next` a valid successor of the trusted root? Findings root.rollback (its version is not exactly one more),
// signature.invalid, signature.missing, key.expired.
//
// at: when it is accepted. A root says nothing reliable about when it was signed, so a key with a date of its own
// appoints only until then: whoever finds an expired key could date a root back. nullopt: a root that was accepted
// earlier, by the clock of then.
Findings check_succession(const TrustRoot& trusted, const SignedRoot& next, std::optional<UtcTime> at);

struct RootDocument {
  std::string text;
  std::string where;              // for findings
  bool accepted_earlier = false;  // its signers' dates were judged then
};

// The root of this version, or nullopt when there is none.
using RootLookup = std::function<std::optional<RootDocument>(std::int64_t version)>;

struct RootSuccession {
  TrustRoot root;                             // the newest that was reached
  std::map<std::int64_t, std::string> newer;  // documents of the successors, by version
  Findings findings;                          // why the chain ended before its last document
};

// From the root that an aircraft has to the newest that it can reach: N → N+1 → N+2, each step signed by the thresholds
// of both sides. This is how an aircraft learns of new and of revoked keys without a network. Findings: root.invalid
// (malformed), and those of check_succession(). Documents behind a bad root are ignored.
// at: when roots that were not accepted earlier are accepted.
RootSuccession follow_root_chain(TrustRoot trusted, const RootLookup& find, UtcTime at);

}  // namespace nadir
