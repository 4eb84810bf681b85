#include "upload/uploader.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.hpp"
#include "upload/back_off.hpp"

namespace nadir {

UploadOutcome Uploader::run() {
  transfer_.recover(around_.pace.now_ms());
  service_not_before_ms_ = transfer_.service_not_before_ms();
  last_progress_ms_ = around_.pace.now_ms();
  around_.progress.begin("sending", static_cast<std::uint64_t>(transfer_.unsent_tiles()), "tiles");
  while (auto batch = transfer_.next_batch(around_.pace.now_ms())) {
    check();
    const std::int64_t now_ms = around_.pace.now_ms();
    const std::int64_t due_ms = std::max(batch->not_before_ms, service_not_before_ms_);
    if (due_ms <= now_ms) {
      step(*batch);
      continue;
    }
    if (due_ms - last_progress_ms_ > options_.patience_ms) {
      outcome_.finished = false;
      break;
    }
    around_.pace.wait(due_ms - now_ms, [this] { check(); });
  }
  around_.progress.end();
  return outcome_;
}

// What is wrong with one batch keeps no other one.
void Uploader::step(const OpenBatch& batch) {
  try {
    go_on(batch);
  } catch (const DamagedBatch& error) {
    const ErrorText& text = error.text();
    park(batch, fmt::format("{}: {}: {}; {}", text.what, text.where, text.found, text.fix));
  }
}

void Uploader::go_on(const OpenBatch& batch) {
  if (batch.stage == BatchStage::sealed) return announce(batch);
  if (batch.stage == BatchStage::complete) return ask_verdicts(batch);
  if (const auto pack = transfer_.next_pack(batch)) return send(batch, *pack);
  complete(batch);
}

void Uploader::announce(const OpenBatch& batch) {
  const auto answer = service_.announce(batch.uuid, transfer_.document(batch));
  if (const auto* trouble = std::get_if<Trouble>(&answer)) return handle(batch, *trouble);
  const auto& announcement = std::get<AnnouncementReply>(answer);
  try {
    transfer_.announced(batch, announcement, around_.pace.now_ms());
  } catch (const WrongAnswer& error) {
    return handle(batch, {Trouble::Kind::nonsense, error.text().found});
  }
  outcome_.refused += static_cast<std::int64_t>(announcement.refused.size());
  around_.progress.advance(announcement.refused.size() + announcement.known.size());
  came_forward(batch);
}

void Uploader::complete(const OpenBatch& batch) {
  const auto answer = service_.complete(batch.upload);
  if (const auto* trouble = std::get_if<Trouble>(&answer)) {
    // Tiles are missing that were sent: the next announcement tells which.
    if (trouble->kind == Trouble::Kind::conflict) {
      return handle(batch, {Trouble::Kind::forgotten, trouble->text});
    }
    return handle(batch, *trouble);
  }
  transfer_.completed(batch);
  came_forward(batch);
  if (const auto wait_s = std::get<Accepted>(answer).retry_after_s) {
    transfer_.await_verdicts(batch, 0, around_.pace.now_ms() + *wait_s * 1'000);
  }
}

void Uploader::ask_verdicts(const OpenBatch& batch) {
  const auto answer = service_.status(batch.upload);
  if (const auto* trouble = std::get_if<Trouble>(&answer)) return handle(batch, *trouble);
  const auto& [status, wait_s] = std::get<StatusAnswer>(answer);
  VerdictSum sum;
  try {
    sum = transfer_.verdicts(batch, status, around_.pace.now_ms());
  } catch (const WrongAnswer& error) {
    return handle(batch, {Trouble::Kind::nonsense, error.text().found});
  }
  outcome_.verdicts.accepted += sum.accepted;
  outcome_.verdicts.rejected += sum.rejected;
  outcome_.verdicts.duplicate += sum.duplicate;
  if (sum.accepted + sum.rejected + sum.duplicate > 0) came_forward(batch);
  if (sum.pending == 0) return;
  outcome_.waits_for = fmt::format("{} verdicts", sum.pending);
  const std::int64_t wait_ms = std::min<std::int64_t>(back_off_ms(batch.attempts, wait_s, around_.random), 60'000);
  transfer_.await_verdicts(batch, batch.attempts + 1, around_.pace.now_ms() + wait_ms);
}

void Uploader::came_forward(const OpenBatch& batch) {
  last_progress_ms_ = around_.pace.now_ms();
  service_not_before_ms_ = 0;
  outcome_.waits_for.clear();
  using Kind = Trouble::Kind;  // these count in a row
  transfer_.forgive(batch, {name_of(Kind::nonsense), name_of(Kind::conflict), name_of(Kind::mangled)});
}

void Uploader::handle(const OpenBatch& batch, const Trouble& trouble, int most_refusals) {
  ++outcome_.retries;
  switch (trouble.kind) {
    case Trouble::Kind::credentials:
      throw Error(
          {.what = "the service does not accept the token",
           .found = trouble.text,
           .fix = "ask its operator for a token for this airframe, and put it into the file or NADIR_SYNC_TOKEN"});
    case Trouble::Kind::elsewhere:
      throw Error({.what = "this is not the address of a candidate service",
                   .expected = "an answer; redirects are not followed, they could lead the token elsewhere",
                   .found = trouble.text,
                   .fix = "give the service's own address with --to"});
    case Trouble::Kind::later: return try_later(batch, trouble);
    case Trouble::Kind::nonsense:
      return too_often(batch, trouble.kind, options_.most_nonsense) ? park(batch, trouble.text)
                                                                    : try_later(batch, trouble);
    case Trouble::Kind::forgotten:
      if (too_often(batch, trouble.kind, options_.most_forgotten)) return park(batch, trouble.text);
      return transfer_.forgotten(batch, around_.pace.now_ms());
    case Trouble::Kind::conflict:
    case Trouble::Kind::mangled:
    case Trouble::Kind::too_large:
    case Trouble::Kind::refused:
      return too_often(batch, trouble.kind, most_refusals) ? park(batch, trouble.text) : try_later(batch, trouble);
  }
}

bool Uploader::too_often(const OpenBatch& batch, Trouble::Kind kind, int most) {
  return transfer_.strike(batch, name_of(kind)) >= most;
}

void Uploader::try_later(const OpenBatch& batch, const Trouble& trouble) {
  const std::int64_t wait_ms = back_off_ms(batch.attempts, trouble.retry_after_s, around_.random);
  const std::int64_t not_before_ms = around_.pace.now_ms() + wait_ms;
  transfer_.delay(batch, batch.attempts + 1, not_before_ms, trouble.text);
  service_not_before_ms_ = std::max(service_not_before_ms_, not_before_ms);
  outcome_.waits_for = trouble.text;
  around_.tell(fmt::format("{}; next attempt in {:.1f} s", trouble.text, static_cast<double>(wait_ms) / 1e3));
}

void Uploader::park(const OpenBatch& batch, const std::string& why) {
  const std::int64_t tiles = transfer_.park(batch, why, around_.pace.now_ms());
  outcome_.parked += tiles;
  around_.tell(fmt::format("batch {} with {} tiles is parked: {}", batch.uuid, tiles, why));
}

}  // namespace nadir
