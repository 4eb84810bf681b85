#include "commands/keys/root_signing.hpp"

#include <fmt/format.h>

#include <map>
#include <nlohmann/json.hpp>
#include <ostream>
#include <set>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/output.hpp"
#include "token_keys/token_key.hpp"

namespace nadir {
namespace {

// Keys of a role before that are not in it now. Revoked ones were meant to go.
std::set<std::string> removed_from(const Role& before, const Role& now, const TrustRoot& root) {
  std::set<std::string> removed;
  for (const std::string& id : before.key_ids) {
    if (!now.key_ids.contains(id) && !root.revoked.contains(id)) removed.insert(id);
  }
  return removed;
}

// By role: "package signer", "airframe signer", "tile signer of mini-07".
std::map<std::string, std::set<std::string>> removed_signers(const TrustRoot& previous, const TrustRoot& root) {
  std::map<std::string, std::set<std::string>> removed;
  const auto add = [&](const std::string& role, std::set<std::string> ids) {
    if (!ids.empty()) removed[role] = std::move(ids);
  };
  add("package signer", removed_from(previous.package_signer, root.package_signer, root));
  add("airframe signer",
      removed_from(previous.airframe_signer.value_or(Role{}), root.airframe_signer.value_or(Role{}), root));
  for (const auto& [airframe, role] : previous.tile_signers) {
    const auto now = root.tile_signers.find(airframe);
    add("tile signer of " + airframe, removed_from(role, now == root.tile_signers.end() ? Role{} : now->second, root));
  }
  return removed;
}

}  // namespace

std::vector<PrivateKey> read_private_keys(std::span<const std::filesystem::path> files) {
  std::vector<PrivateKey> keys;
  for (const auto& file : files) keys.push_back(read_signing_key(file));
  return keys;
}

std::vector<const PrivateKey*> pointers_to(const std::vector<PrivateKey>& keys) {
  std::vector<const PrivateKey*> pointers;
  for (const PrivateKey& key : keys) pointers.push_back(&key);
  return pointers;
}

void check_new_root(const std::filesystem::path& out, UtcTime expires, const Clock& clock) {
  if (std::filesystem::exists(std::filesystem::symlink_status(out))) {
    throw UsageError({.what = "the output exists already",
                      .where = out,
                      .fix = "choose another --out; a root that is in use is never overwritten"});
  }
  check_expires(expires, clock);
}

void check_expires(UtcTime expires, const Clock& clock) {
  const UtcTime now = clock.now();
  if (now < kEarliestNow) {
    throw UsageError(
        {.what = "the clock of this machine is wrong, and validity cannot be judged by it",
         .where = "the clock",
         .expected = "a time after " + to_rfc3339(kEarliestNow) + ", before which this program did not exist",
         .found = to_rfc3339(now),
         .fix = "set the clock, then try again"});
  }
  if (expires > now) return;
  throw UsageError({.what = "the end of validity has passed already",
                    .where = "--expires",
                    .expected = "a time after " + to_rfc3339(now) + ", the time of this machine's clock",
                    .found = to_rfc3339(expires),
                    .fix = "give a later --expires; or set the clock, if it is wrong"});
}

void give_role(TrustRoot& root, Role& role, const PublicKey& key) {
  root.add_key(key);
  role.key_ids.insert(key.id());
}

int write_new_root(Context& context, NewRoot wanted, const std::vector<PrivateKey>& keys) {
  const SignedRoot signed_root = sign_root(std::move(wanted.root), pointers_to(keys));
  const Findings findings =
      wanted.previous ? check_succession(*wanted.previous, signed_root, context.clock.now()) : check_self(signed_root);
  // Only signatures that are still missing may come later; everything else stays wrong.
  bool only_missing = true;
  for (const Finding& finding : findings.items()) only_missing &= finding.code == "signature.missing";
  if (findings.has_errors() && !(wanted.incomplete && only_missing)) {
    const Finding& first = findings.items().front();
    throw UsageError(
        {.what = "aircraft would reject this root: it is not signed by enough root keys that are valid now",
         .where = first.where,
         .expected = first.expected,
         .found = first.found,
         .fix = wanted.previous ? "add the missing keys with --root-key or --previous-root-key, or let "
                                  "others sign: --incomplete, then nadir keys sign"
                                : "add the missing keys with --root-key, or let others sign: "
                                  "--incomplete, then nadir keys sign"});
  }
  write_new_file(wanted.out, signed_root.json());
  const TrustRoot& root = signed_root.root;
  const bool complete = !findings.has_errors();
  const auto removed =
      wanted.previous ? removed_signers(*wanted.previous, root) : std::map<std::string, std::set<std::string>>();
  for (const auto& [role, ids] : removed) {
    for (const std::string& id : ids) {
      context.err << fmt::format(
          "warning: {} {} of version {} is removed: what it signs is rejected from this version on; "
          "--keep-signers keeps it\n",
          role, id, wanted.previous->version);
    }
  }
  if (context.json) {
    print_json(context.out, {{"root", wanted.out.string()},
                             {"version", root.version},
                             {"expires", to_rfc3339(root.expires)},
                             {"root_keys", root.root.key_ids},
                             {"root_threshold", root.root.threshold},
                             {"package_signers", root.package_signer.key_ids},
                             {"threshold", root.package_signer.threshold},
                             {"revoked", root.revoked},
                             {"removed", removed},
                             {"complete", complete}});
    return kAccepted;
  }
  std::size_t signers = 0;
  for (const auto& [role, ids] : removed) signers += ids.size();
  print_figures(
      context.out,
      {{"root", wanted.out.string()},
       {"version", std::to_string(root.version)},
       {"expires", to_rfc3339(root.expires)},
       {"package signers",
        fmt::format("{} of {} must sign", root.package_signer.threshold, root.package_signer.key_ids.size())},
       {"root keys", fmt::format("{} of {} must sign the next root", root.root.threshold, root.root.key_ids.size())},
       {"revoked keys", std::to_string(root.revoked.size())},
       {"removed signers", std::to_string(signers)},
       {"complete", complete ? "yes" : "no: more root keys must sign (nadir keys sign)"}});
  return kAccepted;
}

}  // namespace nadir
