#include "candidates/tile_evaluation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "candidates/tile_check.hpp"
#include "candidates/vote.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

constexpr std::size_t kTilesAtOnce = 128;  // other callers come in between
constexpr const char* kDamagedHere = "the service's copy of this tile is damaged; send it again";

double pixel_mm(const TileKey& key) {
  const LonLatBox box = bounds_of(key);
  return ground_resolution_m(key.z, (box.south_deg + box.north_deg) / 2) * 1000;
}

}  // namespace

// By the tile alone: its bytes, its image, and the map that its flight was matched with.
TileVerdict TileEvaluation::evaluate_tile(const TileRow& tile, const CandidateSidecar& sidecar) {
  TileVerdict verdict{.tile = tile.id};
  const auto rejected = [&verdict](Refusal refusal) {
    verdict.verdict = Verdict::rejected;
    verdict.refusal = std::move(refusal);
    return verdict;
  };
  if (tile.blob->bytes != sidecar.size) {
    return rejected({.code = ReasonCode::hash_mismatch, .detail = "the existing bytes have a different size"});
  }
  const auto read = read_candidate_image(packs_.read(*tile.blob, sidecar.sha256), sidecar);
  if (const auto* refusal = std::get_if<Refusal>(&read)) return rejected(*refusal);
  const auto& image = std::get<cv::Mat>(read);
  const ImageMetrics metrics = image_metrics(image);
  verdict.measures = OwnMeasures{.contrast_ppm = metrics.contrast_ppm, .sharpness_ppm = metrics.sharpness_ppm};
  if (const auto refusal = check_image_metrics(metrics, rules_)) return rejected(*refusal);

  const auto base = maps_.tile(sidecar.base_package, sidecar.key);
  if (!base) return verdict;
  const Agreement agreement = compare_images(image, base->grey);
  const auto shift_mm = std::llround(agreement.shift_px * pixel_mm(sidecar.key));
  verdict.measures->base_shift_mm = shift_mm;
  verdict.measures->correlation_ppm = std::llround(agreement.correlation * 1e6);
  if (*verdict.measures->correlation_ppm < rules_.min_correlation_ppm) return verdict;  // the ground may have changed
  const std::int64_t allowed_mm = allowed_shift_mm(static_cast<double>(sidecar.pose.sigma_mm),
                                                   static_cast<double>(base->ce90_mm) / kCe90OverSigma, rules_);
  if (shift_mm > allowed_mm) {
    return rejected({.code = ReasonCode::misaligned,
                     .detail = fmt::format("{} mm off the base package's map; at most {}", shift_mm, allowed_mm)});
  }
  return verdict;
}

std::vector<std::pair<std::string, std::int64_t>> TileEvaluation::pending() {
  std::vector<std::pair<std::string, std::int64_t>> list;
  for (const UploadRow& upload :
       catalogue_.call([](CandidateCatalogue& catalogue) { return catalogue.uploads_in(UploadState::judging); })) {
    list.emplace_back(upload.client, upload.id);
  }
  return list;
}

// Nothing: it cannot be read now. The other tiles get their verdicts.
std::optional<CandidateCatalogue::Question> TileEvaluation::evaluate(const TileRow& tile, std::int64_t upload) {
  CandidateCatalogue::Question question{.verdict = {.tile = tile.id},
                                        .sidecar = parse_candidate(tile.sidecar, "the catalogue's sidecar"),
                                        .keyid = tile.keyid};
  const auto note = [this, upload](const Error& error) -> Unread& {
    Unread& unread = unevaluated_[upload];
    if (!unread.why) unread.why = error;
    return unread;
  };
  try {
    question.verdict = evaluate_tile(tile, question.sidecar);
  } catch (const PackDamaged& error) {
    const std::lock_guard lock(mutex_);
    note(error);
    question.damaged = true;
    question.verdict.verdict = Verdict::rejected;
    question.verdict.refusal = Refusal{.code = ReasonCode::hash_mismatch, .detail = kDamagedHere};
  } catch (const Error& error) {
    const std::lock_guard lock(mutex_);
    note(error).tiles.insert(tile.id);
    return std::nullopt;
  }
  return question;
}

// Throws what kept tiles from being read.
void TileEvaluation::end_evaluation(std::int64_t upload) {
  const std::lock_guard lock(mutex_);
  const auto unread = unevaluated_.extract(upload);
  if (unread && unread.mapped().why) throw Error(*unread.mapped().why);
}

