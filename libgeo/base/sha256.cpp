#include "base/sha256.hpp"

#include <openssl/evp.h>

#include <cerrno>
#include <fstream>
#include <memory>

#include "base/error.hpp"

namespace nadir {
namespace {

void require(int openssl_result) {
  if (openssl_result != 1) throw Error({.what = "OpenSSL could not compute a SHA-256 digest"});
}

// Looked up once: EVP_sha256() is searched for, under locks, by each digest that begins, and a tile set begins
// millions.
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

Sha256 sha256_file(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw Error({.what = "cannot open a file to hash it", .where = path, .found = system_error_text(errno)});
  Sha256Stream stream;
  Bytes block(1 << 20);
  while (file) {
    file.read(reinterpret_cast<char*>(block.data()), static_cast<std::streamsize>(block.size()));
    stream.update(ByteView(block).first(static_cast<std::size_t>(file.gcount())));
  }
  if (file.bad())
    throw Error({.what = "cannot read a file to its end", .where = path, .found = system_error_text(errno)});
  return stream.finish();
}

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

}  // namespace nadir
