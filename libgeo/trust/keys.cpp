#include "trust/keys.hpp"

#include <openssl/crypto.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <algorithm>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr std::uint64_t kMaxPemSize = 1 << 14;

struct Free {
  void operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }
  void operator()(BIO* bio) const { BIO_free_all(bio); }
  void operator()(EVP_MD_CTX* context) const { EVP_MD_CTX_free(context); }
};
using Key = std::unique_ptr<EVP_PKEY, Free>;
using Bio = std::unique_ptr<BIO, Free>;
using DigestContext = std::unique_ptr<EVP_MD_CTX, Free>;

[[noreturn]] void openssl_failed(const char* what) {
  char reason[256] = "unknown reason";
  if (const unsigned long code = ERR_get_error()) ERR_error_string_n(code, reason, sizeof reason);
  ERR_clear_error();
  throw Error({.what = what, .found = reason});
}

Bio memory_bio(std::string_view text) {
  Bio bio(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
  if (!bio) openssl_failed("no memory to read a key");
  return bio;
}

std::string text_of(BIO* bio) {
  char* data = nullptr;
  const long length = BIO_get_mem_data(bio, &data);
  return {data, static_cast<std::size_t>(length)};
}

// OpenSSL would ask for the passphrase of an encrypted key on the terminal. We do not accept such keys.
int no_passphrase(char*, int, int, void*) { return -1; }

Key require_ed25519(Key key, std::string_view name, const char* kind) {
  ERR_clear_error();
  const std::string expected = std::string("an Ed25519 ") + kind + " key in PEM";
  if (!key) {
    throw UsageError({.what = "cannot read this key",
                      .where = std::string(name),
                      .expected = expected,
                      .found = "something else (or an encrypted key)",
                      .fix = "make one with `nadir keys create` or `openssl genpkey -algorithm ed25519`"});
  }
  if (EVP_PKEY_get_id(key.get()) != EVP_PKEY_ED25519) {
    const char* type = EVP_PKEY_get0_type_name(key.get());
    throw UsageError({.what = "this key is for another algorithm",
                      .where = std::string(name),
                      .expected = expected,
                      .found = type != nullptr ? type : "an unknown algorithm",
                      .fix = "make one with `nadir keys create` or `openssl genpkey -algorithm ed25519`"});
  }
  return key;
}

Key public_from_raw(const std::array<std::uint8_t, 32>& raw) {
  Key key(EVP_PKEY_new_raw_public_key(EVP_PKEY_ED25519, nullptr, raw.data(), raw.size()));
  if (!key) openssl_failed("cannot make a public key");
  return key;
}

UsageError key_exists(const KeyFiles& files, const fs::path& path) {
  std::error_code ignored;
  const bool alone = path == files.private_key && !fs::exists(fs::symlink_status(files.public_key, ignored));
  return UsageError(
      {.what = "a key of this name exists",
       .where = path,
       .expected = "neither " + files.private_key.filename().string() + " nor " + files.public_key.filename().string() +
                   ": keys are never overwritten",
       .found = alone ? "a private key without its public key" : "a file, perhaps created by another process just now",
       .fix = alone ? "choose another --out; or derive the public key: openssl pkey -in " + path.string() +
                          " -pubout -out " + files.public_key.string()
                    : "choose another --out"});
}

}  // namespace

PublicKey PublicKey::read(const fs::path& pem_file) {
  return from_pem(read_text_file(pem_file, kMaxPemSize), pem_file.string());
}

PublicKey PublicKey::from_pem(std::string_view pem, std::string_view name) {
  const Bio bio = memory_bio(pem);
  const Key key = require_ed25519(Key(PEM_read_bio_PUBKEY(bio.get(), nullptr, no_passphrase, nullptr)), name, "public");
  std::array<std::uint8_t, 32> raw{};
  std::size_t length = raw.size();
  if (EVP_PKEY_get_raw_public_key(key.get(), raw.data(), &length) != 1) openssl_failed("cannot read a public key");
  return from_raw(raw);
}

PublicKey PublicKey::from_raw(ByteView raw) {
  if (raw.size() != 32)
    throw UsageError({.what = "this is not an Ed25519 public key",
                      .expected = "32 bytes",
                      .found = std::to_string(raw.size()) + " bytes"});
  PublicKey result;
  std::copy(raw.begin(), raw.end(), result.raw_.begin());
  const Key key = public_from_raw(result.raw_);
  unsigned char* der = nullptr;
  const int length = i2d_PUBKEY(key.get(), &der);
  if (length <= 0) openssl_failed("cannot encode a public key");
  result.id_ = sha256(ByteView(der, static_cast<std::size_t>(length))).hex();
  OPENSSL_free(der);
  return result;
}

std::string PublicKey::pem() const {
  const Bio bio(BIO_new(BIO_s_mem()));
  if (!bio || PEM_write_bio_PUBKEY(bio.get(), public_from_raw(raw_).get()) != 1) {
    openssl_failed("cannot write a public key");
  }
  return text_of(bio.get());
}

