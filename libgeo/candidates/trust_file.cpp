#include "candidates/trust_file.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace {

// Why `next` may not follow `trusted`; empty: it may.
std::string objection(const SignedRoot& trusted, const SignedRoot& next) {
  if (next.signed_bytes == trusted.signed_bytes) return {};
  Findings findings = check_self(next);
  findings.add(check_succession(trusted.root, next));
  for (const Finding& finding : findings.items()) {
    if (finding.severity == Severity::refuse) {
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
  look_again();
  return root_;
}

std::string TrustFile::trouble() {
  const std::lock_guard lock(mutex_);
  look_again();
  return trouble_;
}

// A few kilobytes: comparing them is simpler than believing in times of files.
void TrustFile::look_again() {
  try {
    std::string text = read_text_file(path_, kMaxRootSize);
    if (text == text_) return;
    text_ = std::move(text);
    SignedRoot next = parse_root(text_, path_.string());
    trouble_ = objection(trusted_, next);
    if (trouble_.empty()) {
      trusted_ = std::move(next);
      root_ = std::make_shared<const TrustRoot>(trusted_.root);
    }
  } catch (const Error& error) {
    trouble_ = error.what();
    text_.clear();
  }
  if (!trouble_.empty()) trouble_ = "the trust root's file is not followed: " + trouble_;
}

}  // namespace nadir
