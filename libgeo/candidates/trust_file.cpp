#include "candidates/trust_file.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace {

// Why `next` may not succeed `trusted`; empty: it may.
std::string why_rejected(const SignedRoot& trusted, const SignedRoot& next) {
  if (next.signed_bytes == trusted.signed_bytes) return {};
  Findings findings = check_self(next);
  findings.add(check_succession(trusted.root, next));
  for (const Finding& finding : findings.items()) {
    if (finding.severity == Severity::error) {
      return fmt::format("{}: expected {}, found {}", finding.code, finding.expected, finding.found);
    }
  }
  return {};
}

}  // namespace

TrustFile::TrustFile(std::filesystem::path path)
    : path_(std::move(path)),
      root_(std::make_shared<const TrustRoot>(read_trusted_root(path_))),
      text_(read_text_file(path_, kMaxRootSize)),
      trusted_(parse_root(text_, path_.string())) {}

std::shared_ptr<const TrustRoot> TrustFile::current() {
  const std::lock_guard lock(mutex_);
  reload();
  return root_;
}

std::string TrustFile::fault() {
  const std::lock_guard lock(mutex_);
  reload();
  return fault_;
}

// A few kilobytes: comparing them is simpler than relying on file times.
void TrustFile::reload() {
  try {
    std::string text = read_text_file(path_, kMaxRootSize);
    if (text == text_) return;
    text_ = std::move(text);
    SignedRoot next = parse_root(text_, path_.string());
    fault_ = why_rejected(trusted_, next);
    if (fault_.empty()) {
      trusted_ = std::move(next);
      root_ = std::make_shared<const TrustRoot>(trusted_.root);
    }
  } catch (const Error& error) {
    fault_ = error.what();
    text_.clear();
  }
  if (!fault_.empty()) fault_ = "the trust root's file is rejected: " + fault_;
}

}  // namespace nadir
