#include "mavlink/signing_key.hpp"

#include <openssl/crypto.h>
#include <openssl/rand.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/digest.hpp"

namespace nadir {

SigningKey::~SigningKey() { OPENSSL_cleanse(bytes_.data(), bytes_.size()); }

SigningKey SigningKey::read(const std::filesystem::path& path) {
  require_private_mode(path);
  std::string text = read_text_file(path, 1024);
  std::string_view digits = text;
  while (digits.ends_with('\n') || digits.ends_with('\r')) digits.remove_suffix(1);
  auto bytes = Sha256::from_hex(digits);  // 32 bytes as well
  OPENSSL_cleanse(text.data(), text.size());
  if (!bytes) {
    throw UsageError({.what = "this file holds no signing key",
                      .where = path,
                      .expected = "64 hexadecimal digits in lower case, and nothing else",
                      .found = "something else (not shown: it may be a secret)",
                      .fix = "make one with `openssl rand -hex 32` and install it on the autopilot too"});
  }
  SigningKey key(bytes->bytes);
  OPENSSL_cleanse(bytes->bytes.data(), bytes->bytes.size());
  return key;
}

SigningKey SigningKey::generate() {
  std::array<std::uint8_t, 32> bytes{};
  if (RAND_priv_bytes(bytes.data(), static_cast<int>(bytes.size())) != 1) {
    throw Error({.what = "the operating system gives no randomness for a signing key"});
  }
  return SigningKey(bytes);
}

void SigningKey::write(const std::filesystem::path& path) const {
  if (std::filesystem::exists(path)) {
    throw UsageError({.what = "a signing key is there already",
                      .where = path,
                      .expected = "a new file",
                      .fix = "move it away; an autopilot may still ask for it"});
  }
  std::string text = Sha256{bytes_}.hex() + "\n";
  write_file_atomic(path, text, 0600);
  OPENSSL_cleanse(text.data(), text.size());
}

}  // namespace nadir
