#include "upload/uploader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "base/error.hpp"
#include "base/plural.hpp"

namespace nadir {

std::int64_t back_off_ms(int failures_before, std::optional<std::int64_t> retry_after_s, Random& random) {
  constexpr std::int64_t kDay_s = 86'400;
  if (retry_after_s) return std::clamp<std::int64_t>(*retry_after_s, 0, kDay_s) * 1'000;
  const int doublings = std::clamp(failures_before, 0, 20);
  const std::int64_t limit_ms = std::min(kLongestBackOff_ms, kFirstBackOff_ms << doublings);
  return static_cast<std::int64_t>(random.uniform() * static_cast<double>(limit_ms));
}

std::int64_t SystemUploadClock::now_ms() const {
  using namespace std::chrono;
  return duration_cast<milliseconds>(system_clock::now().time_since_epoch()).count();
}

// By the steady clock: a clock that is set while we wait must not make us wait for years.
void SystemUploadClock::wait(std::int64_t duration_ms, const std::function<void()>& check) {
  using namespace std::chrono;
  const auto end = steady_clock::now() + milliseconds(duration_ms);
  for (;;) {
    check();
    const auto left = end - steady_clock::now();
    if (left <= steady_clock::duration::zero()) return;
    std::this_thread::sleep_for(std::min<steady_clock::duration>(left, milliseconds(200)));
  }
}

UploadOutcome Uploader::run() {
  transfer_.recover(env_.clock.now_ms());
  service_not_before_ms_ = transfer_.service_not_before_ms();
  last_progress_ms_ = env_.clock.now_ms();
  send_reports();
  env_.progress.begin("sending", static_cast<std::uint64_t>(transfer_.unsent_tiles()), "tiles");
  while (auto batch = transfer_.next_batch(env_.clock.now_ms())) {
    check();
    const std::int64_t now_ms = env_.clock.now_ms();
    const std::int64_t due_ms = std::max(batch->not_before_ms, service_not_before_ms_);
    if (due_ms <= now_ms) {
      step(*batch);
      continue;
    }
    if (due_ms - last_progress_ms_ > options_.patience_ms) {
      outcome_.finished = false;
      break;
    }
    env_.clock.wait(due_ms - now_ms, [this] { check(); });
  }
  env_.progress.end();
  return outcome_;
}

void Uploader::send_reports() {
  for (const Transfer::OpenReport& report : transfer_.open_reports()) {
    const auto answer = service_.report_installed(report.document);
    const auto* error = std::get_if<TransferError>(&answer);
    if (error == nullptr) {
      transfer_.report_sent(report);
      ++outcome_.reports_sent;
    } else if (error->kind == TransferError::Kind::refused) {
      transfer_.report_refused(report, error->text);
      ++outcome_.reports_refused;
      env_.log(fmt::format("the report of airframe {} is refused: {}", report.airframe, error->text));
    } else {  // a service without this call as well
      ++outcome_.reports_waiting;
      env_.log(fmt::format("the report of airframe {} goes with the next push: {}", report.airframe, error->text));
    }
  }
}

// A damaged batch does not hold up the others.
void Uploader::step(const OpenBatch& batch) {
  try {
    advance(batch);
  } catch (const DamagedBatch& error) {
    const ErrorText& text = error.text();
    park(batch, fmt::format("{}: {}: {}; {}", text.what, text.where, text.found, text.fix));
  }
}

void Uploader::advance(const OpenBatch& batch) {
  if (batch.stage == BatchStage::sealed) return announce(batch);
  if (batch.stage == BatchStage::complete) return ask_verdicts(batch);
  if (const auto pack = transfer_.next_pack(batch)) return send(batch, *pack);
  complete(batch);
}

void Uploader::announce(const OpenBatch& batch) {
  const auto answer = service_.announce(batch.uuid, transfer_.document(batch));
  if (const auto* error = std::get_if<TransferError>(&answer)) return handle(batch, *error);
  const auto& announcement = std::get<AnnouncementReply>(answer);
  try {
    transfer_.announced(batch, announcement, env_.clock.now_ms());
  } catch (const WrongAnswer& error) {
    return handle(batch, {TransferError::Kind::invalid, error.text().found});
  }
  outcome_.refused += static_cast<std::int64_t>(announcement.refused.size());
  env_.progress.advance(announcement.refused.size() + announcement.known.size());
  progressed(batch);
}

void Uploader::complete(const OpenBatch& batch) {
  const auto answer = service_.complete(batch.upload);
  if (const auto* error = std::get_if<TransferError>(&answer)) {
    // Tiles are missing that were sent: the next announcement says which.
    if (error->kind == TransferError::Kind::conflict) {
      return handle(batch, {TransferError::Kind::forgotten, error->text});
    }
    return handle(batch, *error);
  }
  transfer_.completed(batch);
  progressed(batch);
  if (const auto wait_s = std::get<Accepted>(answer).retry_after_s) {
    transfer_.await_verdicts(batch, 0, env_.clock.now_ms() + *wait_s * 1'000);
  }
}

void Uploader::ask_verdicts(const OpenBatch& batch) {
  const auto answer = service_.status(batch.upload);
  if (const auto* error = std::get_if<TransferError>(&answer)) return handle(batch, *error);
  const auto& [status, wait_s] = std::get<StatusAnswer>(answer);
  VerdictSum sum;
  try {
    sum = transfer_.verdicts(batch, status, env_.clock.now_ms());
  } catch (const WrongAnswer& error) {
    return handle(batch, {TransferError::Kind::invalid, error.text().found});
  }
  outcome_.verdicts.accepted += sum.accepted;
  outcome_.verdicts.rejected += sum.rejected;
  outcome_.verdicts.duplicate += sum.duplicate;
  if (sum.accepted + sum.rejected + sum.duplicate > 0) progressed(batch);
  if (sum.pending == 0) return;
  outcome_.waits_for = count(static_cast<std::uint64_t>(sum.pending), "verdict");
  const std::int64_t wait_ms = std::min<std::int64_t>(back_off_ms(batch.attempts, wait_s, env_.random), 60'000);
  transfer_.await_verdicts(batch, batch.attempts + 1, env_.clock.now_ms() + wait_ms);
}

void Uploader::progressed(const OpenBatch& batch) {
  last_progress_ms_ = env_.clock.now_ms();
  service_not_before_ms_ = 0;
  outcome_.waits_for.clear();
  using Kind = TransferError::Kind;  // these count in a row
  transfer_.reset_failures(batch, {name_of(Kind::invalid), name_of(Kind::conflict), name_of(Kind::mangled)});
}

void Uploader::handle(const OpenBatch& batch, const TransferError& error, int most_refusals) {
  ++outcome_.retries;
  switch (error.kind) {
    case TransferError::Kind::credentials:
      throw Error(
          {.what = "the service does not accept the token",
           .found = error.text,
           .fix = "ask its operator for a token for this airframe, and put it into the file or NADIR_SYNC_TOKEN"});
    case TransferError::Kind::elsewhere:
      throw Error({.what = "this is not the address of a candidate service",
                   .expected = "a direct answer: redirects are not followed, because they could leak the token",
                   .found = error.text,
                   .fix = "give the service's own address with --to"});
    case TransferError::Kind::later: return try_later(batch, error);
    case TransferError::Kind::invalid:
      return too_often(batch, error.kind, options_.most_invalid) ? park(batch, error.text) : try_later(batch, error);
    case TransferError::Kind::forgotten:
      if (too_often(batch, error.kind, options_.most_forgotten)) return park(batch, error.text);
      return transfer_.forgotten(batch, env_.clock.now_ms());
    case TransferError::Kind::conflict:
    case TransferError::Kind::mangled:
    case TransferError::Kind::too_large:
    case TransferError::Kind::refused:
      return too_often(batch, error.kind, most_refusals) ? park(batch, error.text) : try_later(batch, error);
  }
}

bool Uploader::too_often(const OpenBatch& batch, TransferError::Kind kind, int most) {
  return transfer_.count_failure(batch, name_of(kind)) >= most;
}

void Uploader::try_later(const OpenBatch& batch, const TransferError& error) {
  const std::int64_t wait_ms = back_off_ms(batch.attempts, error.retry_after_s, env_.random);
  const std::int64_t not_before_ms = env_.clock.now_ms() + wait_ms;
  transfer_.delay(batch, batch.attempts + 1, not_before_ms, error.text);
  service_not_before_ms_ = std::max(service_not_before_ms_, not_before_ms);
  outcome_.waits_for = error.text;
  env_.log(fmt::format("{}; next attempt in {:.1f} s", error.text, static_cast<double>(wait_ms) / 1e3));
}

void Uploader::park(const OpenBatch& batch, const std::string& why) {
  const std::int64_t tiles = transfer_.park(batch, why, env_.clock.now_ms());
  outcome_.parked += tiles;
  env_.log(
      fmt::format("batch {} with {} is parked: {}", batch.uuid, count(static_cast<std::uint64_t>(tiles), "tile"), why));
}

// Sending one pack: in parts, from wherever the service has got to.

void Uploader::send(const OpenBatch& batch, const OpenPack& pack) {
  std::uint64_t offset = 0;
  if (pack.begun && !begin_at(batch, pack, offset)) return;
  const Bytes bytes = transfer_.pack_bytes(pack);
  transfer_.pack_begins(pack, env_.clock.now_ms());
  while (offset < pack.size) {
    check();
    const std::uint64_t most = std::min(part_bytes_, batch.part_max);
    const ByteView part = ByteView(bytes).subspan(offset).first(std::min(most, pack.size - offset));
    outcome_.body_bytes += part.size();
    auto answer = service_.send_part(batch.upload, pack.sha256, pack.size, offset, part);
    if (const auto* reached = std::get_if<std::uint64_t>(&answer); reached != nullptr && *reached <= offset) {
      answer = TransferError{TransferError::Kind::invalid, "an offset that has not advanced"};
    }
    if (const auto* error = std::get_if<TransferError>(&answer)) {
      if (part_failed(batch, *error, offset)) continue;
      transfer_.pack_waits(pack, env_.clock.now_ms());
      return handle(batch, *error, options_.most_refusals);
    }
    offset = std::get<std::uint64_t>(answer);
    part_bytes_ = std::min(part_bytes_ * 2, options_.part_bytes);
    progressed(batch);
  }
  env_.progress.advance(static_cast<std::uint64_t>(transfer_.pack_sent(pack, env_.clock.now_ms())));
  // What has arrived is there, even when the service forgets the upload.
  transfer_.reset_failures(batch, {name_of(TransferError::Kind::refused), name_of(TransferError::Kind::forgotten)});
  progressed(batch);
}

// Asks the service how far the pack has come. False when it does not say, and the batch has to wait.
bool Uploader::begin_at(const OpenBatch& batch, const OpenPack& pack, std::uint64_t& offset) {
  const auto answer = service_.offset(batch.upload, pack.sha256);
  if (const auto* error = std::get_if<TransferError>(&answer)) {
    handle(batch, *error);
    return false;
  }
  offset = std::get<std::uint64_t>(answer);
  if (offset <= pack.size) return true;
  handle(batch, {TransferError::Kind::invalid, "an offset beyond the end of the pack"});
  return false;
}

// True when the next part may follow at once: at another offset, smaller, or the same again.
bool Uploader::part_failed(const OpenBatch& batch, const TransferError& error, std::uint64_t& offset) {
  constexpr int kMostConflicts = 20;
  constexpr std::uint64_t kLeastPart = 4096;  // part_max is at least that
  switch (error.kind) {
    case TransferError::Kind::conflict:
      if (!error.offset || too_often(batch, error.kind, kMostConflicts)) return false;
      ++outcome_.retries;
      offset = *error.offset;
      return true;
    case TransferError::Kind::mangled:
      if (too_often(batch, error.kind, options_.most_refusals)) return false;
      ++outcome_.retries;
      return true;
    case TransferError::Kind::too_large:
      if (part_bytes_ <= kLeastPart) return false;
      part_bytes_ = std::max(part_bytes_ / 2, kLeastPart);
      return true;
    case TransferError::Kind::later:  // perhaps a line that breaks: then less is lost the next time
      part_bytes_ = std::max(part_bytes_ / 2, options_.least_part_bytes);
      return false;
    default: return false;
  }
}

}  // namespace nadir
