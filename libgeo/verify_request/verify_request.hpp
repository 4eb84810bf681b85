// How a package is to be verified: the options of `nadir cache verify` and of `nadird --check`, and what both do
// with them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "base/time.hpp"
#include "package/verify.hpp"

namespace nadir {

class Options;

class VerifyRequest {
 public:
  // Optional for a program that also works without a package; then open() requires it.
  enum class Trust { required, optional };
  void setup(Options& options, Trust trust = Trust::required);

  // As asked for on the command line.
  const std::optional<std::string>& airframe() const { return airframe_; }
  const std::optional<std::filesystem::path>& state() const { return state_file_; }
  // What nadird reads from its files instead.
  void set_airframe(const std::string& id) { airframe_ = id; }
  // nullopt: nothing to remember of the airframe file, because it is not signed or has none.
  void set_airframe_sequence(std::optional<std::int64_t> sequence) { airframe_sequence_ = sequence; }
  void set_state_file(const std::filesystem::path& file) { state_file_ = file; }

  // Reads root, state and permit; the result points into this. Throws Error when the root cannot be trusted or a file
  // cannot be read.
  VerifyOptions open(const Clock& clock);

  // A damaged state or permit, to be added to those of the verification. Such a state is neither treated as empty
  // nor overwritten.
  const Findings& findings() const { return findings_; }

  // Records an accepted package in the state, if there is one, and the airframe's sequence.
  void record_acceptance(const Manifest& manifest, std::int64_t root_version,
                const std::map<std::int64_t, std::string>& newer_roots);

 private:
  void read_permit(const std::filesystem::path& path);

  std::filesystem::path trust_file_;
  std::optional<std::string> airframe_;
  std::optional<std::int64_t> airframe_sequence_;
  std::optional<std::filesystem::path> state_file_;
  std::optional<std::filesystem::path> permit_file_;
  std::optional<UtcTime> at_;

  TrustRoot root_;
  std::optional<AircraftState> state_;
  std::optional<SignedPermit> permit_;
  UtcTime evaluated_at_;
  Findings findings_;
};

}  // namespace nadir
