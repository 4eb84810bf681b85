// The trust root of a running service: read again when the file changes, so that a revoked key is refused at once.
//
// A file that is malformed, or that may not succeed the trusted root (older, or not signed by those before it),
// changes nothing; fault() says why. For any thread.
#pragma once

#include <filesystem>
#include <memory>
#include <mutex>
#include <string>

#include "trust/root.hpp"

namespace nadir {

class TrustFile {
 public:
  explicit TrustFile(std::filesystem::path path);  // throws as read_trusted_root()

  std::shared_ptr<const TrustRoot> current();
  std::string fault();  // empty: none

 private:
  void reload();

  std::filesystem::path path_;
  std::mutex mutex_;
  std::shared_ptr<const TrustRoot> root_;
  std::string text_;  // of the file that was looked at last
  SignedRoot trusted_;
  std::string fault_;
};

}  // namespace nadir
