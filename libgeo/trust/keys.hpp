// Ed25519 keys (RFC 8032) in the files that OpenSSL reads and writes: PKCS#8 PEM for private keys, SubjectPublicKeyInfo
// PEM for public ones. A key's id is the SHA-256 of its SubjectPublicKeyInfo in DER: 64 hexadecimal digits.
//
// The algorithm belongs to the trusted key, never to what a package claims.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "base/bytes.hpp"

namespace nadir {

using Signature = std::array<std::uint8_t, 64>;

class PublicKey {
 public:
  // Throw UsageError for everything that is not one Ed25519 public key.
  static PublicKey read(const std::filesystem::path& pem_file);
  static PublicKey from_pem(std::string_view pem, std::string_view name);
  static PublicKey from_raw(ByteView raw);  // 32 bytes

  const std::string& id() const { return id_; }
  const std::array<std::uint8_t, 32>& raw() const { return raw_; }
  std::string pem() const;
  bool verifies(ByteView message, ByteView signature) const;

 private:
  std::array<std::uint8_t, 32> raw_{};
  std::string id_;
};

// A private key that does not leave its device (token_keys/token_key.hpp).
class KeyDevice {
 public:
  virtual ~KeyDevice() = default;
  virtual const PublicKey& public_key() const = 0;
  virtual Signature sign(ByteView message) const = 0;
};

class PrivateKey {
 public:
  // Throws UsageError for everything that is not an unencrypted Ed25519 private key, and for a file that other users
  // may access (mode wider than 0600).
  static PrivateKey read(const std::filesystem::path& pem_file);
  static PrivateKey generate();  // from the operating system's randomness
  static PrivateKey in_device(std::unique_ptr<KeyDevice> device);

  ~PrivateKey();
  PrivateKey(PrivateKey&&) noexcept;
  PrivateKey& operator=(PrivateKey&&) noexcept;

  PublicKey public_key() const;
  Signature sign(ByteView message) const;
  std::string pem() const;  // PKCS#8. Throws Error for a key in a device

 private:
  struct Impl;
  explicit PrivateKey(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// NAME.key.pem (mode 0600) and NAME.pub.pem: both or none. Throws UsageError when one of them exists; of several
// processes that create the same name at once, one succeeds.
struct KeyFiles {
  std::filesystem::path private_key;
  std::filesystem::path public_key;
};
KeyFiles create_key_files(const std::filesystem::path& name);

}  // namespace nadir
