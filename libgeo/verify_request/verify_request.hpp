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

  UtcTime evaluated_at() const { return evaluated_at_; }  // after open()

  // Whether the aircraft's own acceptance is remembered: not without a state, and not as of another time than now
  // (--at).
  bool remembers() const { return state_.has_value() && !at_; }

  // An accepted package, as verify_package() or open_package() returns it. As of another time (--at), sequence and
  // roots are remembered, the time never is: a trial may not make the clock of now look wrong.
  template <typename Accepted>
  void record_acceptance(const Manifest& manifest, const Accepted& accepted) {
    remember(manifest, accepted.root_version, accepted.newer_roots, accepted.time_reset);
    write_memory();
  }

  // The two steps of it: in memory, and in the state's file (throws Error; does nothing when nothing is remembered).
  void remember(const Manifest& manifest, std::int64_t root_version,
                const std::map<std::int64_t, std::string>& newer_roots, const std::optional<UtcTime>& time_reset);
  void write_memory() const;

 private:
  void read_permit(const std::filesystem::path& path);
  void read_time_permit(const std::filesystem::path& path);

  std::filesystem::path trust_file_;
  std::optional<std::string> airframe_;
  std::optional<std::int64_t> airframe_sequence_;
  std::optional<std::filesystem::path> state_file_;
  std::optional<std::filesystem::path> permit_file_;
  std::optional<std::filesystem::path> time_permit_file_;
  std::optional<UtcTime> at_;

  TrustRoot root_;
  std::optional<AircraftState> state_;
  std::optional<SignedPermit> permit_;
  std::optional<SignedTimePermit> time_permit_;
  UtcTime evaluated_at_;
  Findings findings_;
};

}  // namespace nadir
