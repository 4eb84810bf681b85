// MD5 through OpenSSL, for what other programs write into their files and ask for again. It finds accidents and stops
// nobody: what Nadir relies on is SHA-256.
#pragma once

#include <memory>
#include <string>

#include "base/bytes.hpp"

namespace nadir {

class Md5Stream {
 public:
  Md5Stream();  // throws Error where OpenSSL is not allowed to compute it
  ~Md5Stream();
  Md5Stream(Md5Stream&&) noexcept;
  Md5Stream& operator=(Md5Stream&&) noexcept;

  void update(ByteView bytes);
  std::string finish();  // 32 upper-case digits; nothing can be added afterwards

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

}  // namespace nadir
