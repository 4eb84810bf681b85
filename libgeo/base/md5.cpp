#include "base/md5.hpp"

#include <fmt/format.h>
#include <openssl/evp.h>

#include <array>

#include "base/error.hpp"

namespace nadir {
namespace {

void require(int openssl_result) {
  if (openssl_result == 1) return;
  throw Error({.what = "OpenSSL could not compute an MD5 digest",
               .fix = "its configuration must allow MD5 (the default provider); tile sets of other tools hold it"});
}

}  // namespace

struct Md5Stream::Context {
  // Explicitly not for security, which a machine in FIPS mode wants to hear.
  std::unique_ptr<EVP_MD, decltype(&EVP_MD_free)> md5{EVP_MD_fetch(nullptr, "MD5", "-fips"), &EVP_MD_free};
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> evp{EVP_MD_CTX_new(), &EVP_MD_CTX_free};
};

Md5Stream::Md5Stream() : context_(std::make_unique<Context>()) {
  require(context_->md5 != nullptr && context_->evp != nullptr ? 1 : 0);
  require(EVP_DigestInit_ex2(context_->evp.get(), context_->md5.get(), nullptr));
}
Md5Stream::~Md5Stream() = default;
Md5Stream::Md5Stream(Md5Stream&&) noexcept = default;
Md5Stream& Md5Stream::operator=(Md5Stream&&) noexcept = default;

void Md5Stream::update(ByteView bytes) { require(EVP_DigestUpdate(context_->evp.get(), bytes.data(), bytes.size())); }

std::string Md5Stream::finish() {
  std::array<std::uint8_t, 16> digest{};
  require(EVP_DigestFinal_ex(context_->evp.get(), digest.data(), nullptr));
  std::string text;
  for (const std::uint8_t byte : digest) text += fmt::format("{:02X}", byte);
  return text;
}

}  // namespace nadir
