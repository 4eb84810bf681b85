#include "candidates/tile_evaluation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <span>
#include <utility>
#include <variant>

#include "candidates/image_agreement.hpp"
#include "candidates/tile_check.hpp"
#include "candidates/vote.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

constexpr std::size_t kTilesAtOnce = 128;  // of a claim: other callers, and other workers, come in between
constexpr const char* kDamagedHere = "the service's copy of this tile is damaged; send it again";

double pixel_mm(const TileKey& key) {
  const LonLatBox box = bounds_of(key);
  return ground_resolution_m(key.z, (box.south_deg + box.north_deg) / 2) * 1000;
}

// An accepted tile gives way to what was accepted at its address before: the same bytes, a better one of its flight.
void compare_with_accepted(TileVerdict& verdict, const CandidateSidecar& sidecar,
                           std::span<const AcceptedCandidate> accepted) {
  if (verdict.verdict != Verdict::accepted) return;
  const auto better = [&sidecar](const AcceptedCandidate& other) {
    return other.sidecar.airframe == sidecar.airframe && other.sidecar.flight == sidecar.flight &&
           static_cast<double>(std::lround(cost_mm(other.sidecar))) <= cost_mm(sidecar);
  };
  const auto same = [&sidecar](const AcceptedCandidate& other) { return other.sidecar.sha256 == sidecar.sha256; };
  if (std::ranges::any_of(accepted, same)) {
    verdict.verdict = Verdict::duplicate;
    verdict.detail = "this tile was already accepted";
  } else if (std::ranges::any_of(accepted, better)) {
    verdict.verdict = Verdict::rejected;
    verdict.refusal =
        Refusal{.code = ReasonCode::better_tile_exists, .detail = "this flight has sent a better tile of this address"};
  }
}

}  // namespace

// The images of one address, each read once however many others it is compared with.
class TileEvaluation::AddressImages {
 public:
  using Image = std::variant<cv::Mat, Refusal>;  // grey levels; or why the bytes are no image

  explicit AddressImages(const PackStore& packs) : packs_(packs) {}

  const Image& read(std::int64_t tile, const BlobPlace& blob, const CandidateSidecar& sidecar) {
    const auto known = images_.find(tile);
    if (known != images_.end()) return known->second;
    return images_.emplace(tile, read_candidate_image(packs_.read(blob, sidecar.sha256), sidecar)).first->second;
  }
  // Null: no image.
  const FineStructure* structure(std::int64_t tile, const BlobPlace& blob, const CandidateSidecar& sidecar) {
    const auto known = structures_.find(tile);
    if (known != structures_.end()) return &known->second;
    const auto* grey = std::get_if<cv::Mat>(&read(tile, blob, sidecar));
    return grey == nullptr ? nullptr : &structures_.try_emplace(tile, *grey).first->second;
  }

 private:
  const PackStore& packs_;
  std::map<std::int64_t, Image> images_;
  std::map<std::int64_t, FineStructure> structures_;
};

