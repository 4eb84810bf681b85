#include "candidates/trust_file.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

SignedRoot read_memory(const fs::path& path) {
  const auto damaged = [&path](std::string expected, std::string found) {
    return Error({.what = "the service's memory of its trust root is damaged",
                  .where = path,
                  .expected = std::move(expected),
                  .found = std::move(found),
                  .fix =
                      "restore it from a copy; or check that --trust is the newest root, remove this file, and start "
                      "the service again"});
  };
  std::optional<SignedRoot> root;
  try {
    root = parse_root(read_text_file(path, kMaxRootSize), path.string());
  } catch (const Error& error) {
    throw damaged(error.text().expected.empty() ? "a root of trust" : error.text().expected,
                  error.text().found.empty() ? error.text().what : error.text().found);
  }
  const Findings findings = check_self(*root);
  if (findings.has_errors()) throw damaged(findings.items().front().expected, findings.items().front().found);
  return *std::move(root);
}

}  // namespace

TrustFile::TrustFile(fs::path path, fs::path memory, const Clock& clock)
    : path_(std::move(path)), memory_(std::move(memory)), clock_(clock) {
  static_cast<void>(read_trusted_root(path_));  // what is no root at all is an error before anything is served
  first_start_ = !fs::exists(fs::symlink_status(memory_));
  if (first_start_) {
    text_ = read_text_file(path_, kMaxRootSize);
    trust(parse_root(text_, path_.string()), text_);
  } else {
    trusted_ = read_memory(memory_);
    root_ = std::make_shared<const TrustRoot>(trusted_.root);
    reload();
  }
}

std::shared_ptr<const TrustRoot> TrustFile::current() {
  const std::lock_guard lock(mutex_);
  reload();
  return root_;
}

std::string TrustFile::fault() {
  const std::lock_guard lock(mutex_);
  reload();
  return rejected_.empty() ? unremembered_ : rejected_;
}

// A few kilobytes: comparing them is simpler than relying on file times.
void TrustFile::reload() {
  if (!unwritten_.empty()) remember();
  try {
    std::string text = read_text_file(path_, kMaxRootSize);
    if (text == text_ && rejected_.empty()) return;  // a rejected one may find its predecessors by now
    text_ = std::move(text);
    SignedRoot next = parse_root(text_, path_.string());
    rejected_ = why_rejected(next);
    if (rejected_.empty() && next.signed_bytes != trusted_.signed_bytes) trust(std::move(next), text_);
  } catch (const Error& error) {
    rejected_ = error.what();
    text_.clear();
  }
  if (!rejected_.empty()) {
    rejected_ =
        fmt::format("the trust root's file is rejected, version {} stays in force: {}", root_->version, rejected_);
  }
}

// Why `next` may not take the trusted root's place; empty: it may.
std::string TrustFile::why_rejected(const SignedRoot& next) const {
  if (next.signed_bytes == trusted_.signed_bytes) return {};
  const auto beside = [&](std::int64_t version) -> std::optional<RootDocument> {
    if (version == next.root.version) return RootDocument{text_, path_.string()};
    const fs::path file = path_.parent_path() / fmt::format("{}.root.json", version);
    std::error_code none;
    if (version > next.root.version || !fs::is_regular_file(file, none)) return std::nullopt;
    return RootDocument{read_text_file(file, kMaxRootSize), file.string()};
  };
  const RootSuccession chain = follow_root_chain(trusted_.root, beside, clock_.now());
  for (const Finding& finding : chain.findings.items()) {
    if (finding.severity == Severity::error) {
      return fmt::format("{}: expected {}, found {}", finding.code, finding.expected, finding.found);
    }
  }
  if (chain.root.version == next.root.version && next.root.version > trusted_.root.version) return {};
  return fmt::format(
      "root.rollback: expected version {}, found version {}{}", trusted_.root.version + 1, next.root.version,
      next.root.version > trusted_.root.version ? fmt::format("; put {}.root.json beside it", chain.root.version + 1)
                                                : std::string());
}

void TrustFile::trust(SignedRoot root, const std::string& text) {
  trusted_ = std::move(root);
  root_ = std::make_shared<const TrustRoot>(trusted_.root);
  unwritten_ = text;
  remember();
}

// In force at once, also while the disk is full: a revocation does not wait for room. It is tried again with each look
// at the file.
void TrustFile::remember() {
  try {
    write_file_atomic(memory_, unwritten_);
    unwritten_.clear();
    unremembered_.clear();
  } catch (const Error& error) {
    unremembered_ =
        fmt::format("root version {} is in force, but a restart would forget it: {}", root_->version, error.what());
  }
}

}  // namespace nadir
