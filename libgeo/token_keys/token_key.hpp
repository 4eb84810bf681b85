// Private keys that never leave a token (smart card, USB token, HSM), through PKCS#11. Commands that sign
// take, instead of the file of a private key, its URI (RFC 7512), and so does the desk, which signs by these commands; sync and
// nadird take files alone:
//
//   pkcs11:token=nadir;object=planner                          the one key of this label on the token
//   pkcs11:token=nadir;id=%01?pin-source=/run/secrets/pin      by its id; the PIN from a file
//   pkcs11:object=planner?module-path=/usr/lib/softhsm/libsofthsm2.so
//
// Tokens are found through the modules that p11-kit knows (/usr/share/p11-kit/modules), or the one that the URI names.
// The PIN comes from a file that only its owner may read, or from the environment; never from the URI, because other
// users of a machine see command lines. A wrong PIN is tried once: tokens lock after a few.
//
// Ed25519 alone (CKM_EDDSA, PKCS#11 3.0), as everywhere. A signature is checked with the public key before it is used.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "trust/keys.hpp"

namespace nadir {

inline constexpr const char* kTokenPinVariable = "NADIR_PKCS11_PIN";

bool is_token_uri(std::string_view text);  // whether it begins with "pkcs11:"
// Of such a text, without asking any token. Throws UsageError for a URI that is none, or that holds a PIN.
void check_token_uri(const std::string& text);

// pin: of the environment, used when the URI names no pin-source. Throws UsageError for a URI that is none, that holds
// a PIN, or that does not lead to exactly one token and one key: the message lists what there is. Throws Error when the
// token refuses (wrong or missing PIN, locked, removed).
PrivateKey open_token_key(std::string_view uri, const std::optional<std::string>& pin);

// Either: a PEM file, or the URI of a token's key, with the PIN of the environment.
PrivateKey read_signing_key(const std::filesystem::path& file_or_uri);

}  // namespace nadir
