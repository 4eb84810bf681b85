// Brings sealed batches to the candidate service and their verdicts home, whatever happens on the way: it may be killed
// at any moment, the line may break at any byte, the service may fail, forget or repeat. Nothing is lost, and nothing
// counts twice, because every call may be repeated and every step is written down before the next one.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "base/progress.hpp"
#include "base/random.hpp"
#include "upload/pace.hpp"
#include "upload/service_client.hpp"
#include "upload/transfer.hpp"

namespace nadir {

struct UploadOptions {
  std::int64_t patience_ms = 15 * 60 * 1'000;               // gives up for now when nothing comes forward for so long
  std::uint64_t part_bytes = std::uint64_t{1} << 19;        // of one request: what a cut can cost
  std::uint64_t least_part_bytes = std::uint64_t{1} << 16;  // a line that breaks often gets smaller parts
  int most_nonsense = 8;   // answers that the contract does not know, before a batch is parked
  int most_refusals = 3;   // of one pack's bytes
  int most_forgotten = 5;  // times that the service forgets an upload
};

// What one run did.
struct UploadOutcome {
  VerdictSum verdicts;
  std::int64_t refused = 0;  // at the announcement
  std::int64_t parked = 0;
  std::int64_t retries = 0;      // calls that were in vain
  std::uint64_t body_bytes = 0;  // of packs' parts, those in vain included
  bool finished = true;          // no tile waits for anything
  std::string waits_for{};       // why not
};

// Where the uploader tells what keeps it, for people.
using Tell = std::function<void(const std::string& line)>;

class Uploader {
 public:
  struct Environment {
    Pace& pace;
    Random random;  // of the back-off
    Progress& progress;
    Tell tell;
  };

  Uploader(OutboxDatabase& outbox, ServiceClient& service, Environment surroundings, UploadOptions options = {})
      : transfer_(outbox),
        service_(service),
        around_(std::move(surroundings)),
        options_(options),
        part_bytes_(options.part_bytes) {}

  // Until every tile has its verdict or is parked, or patience ends. Throws Error when the token is not accepted or the
  // address is not the service's, Interrupted when the user wants.
  UploadOutcome run();

 private:
  void step(const OpenBatch& batch);
  void go_on(const OpenBatch& batch);
  void announce(const OpenBatch& batch);
  void complete(const OpenBatch& batch);
  void ask_verdicts(const OpenBatch& batch);
  void send(const OpenBatch& batch, const OpenPack& pack);
  bool begin_at(const OpenBatch& batch, const OpenPack& pack, std::uint64_t& offset);
  bool part_failed(const OpenBatch& batch, const Trouble& trouble, std::uint64_t& offset);

  void handle(const OpenBatch& batch, const Trouble& trouble, int most_refusals = 1);
  void try_later(const OpenBatch& batch, const Trouble& trouble);
  void park(const OpenBatch& batch, const std::string& why);
  bool too_often(const OpenBatch& batch, Trouble::Kind kind, int most);
  void came_forward(const OpenBatch& batch);
  void check() { around_.progress.advance(0); }

  Transfer transfer_;
  ServiceClient& service_;
  Environment around_;
  UploadOptions options_;
  std::uint64_t part_bytes_;
  std::int64_t last_progress_ms_ = 0;
  std::int64_t service_not_before_ms_ = 0;  // when it failed one batch it would fail the next; outlives a restart
  UploadOutcome outcome_;
};

}  // namespace nadir
