// The trust root of a running service: read again when the file changes, so that a revoked key is refused at once, and
// remembered over restarts, so that nobody undoes a revocation by putting the older file back.
//
// The newest root that was trusted is kept in the service's folder (the memory). A file that is malformed, older, or
// not signed by those before it changes nothing: the newest trusted root stays in force, and fault() says why. A file
// that is several versions ahead is reached over the roots between, which lie beside it as N.root.json.
//
// The way back, when the memory itself is wrong: remove it while no service runs. The next start trusts its file as the
// first start did, and says so. For any thread.
#pragma once

#include <filesystem>
#include <memory>
#include <mutex>
#include <string>

#include "trust/root.hpp"

namespace nadir {

inline constexpr std::string_view kTrustMemoryFile = "trusted-root.json";  // in the service's folder

class TrustFile {
 public:
  // Throws Error when there is no root to begin with: the file cannot be read, or the memory is damaged.
  // clock: must outlive this; a root key with a date of its own appoints until then, by this clock.
  TrustFile(std::filesystem::path path, std::filesystem::path memory, const Clock& clock);

  std::shared_ptr<const TrustRoot> current();
  std::string fault();  // empty: none

  // Whether this start found no memory: its root is trusted because the operator gave it, and for no other reason.
  bool first_start() const { return first_start_; }

 private:
  void reload();
  void trust(SignedRoot root, const std::string& text);
  void remember();
  std::string why_rejected(const SignedRoot& next) const;

  const std::filesystem::path path_, memory_;
  const Clock& clock_;
  bool first_start_ = false;
  std::mutex mutex_;
  std::shared_ptr<const TrustRoot> root_;
  std::string text_;  // of the file that was looked at last
  SignedRoot trusted_;
  std::string unwritten_;  // the trusted root's document, while the memory could not be written
  std::string rejected_, unremembered_;
};

}  // namespace nadir
