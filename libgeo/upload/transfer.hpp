// The steps of sealed tiles through the outbox, from the announcement to the verdict: each one transaction that happens
// whole or not at all, and only from the state in which it makes sense.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "upload/outbox.hpp"
#include "upload/service_client.hpp"

namespace nadir {

enum class BatchStage { sealed, announced, complete };

// A batch with tiles that wait for something.
struct OpenBatch {
  std::int64_t id = 0;
  std::string uuid;
  BatchStage stage = BatchStage::sealed;
  std::string upload;
  std::uint64_t part_max = 0;
  int attempts = 0;  // failed, since the last progress
  std::int64_t not_before_ms = 0;
};

struct OpenPack {
  std::int64_t id = 0;
  std::int64_t batch = 0;
  Sha256 sha256;
  std::uint64_t size = 0;
  bool begun = false;  // the service may have bytes of it
};

// Verdicts by kind.
struct VerdictSum {
  std::int64_t accepted = 0, rejected = 0, duplicate = 0, pending = 0;
};

// The service answered about other tiles than those of the batch.
class WrongAnswer : public Error {
 public:
  using Error::Error;
};

// What the outbox holds of the batch is not what was sealed.
class DamagedBatch : public Error {
 public:
  using Error::Error;
};

class Transfer {
 public:
  explicit Transfer(OutboxDatabase& outbox) : outbox_(outbox) {}

  // A program that was killed left tiles SENDING: they are WAITING. An attempt that would be due in more than a day was
  // set by another clock: it is due in a day.
  void recover(std::int64_t now_ms);
  // Until when an earlier run was asked to leave the service alone, or decided to; 0: no longer.
  std::int64_t service_not_before_ms() const;

  // The one whose turn it is: the earliest of those that may be tried now, else the one that may be tried next.
  std::optional<OpenBatch> next_batch(std::int64_t now_ms) const;
  std::string document(const OpenBatch& batch) const;
  std::int64_t unsent_tiles() const;

  // Throws WrongAnswer when it is not about just the tiles of the batch, DamagedBatch when an image that the service
  // lacks is not what was staged.
  void announced(const OpenBatch& batch, const AnnouncementReply& answer, std::int64_t now_ms);

  // Aircraft's reports that the service has not answered about.
  struct OpenReport {
    std::string airframe;
    std::int64_t number = 0;
    std::string document;
  };
  std::vector<OpenReport> open_reports() const;
  void report_sent(const OpenReport& report);
  void report_refused(const OpenReport& report, const std::string& why);

  std::optional<OpenPack> next_pack(const OpenBatch& batch) const;
  Bytes pack_bytes(const OpenPack& pack) const;  // throws DamagedBatch
  void pack_begins(const OpenPack& pack, std::int64_t now_ms);
  void pack_waits(const OpenPack& pack, std::int64_t now_ms);
  std::int64_t pack_sent(const OpenPack& pack, std::int64_t now_ms);  // how many tiles

  void completed(const OpenBatch& batch);
  // Throws WrongAnswer when it is not about just the tiles of the batch.
  VerdictSum verdicts(const OpenBatch& batch, const StatusReply& answer, std::int64_t now_ms);

  void forgotten(const OpenBatch& batch, std::int64_t now_ms);  // announced afresh, tiles with a verdict excepted
  std::int64_t park(const OpenBatch& batch, const std::string& why, std::int64_t now_ms);  // how many tiles
  void delay(const OpenBatch& batch, int attempts, std::int64_t not_before_ms, const std::string& why);
  void await_verdicts(const OpenBatch& batch, int attempts, std::int64_t not_before_ms);

  // How often this failure has occurred with the batch, this time included; kept until it is parked or retried by hand.
  int count_failure(const OpenBatch& batch, std::string_view kind);
  void reset_failures(const OpenBatch& batch, std::initializer_list<std::string_view> kinds);

 private:
  void end_report(const OpenReport& report, std::string_view stage, const std::string& why);
  void interrupt(std::int64_t batch, std::int64_t now_ms);
  void set_stage(std::int64_t batch, const char* stage);
  void make_packs(std::int64_t batch, const std::vector<std::int64_t>& again);

  OutboxDatabase& outbox_;
};

}  // namespace nadir
