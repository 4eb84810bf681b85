// Sends sealed batches to the candidate service and fetches their verdicts, however often it fails: it may be killed at
// any moment, the line may break at any byte, the service may fail, forget or repeat. Nothing is lost, and nothing
// counts twice, because every call may be repeated and every step is stored before the next one.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "base/progress.hpp"
#include "base/random.hpp"
#include "upload/service_client.hpp"
#include "upload/transfer.hpp"

namespace nadir {

// The current time to the millisecond, and waiting: both are passed in, so that tests do not wait.
class UploadClock {
 public:
  virtual ~UploadClock() = default;
  virtual std::int64_t now_ms() const = 0;  // since 1970
  // Calls `check` now and then; what it throws ends the wait.
  virtual void wait(std::int64_t duration_ms, const std::function<void()>& check) = 0;
};

class SystemUploadClock final : public UploadClock {
 public:
  std::int64_t now_ms() const override;
  void wait(std::int64_t duration_ms, const std::function<void()>& check) override;
};

// How long to wait before trying again: a random time up to a limit that doubles with each failure, so that many
// senders that failed together do not retry together. The service's own Retry-After takes precedence.
inline constexpr std::int64_t kFirstBackOff_ms = 2'000;
inline constexpr std::int64_t kLongestBackOff_ms = 15 * 60 * 1'000;

// random(0, min(15 min, 2 s · 2ⁿ)), n the failures before this one; or the service's Retry-After (at most a day).
std::int64_t back_off_ms(int failures_before, std::optional<std::int64_t> retry_after_s, Random& random);

struct UploadOptions {
  std::int64_t patience_ms = 15 * 60 * 1'000;               // gives up for now when there is no progress for so long
  std::uint64_t part_bytes = std::uint64_t{1} << 19;        // of one request: what an interruption can cost
  std::uint64_t least_part_bytes = std::uint64_t{1} << 16;  // an unreliable line gets smaller parts
  int most_invalid = 8;                                     // answers outside of the contract, before a batch is parked
  int most_refusals = 3;                                    // of one pack's bytes
  int most_forgotten = 5;                                   // times that the service forgets an upload
};

// What one run did.
struct UploadOutcome {
  VerdictSum verdicts;
  std::int64_t refused = 0;  // at the announcement
  std::int64_t parked = 0;
  std::int64_t reports_sent = 0, reports_refused = 0, reports_waiting = 0;  // of installed packages
  std::int64_t retries = 0;                                                 // failed calls
  std::uint64_t body_bytes = 0;                                             // of pack parts, failed ones included
  bool finished = true;                                                     // no tile waits for anything
  std::string waits_for{};                                                  // why not
};

// Receives lines for people: what delays the uploader.
using UploadLog = std::function<void(const std::string& line)>;

class Uploader {
 public:
  struct Environment {
    UploadClock& clock;
    Random random;  // of the back-off
    Progress& progress;
    UploadLog log;
  };

  Uploader(OutboxDatabase& outbox, ServiceClient& service, Environment environment, UploadOptions options = {})
      : transfer_(outbox),
        service_(service),
        env_(std::move(environment)),
        options_(options),
        part_bytes_(options.part_bytes) {}

  // First each aircraft's report of what it has installed, once: no tile waits for it, and one that the service does
  // not take now goes with the next run. Then tiles, until every one has its verdict or is parked, or patience ends.
  // Throws Error when the token is not accepted or the address is not the service's, Interrupted when the user
  // interrupts.
  UploadOutcome run();

 private:
  void send_reports();
  void step(const OpenBatch& batch);
  void advance(const OpenBatch& batch);
  void announce(const OpenBatch& batch);
  void complete(const OpenBatch& batch);
  void ask_verdicts(const OpenBatch& batch);
  void send(const OpenBatch& batch, const OpenPack& pack);
  bool begin_at(const OpenBatch& batch, const OpenPack& pack, std::uint64_t& offset);
  bool part_failed(const OpenBatch& batch, const TransferError& error, std::uint64_t& offset);

  void handle(const OpenBatch& batch, const TransferError& error, int most_refusals = 1);
  void try_later(const OpenBatch& batch, const TransferError& error);
  void park(const OpenBatch& batch, const std::string& why);
  bool too_often(const OpenBatch& batch, TransferError::Kind kind, int most);
  void progressed(const OpenBatch& batch);
  void check() { env_.progress.advance(0); }

  Transfer transfer_;
  ServiceClient& service_;
  Environment env_;
  UploadOptions options_;
  std::uint64_t part_bytes_;
  std::int64_t last_progress_ms_ = 0;
  std::int64_t service_not_before_ms_ = 0;  // a service that fails one batch would fail the next; survives a restart
  UploadOutcome outcome_;
};

}  // namespace nadir
