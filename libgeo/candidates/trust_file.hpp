// The trust root of a running service: read again when the file changes, so that a revoked key is refused at once.
//
// A file that does not read, or that may not follow the root that is trusted (older, or not signed by those before it),
// changes nothing; trouble() tells of it. For any thread.
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
  std::string trouble();  // empty: none

 private:
  void look_again();

  std::filesystem::path path_;
  std::mutex mutex_;
  std::shared_ptr<const TrustRoot> root_;
  std::string text_;  // of the file that was looked at last
  SignedRoot trusted_;
  std::string trouble_;
};

}  // namespace nadir
