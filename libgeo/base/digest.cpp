#include "base/digest.hpp"

#include <fmt/format.h>
#include <openssl/evp.h>

#include <array>
#include <memory>

#include "base/error.hpp"
#include "base/input_file.hpp"

namespace nadir {
namespace {

void require(int openssl_result) {
  if (openssl_result == 1) return;
  throw Error({.what = "OpenSSL cannot compute a SHA-256 digest",
               .fix = "check its installation and configuration: the default provider must be active"});
}

void require_md5(int openssl_result) {
  if (openssl_result == 1) return;
  throw Error(
      {.what = "OpenSSL cannot compute an MD5 digest",
       .fix = "allow MD5 in its configuration (default provider): MBTiles files contain an MD5 of their tiles"});
}

// Fetched once: OpenSSL would search for EVP_sha256(), under locks, for every digest, and a tile set takes millions.
const EVP_MD* algorithm() {
  static const std::unique_ptr<EVP_MD, decltype(&EVP_MD_free)> fetched{EVP_MD_fetch(nullptr, "SHA256", nullptr),
                                                                       &EVP_MD_free};
  require(fetched != nullptr);
  return fetched.get();
}

}  // namespace

struct Sha256Stream::Context {
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> evp{EVP_MD_CTX_new(), &EVP_MD_CTX_free};

  void start() { require(EVP_DigestInit_ex2(evp.get(), algorithm(), nullptr)); }
};

Sha256Stream::Sha256Stream() : context_(std::make_unique<Context>()) { context_->start(); }
Sha256Stream::~Sha256Stream() = default;
Sha256Stream::Sha256Stream(Sha256Stream&&) noexcept = default;
Sha256Stream& Sha256Stream::operator=(Sha256Stream&&) noexcept = default;

void Sha256Stream::update(ByteView bytes) {
  require(EVP_DigestUpdate(context_->evp.get(), bytes.data(), bytes.size()));
}

Sha256 Sha256Stream::finish() {
  Sha256 digest;
  require(EVP_DigestFinal_ex(context_->evp.get(), digest.bytes.data(), nullptr));
  context_->start();
  return digest;
}

Sha256 sha256(ByteView bytes) {
  Sha256 digest;
  require(EVP_Digest(bytes.data(), bytes.size(), digest.bytes.data(), nullptr, algorithm(), nullptr));
  return digest;
}

Sha256 sha256_file(const std::filesystem::path& path) { return InputFile(path).sha256(); }

std::string Sha256::hex() const {
  static constexpr char digits[] = "0123456789abcdef";
  std::string text;
  text.reserve(64);
  for (const std::uint8_t byte : bytes) {
    text += digits[byte >> 4];
    text += digits[byte & 15];
  }
  return text;
}

std::optional<Sha256> Sha256::from_hex(std::string_view hex) {
  if (hex.size() != 64) return std::nullopt;
  Sha256 digest;
  for (std::size_t i = 0; i < 64; ++i) {
    const char c = hex[i];
    const int value = c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
    if (value < 0) return std::nullopt;
    auto& byte = digest.bytes[i / 2];
    byte = static_cast<std::uint8_t>(byte << 4 | value);
  }
  return digest;
}

struct Md5Stream::Context {
  // "-fips": explicitly not for security, otherwise a computer in FIPS mode rejects it.
  std::unique_ptr<EVP_MD, decltype(&EVP_MD_free)> md5{EVP_MD_fetch(nullptr, "MD5", "-fips"), &EVP_MD_free};
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> evp{EVP_MD_CTX_new(), &EVP_MD_CTX_free};
};

Md5Stream::Md5Stream() : context_(std::make_unique<Context>()) {
  require_md5(context_->md5 != nullptr && context_->evp != nullptr ? 1 : 0);
  require_md5(EVP_DigestInit_ex2(context_->evp.get(), context_->md5.get(), nullptr));
}
Md5Stream::~Md5Stream() = default;
Md5Stream::Md5Stream(Md5Stream&&) noexcept = default;
Md5Stream& Md5Stream::operator=(Md5Stream&&) noexcept = default;

void Md5Stream::update(ByteView bytes) {
  require_md5(EVP_DigestUpdate(context_->evp.get(), bytes.data(), bytes.size()));
}

std::string Md5Stream::finish() {
  std::array<std::uint8_t, 16> digest{};
  require_md5(EVP_DigestFinal_ex(context_->evp.get(), digest.data(), nullptr));
  std::string text;
  for (const std::uint8_t byte : digest) text += fmt::format("{:02X}", byte);
  return text;
}

}  // namespace nadir