// By the tile alone: its bytes, its image, and the map that its flight was matched with.
TileVerdict TileEvaluation::judge(const TileRow& tile, const CandidateSidecar& sidecar, AddressImages& images) {
  TileVerdict verdict{.tile = tile.id};
  const auto rejected = [&verdict](Refusal refusal) {
    verdict.verdict = Verdict::rejected;
    verdict.refusal = std::move(refusal);
    return verdict;
  };
  if (tile.blob->bytes != sidecar.size) {
    return rejected({.code = ReasonCode::hash_mismatch, .detail = "the existing bytes have a different size"});
  }
  const auto& read = images.read(tile.id, *tile.blob, sidecar);
  if (const auto* refusal = std::get_if<Refusal>(&read)) return rejected(*refusal);
  const ImageMetrics metrics = image_metrics(std::get<cv::Mat>(read));
  verdict.measures = OwnMeasures{.contrast_ppm = metrics.contrast_ppm, .sharpness_ppm = metrics.sharpness_ppm};
  if (const auto refusal = check_image_metrics(metrics, rules_)) return rejected(*refusal);

  const auto base = maps_.tile(sidecar.base_package, sidecar.key);
  if (!base) return verdict;
  const Agreement agreement =
      compare_images(*images.structure(tile.id, *tile.blob, sidecar), FineStructure(base->grey));
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

std::vector<std::pair<std::string, std::int64_t>> TileEvaluation::pending(CatalogueThread& catalogue) {
  std::vector<std::pair<std::string, std::int64_t>> list;
  for (const UploadRow& upload :
       catalogue.call([](CandidateCatalogue& in) { return in.uploads_in(UploadState::judging); })) {
    list.emplace_back(upload.client, upload.id);
  }
  return list;
}

// Nothing: it cannot be read now. The other tiles get their verdicts.
std::optional<AddressResult::Judged> TileEvaluation::judge_readable(const TileRow& tile,
                                                                    const CandidateSidecar& sidecar,
                                                                    AddressImages& images) {
  AddressResult::Judged judged{.verdict = {.tile = tile.id}, .keyid = tile.keyid, .sha256 = tile.sha256};
  const auto note = [this, &tile](const Error& error) -> Unread& {
    Unread& unread = unevaluated_[tile.upload];
    if (!unread.why) unread.why = error;
    return unread;
  };
  try {
    judged.verdict = judge(tile, sidecar, images);
  } catch (const PackDamaged& error) {
    const std::lock_guard lock(mutex_);
    note(error);
    judged.damaged = true;
    judged.verdict.verdict = Verdict::rejected;
    judged.verdict.refusal = Refusal{.code = ReasonCode::hash_mismatch, .detail = kDamagedHere};
  } catch (const Error& error) {
    const std::lock_guard lock(mutex_);
    note(error).tiles.insert(tile.id);
    return std::nullopt;
  }
  return judged;
}

// Verdicts on the tiles that wait, then a vote by all that are accepted.
AddressResult TileEvaluation::evaluate(const AddressTask& task, std::int64_t now_ms,
                                       std::optional<Error>& why_unvoted) {
  AddressResult result{.key = task.key, .promoted = task.standing.promoted};
  AddressCandidates candidates = task.standing;
  for (const AcceptedCandidate& candidate : candidates.candidates) result.standing.push_back(candidate.tile);
  AddressImages images(packs_);
  for (const TileRow& tile : task.waiting) {
    CandidateSidecar sidecar = parse_candidate(tile.sidecar, "the catalogue's sidecar");
    auto judged = judge_readable(tile, sidecar, images);
    if (!judged) continue;
    compare_with_accepted(judged->verdict, sidecar, candidates.candidates);
    if (judged->verdict.verdict == Verdict::accepted) {
      candidates.candidates.push_back({.tile = tile.id, .sidecar = std::move(sidecar), .blob = *tile.blob});
      candidates.open = true;
    }
    result.judged.push_back(*std::move(judged));
  }
  if (!candidates.open) {
    result.outcome.emplace();  // as it was
    return result;
  }
  std::ranges::sort(candidates.candidates, {}, &AcceptedCandidate::tile);
  try {
    result.outcome = decide(
        candidates,
        [&](const AcceptedCandidate& one, const AcceptedCandidate& other) { return compare(images, one, other); },
        now_ms, rules_);
  } catch (const Error& error) {  // a pack is damaged: that keeps no other address from its vote
    why_unvoted = error;
  }
  return result;
}

Vote TileEvaluation::compare(AddressImages& images, const AcceptedCandidate& one, const AcceptedCandidate& other) {
  Vote vote{.allowed_mm = allowed_shift_mm(static_cast<double>(one.sidecar.pose.sigma_mm),
                                           static_cast<double>(other.sidecar.pose.sigma_mm), rules_)};
  const FineStructure* first = images.structure(one.tile, one.blob, one.sidecar);
  const FineStructure* second = images.structure(other.tile, other.blob, other.sidecar);
  if (first == nullptr || second == nullptr) return vote;
  const Agreement agreement = compare_images(*first, *second);
  vote.shift_mm = std::llround(agreement.shift_px * pixel_mm(one.sidecar.key));
  vote.correlation_ppm = std::llround(agreement.correlation * 1e6);
  vote.agrees = vote.correlation_ppm >= rules_.min_correlation_ppm && vote.shift_mm <= vote.allowed_mm;
  return vote;
}

// Gives the claim back when what follows it does not come to write its results.
class TileEvaluation::ClaimGuard {
 public:
  ClaimGuard(CatalogueThread& catalogue, const AddressWork::Claim& claim) : catalogue_(catalogue), claim_(claim) {}
  ~ClaimGuard() {
    if (!held_) return;
    try {
      catalogue_.call([this](CandidateCatalogue& in) { in.work().release(claim_); });
    } catch (const std::exception&) {  // the connection has ended, and the claim with it
    }
  }
  ClaimGuard(const ClaimGuard&) = delete;
  ClaimGuard& operator=(const ClaimGuard&) = delete;

  void ends() { held_ = false; }

 private:
  CatalogueThread& catalogue_;
  const AddressWork::Claim& claim_;
  bool held_ = true;
};

// Evaluates what was claimed and writes it. unvoted: called with each address whose vote could not be held.
template <typename Unvoted>
TileEvaluation::Piece TileEvaluation::work_on(CatalogueThread& catalogue, const AddressWork::Claim& claim,
                                              const Unvoted& unvoted) {
  if (claim.addresses.empty()) return {};
  ClaimGuard guard(catalogue, claim);
  const std::int64_t now_ms = clock_.now().unix_s * 1000;
  Piece piece{.more = claim.more};
  std::vector<AddressResult> results;
  const auto begun = std::chrono::steady_clock::now();
  for (const AddressTask& task : claim.addresses) {
    if (!results.empty() && claim.work_time && std::chrono::steady_clock::now() - begun > *claim.work_time) {
      piece.more = true;
      break;
    }
    std::optional<Error> why_unvoted;
    results.push_back(evaluate(task, now_ms, why_unvoted));
    const AddressResult& result = results.back();
    piece.tiles += result.judged.size();
    if (result.outcome) ++piece.addresses;
    if (result.outcome && result.outcome->promotion) ++piece.promoted;
    if (why_unvoted) unvoted(task.key, *why_unvoted);
  }
  guard.ends();
  const bool written = catalogue.call([&](CandidateCatalogue& in) {
    // In this thread, in turn with apply_revocations(): a key that is revoked meanwhile is seen by one of the two.
    return in.work().write(claim, results, now_ms, root_()->revoked);
  });
  if (!written) return {.more = true};
  if (piece.promoted > 0) {
    audit_.record({.act = "tiles.promote",
                   .result = "promoted",
                   .subject = fmt::format("tiles {}", piece.promoted),
                   .detail = fmt::format("{} flights, independent by {}", rules_.flights_to_promote,
                                         rules_.airframes_differ ? "airframes" : "days")});
  }
  return piece;
}

TileEvaluation::Piece TileEvaluation::evaluate_some(CatalogueThread& catalogue, std::int64_t upload) {
  const std::set<std::int64_t> unreadable = [this, upload] {
    const std::lock_guard lock(mutex_);
    const auto found = unevaluated_.find(upload);
    return found == unevaluated_.end() ? std::set<std::int64_t>() : found->second.tiles;
  }();
  const AddressWork::Claim claim =
      catalogue.call([&](CandidateCatalogue& in) { return in.work().claim_tiles(upload, kTilesAtOnce, unreadable); });
  // The vote of an address that cannot be held now is for vote_some().
  Piece piece = work_on(catalogue, claim, [](const TileKey&, const Error&) {});
  if (piece.more) return piece;
  catalogue.call([&](CandidateCatalogue& in) {
    const auto unneeded = in.finish_judging(upload);
    piece.finished = unneeded.has_value();
    if (unneeded) in.remove_unused(*unneeded, [this](const Sha256& pack) { packs_.remove(pack); });
  });
  end_evaluation(upload);
  return piece;
}

// Throws what kept tiles from being read.
void TileEvaluation::end_evaluation(std::int64_t upload) {
  const std::lock_guard lock(mutex_);
  const auto unread = unevaluated_.extract(upload);
  if (unread && unread.mapped().why) throw Error(*unread.mapped().why);
}

TileEvaluation::Piece TileEvaluation::vote_some(CatalogueThread& catalogue) {
  const std::set<TileKey> unread = [this] {
    const std::lock_guard lock(mutex_);
    return unread_;
  }();
  const AddressWork::Claim claim =
      catalogue.call([&unread](CandidateCatalogue& in) { return in.work().claim_votes(kTilesAtOnce, unread); });
  if (claim.number == 0) {
    const std::lock_guard lock(mutex_);
    unread_.clear();
    if (const auto why = std::exchange(why_unread_, std::nullopt)) throw Error(*why);
    return {};
  }
  Piece piece = work_on(catalogue, claim, [this](const TileKey& key, const Error& error) {
    const std::lock_guard lock(mutex_);
    unread_.insert(key);
    if (!why_unread_) why_unread_ = error;
  });
  piece.more = true;
  return piece;
}

std::int64_t TileEvaluation::apply_revocations(CatalogueThread& catalogue) {
  const std::set<std::string> revoked = root_()->revoked;
  {
    const std::lock_guard lock(mutex_);
    if (revoked == applied_revocations_) return 0;
  }
  const std::int64_t withdrawn =
      catalogue.call([&revoked](CandidateCatalogue& in) { return in.work().withdraw(revoked); });
  if (withdrawn > 0) {
    audit_.record({.act = "tiles.withdraw",
                   .result = "withdrawn",
                   .subject = fmt::format("tiles {}", withdrawn),
                   .detail = fmt::format("signed by keys that root version {} revokes", root_()->version)});
  }
  const std::lock_guard lock(mutex_);
  applied_revocations_ = revoked;
  return withdrawn;
}

}  // namespace nadir