bool PublicKey::verifies(ByteView message, ByteView signature) const {
  const Key key = public_from_raw(raw_);
  const DigestContext context(EVP_MD_CTX_new());
  if (!context || EVP_DigestVerifyInit(context.get(), nullptr, nullptr, nullptr, key.get()) != 1) {
    openssl_failed("cannot verify signatures");
  }
  const int result =
      EVP_DigestVerify(context.get(), signature.data(), signature.size(), message.data(), message.size());
  ERR_clear_error();
  return result == 1;
}

struct PrivateKey::Impl {
  Key key;
  std::unique_ptr<KeyDevice> device;  // instead
};

PrivateKey::PrivateKey(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PrivateKey::~PrivateKey() = default;
PrivateKey::PrivateKey(PrivateKey&&) noexcept = default;
PrivateKey& PrivateKey::operator=(PrivateKey&&) noexcept = default;

PrivateKey PrivateKey::read(const fs::path& pem_file) {
  std::string pem = read_text_file(pem_file, kMaxPemSize);
  if (pem.find("BEGIN PUBLIC KEY") != std::string::npos) {  // before advice about its mode, which would not help
    throw UsageError({.what = "this is a public key",
                      .where = pem_file.string(),
                      .expected = "the private key, NAME.key.pem",
                      .found = "BEGIN PUBLIC KEY",
                      .fix = "give the file that `nadir keys create` wrote beside this one"});
  }
  require_private_mode(pem_file);
  const Bio bio = memory_bio(pem);
  Key key(PEM_read_bio_PrivateKey(bio.get(), nullptr, no_passphrase, nullptr));
  OPENSSL_cleanse(pem.data(), pem.size());
  auto impl = std::make_unique<Impl>();
  impl->key = require_ed25519(std::move(key), pem_file.string(), "private");
  return PrivateKey(std::move(impl));
}

PrivateKey PrivateKey::generate() {
  auto impl = std::make_unique<Impl>();
  impl->key.reset(EVP_PKEY_Q_keygen(nullptr, nullptr, "ED25519"));
  if (!impl->key) openssl_failed("cannot generate a key");
  return PrivateKey(std::move(impl));
}

PrivateKey PrivateKey::in_device(std::unique_ptr<KeyDevice> device) {
  auto impl = std::make_unique<Impl>();
  impl->device = std::move(device);
  return PrivateKey(std::move(impl));
}

PublicKey PrivateKey::public_key() const {
  if (impl_->device) return impl_->device->public_key();
  std::array<std::uint8_t, 32> raw{};
  std::size_t length = raw.size();
  if (EVP_PKEY_get_raw_public_key(impl_->key.get(), raw.data(), &length) != 1) {
    openssl_failed("cannot derive a public key");
  }
  return PublicKey::from_raw(raw);
}

Signature PrivateKey::sign(ByteView message) const {
  if (impl_->device) return impl_->device->sign(message);
  const DigestContext context(EVP_MD_CTX_new());
  Signature signature{};
  std::size_t length = signature.size();
  if (!context || EVP_DigestSignInit(context.get(), nullptr, nullptr, nullptr, impl_->key.get()) != 1 ||
      EVP_DigestSign(context.get(), signature.data(), &length, message.data(), message.size()) != 1 ||
      length != signature.size()) {
    openssl_failed("cannot sign");
  }
  return signature;
}

std::string PrivateKey::pem() const {
  if (impl_->device) throw Error({.what = "the key does not leave its device"});
  const Bio bio(BIO_new(BIO_s_secmem()));
  if (!bio || PEM_write_bio_PKCS8PrivateKey(bio.get(), impl_->key.get(), nullptr, nullptr, 0, nullptr, nullptr) != 1) {
    openssl_failed("cannot write a private key");
  }
  return text_of(bio.get());
}

KeyFiles create_key_files(const fs::path& name) {
  KeyFiles files{name, name};
  files.private_key += ".key.pem";
  files.public_key += ".pub.pem";
  const PrivateKey key = PrivateKey::generate();
  std::string pem = key.pem();
  // Both are whole and on the disk before either has its name. The private key's name decides which process wins; a
  // process that dies after it leaves a key from which the public one follows.
  PendingFile private_key(files.private_key, as_bytes(pem), 0600);
  OPENSSL_cleanse(pem.data(), pem.size());
  const std::string public_pem = key.public_key().pem();
  PendingFile public_key(files.public_key, as_bytes(public_pem));
  if (fs::exists(fs::symlink_status(files.public_key))) throw key_exists(files, files.public_key);
  if (!private_key.create()) throw key_exists(files, files.private_key);
  try {
    if (!public_key.create()) throw key_exists(files, files.public_key);
  } catch (...) {
    std::error_code ignored;
    fs::remove(files.private_key, ignored);  // ours, of a moment ago
    throw;
  }
  return files;
}

}  // namespace nadir