bool TileEvaluation::evaluate_some(std::int64_t id) {
  const auto unread = [this, id] {
    const std::lock_guard lock(mutex_);
    const auto found = unevaluated_.find(id);
    return found == unevaluated_.end() ? std::set<std::int64_t>() : found->second.tiles;
  };
  const std::set<std::int64_t> waiting = unread();
  const std::vector<TileRow> tiles = catalogue_.call(
      [&](CandidateCatalogue& catalogue) { return catalogue.tiles_to_judge(id, kTilesAtOnce, waiting); });
  std::vector<CandidateCatalogue::Question> questions;
  for (const TileRow& tile : tiles) {
    if (auto question = evaluate(tile, id)) questions.push_back(std::move(*question));
  }
  const bool last = tiles.size() < kTilesAtOnce;
  const bool done = last && unread().empty();
  const std::int64_t now_ms = clock_.now().unix_s * 1000;
  catalogue_.call([&](CandidateCatalogue& catalogue) {
    // In this thread, in turn with apply_revocations(): a key that is revoked meanwhile is seen by one of the two.
    const auto root = trust_.current();
    for (CandidateCatalogue::Question& question : questions) {
      if (!root->revoked.contains(question.keyid)) continue;
      question.verdict = {.tile = question.verdict.tile,
                          .verdict = Verdict::rejected,
                          .refusal = Refusal{.code = ReasonCode::airframe_revoked, .detail = kRevokedLater}};
    }
    catalogue.add_evaluated(
        std::move(questions), now_ms,
        [](TileVerdict& verdict, const CandidateSidecar& sidecar, const CandidateCatalogue::Competitors& rivals) {
          if (verdict.verdict != Verdict::accepted) return;
          if (rivals.same_bytes) {
            verdict.verdict = Verdict::duplicate;
            verdict.detail = "this tile was already accepted";
          } else if (rivals.of_flight_mm && static_cast<double>(*rivals.of_flight_mm) <= cost_mm(sidecar)) {
            verdict.verdict = Verdict::rejected;
            verdict.refusal = Refusal{.code = ReasonCode::better_tile_exists,
                                      .detail = "this flight has sent a better tile of this address"};
          }
        });
    if (!done) return;
    catalogue.set_state(id, UploadState::judged);
    catalogue.remove_unused(catalogue.forget_dead_packs(id), [this](const Sha256& pack) { packs_.remove(pack); });
  });
  if (last) end_evaluation(id);
  return !last;
}

std::int64_t TileEvaluation::apply_revocations() {
  const std::set<std::string> revoked = trust_.current()->revoked;
  {
    const std::lock_guard lock(mutex_);
    if (revoked == applied_revocations_) return 0;
  }
  const std::int64_t withdrawn =
      catalogue_.call([&revoked](CandidateCatalogue& catalogue) { return catalogue.withdraw(revoked); });
  if (withdrawn > 0) {
    audit_.record({.act = "tiles.withdraw",
                   .result = "withdrawn",
                   .subject = fmt::format("tiles {}", withdrawn),
                   .detail = fmt::format("signed by keys that root version {} revokes", trust_.current()->version)});
  }
  const std::lock_guard lock(mutex_);
  applied_revocations_ = revoked;
  return withdrawn;
}

Vote TileEvaluation::compare(const AcceptedCandidate& one, const AcceptedCandidate& other) {
  const auto image = [this](const AcceptedCandidate& candidate) {
    return read_candidate_image(packs_.read(candidate.blob, candidate.sidecar.sha256), candidate.sidecar);
  };
  Vote vote{.allowed_mm = allowed_shift_mm(static_cast<double>(one.sidecar.pose.sigma_mm),
                                           static_cast<double>(other.sidecar.pose.sigma_mm), rules_)};
  const auto first = image(one), second = image(other);
  if (!std::holds_alternative<cv::Mat>(first) || !std::holds_alternative<cv::Mat>(second)) return vote;
  const Agreement agreement = compare_images(std::get<cv::Mat>(first), std::get<cv::Mat>(second));
  vote.shift_mm = std::llround(agreement.shift_px * pixel_mm(one.sidecar.key));
  vote.correlation_ppm = std::llround(agreement.correlation * 1e6);
  vote.agrees = vote.correlation_ppm >= rules_.min_correlation_ppm && vote.shift_mm <= vote.allowed_mm;
  return vote;
}

bool TileEvaluation::vote_some() {
  const std::set<TileKey> unread = [this] {
    const std::lock_guard lock(mutex_);
    return unread_;
  }();
  const std::vector<AddressCandidates> addresses = catalogue_.call(
      [&unread](CandidateCatalogue& catalogue) { return catalogue.open_addresses(kTilesAtOnce, unread); });
  if (addresses.empty()) {
    const std::lock_guard lock(mutex_);
    unread_.clear();
    if (const auto why = std::exchange(why_unread_, std::nullopt)) throw Error(*why);
    return false;
  }
  const std::int64_t now_ms = clock_.now().unix_s * 1000;
  std::vector<AddressCandidates> decided;
  std::vector<Outcome> outcomes;
  for (const AddressCandidates& address : addresses) {
    try {
      outcomes.push_back(decide(
          address, [this](const AcceptedCandidate& one, const AcceptedCandidate& other) { return compare(one, other); },
          now_ms, rules_));
      decided.push_back(address);
    } catch (const Error& error) {  // a pack is damaged: that keeps no other address from its vote
      const std::lock_guard lock(mutex_);
      unread_.insert(address.key);
      if (!why_unread_) why_unread_ = error;
    }
  }
  catalogue_.call([&](CandidateCatalogue& catalogue) { catalogue.close(decided, outcomes); });
  const auto promoted = std::count_if(outcomes.begin(), outcomes.end(),
                                      [](const Outcome& outcome) { return outcome.promotion.has_value(); });
  if (promoted > 0) {
    audit_.record({.act = "tiles.promote",
                   .result = "promoted",
                   .subject = fmt::format("tiles {}", promoted),
                   .detail = fmt::format("{} flights, independent by {}", rules_.flights_to_promote,
                                         rules_.airframes_differ ? "airframes" : "days")});
  }
  return true;
}

}  // namespace nadir
