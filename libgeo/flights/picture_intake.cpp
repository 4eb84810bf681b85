#include "flights/picture_intake.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.hpp"
#include "base/plural.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

// The bytes of an offer, which `read` holds where they come from a file.
std::variant<ByteView, PictureRefusal> bytes_of(const PictureOffer& offer, const PictureLimits& limits, Bytes& read) {
  if (offer.folder == nullptr || !plain_picture_name(offer.name)) return offer.bytes;
  try {
    const InputFile file = offer.folder->open(offer.name);
    if (file.size() > limits.picture_bytes) {
      return PictureRefusal{PictureProblem::too_large,
                            fmt::format("expected at most {} bytes, found {}", limits.picture_bytes, file.size())};
    }
    read = file.read(limits.picture_bytes);
    return ByteView(read);
  } catch (const Error& error) {
    return PictureRefusal{PictureProblem::not_a_file,
                          fmt::format("expected a readable file, found {}", error.text().found)};
  }
}

PictureAnswer refused(const PictureOffer& offer, PictureRefusal refusal) {
  return {offer.name, PictureAnswer::Outcome::refused, std::nullopt, std::move(refusal)};
}

}  // namespace

std::string_view name_of(PictureAnswer::Outcome outcome) {
  switch (outcome) {
    case PictureAnswer::Outcome::accepted: return "accepted";
    case PictureAnswer::Outcome::known: return "known";
    case PictureAnswer::Outcome::refused: return "refused";
  }
  return {};
}

PictureIntake::PictureIntake(StoredPictures stored, const CameraModel& camera, const PictureLimits& limits,
                             fs::path folder)
    : stored_(std::move(stored)),
      camera_(camera),
      limits_(limits),
      folder_(std::move(folder)),
      last_time_s_(stored_.last_time_s),
      bytes_(stored_.bytes) {}

PictureIntake::~PictureIntake() {
  std::error_code ignored;
  for (const fs::path& path : named_) fs::remove(path, ignored);
}

PictureAnswer PictureIntake::judge(const PictureOffer& offer) {
  Bytes read;
  auto bytes = bytes_of(offer, limits_, read);
  if (auto* refusal = std::get_if<PictureRefusal>(&bytes)) return refused(offer, std::move(*refusal));
  const ByteView content = std::get<ByteView>(bytes);
  Judgement judgement = check_picture(offer.name, offer.telemetry.time_s, content, camera_, limits_);
  if (const auto* facts = std::get_if<PictureFacts>(&judgement)) {
    const auto same = of_name(offer.name);
    if (same && same->sha256 == facts->sha256) {
      return {offer.name, PictureAnswer::Outcome::known, same->frame, std::nullopt};
    }
    judgement = fits_into_flight(offer, *facts);
  }
  if (auto* refusal = std::get_if<PictureRefusal>(&judgement)) return refused(offer, std::move(*refusal));

  const PictureFacts& facts = std::get<PictureFacts>(judgement);
  const std::size_t frame = next_frame();
  NewPicture picture{facts, fmt::format("{:08}.{}", frame, name_of(facts.format)), offer.telemetry};
  picture.telemetry.frame = offer.name;
  const fs::path path = folder_ / picture.file;
  files_.emplace_back(path, std::make_unique<PendingFile>(path, content));
  frame_of_name_.emplace(offer.name, frame);
  frame_of_content_.emplace(facts.sha256, frame);
  last_time_s_ = offer.telemetry.time_s;
  bytes_ += facts.bytes;
  added_.emplace(frame, std::move(picture));
  return {offer.name, PictureAnswer::Outcome::accepted, frame, std::nullopt};
}

PictureIntake::Judgement PictureIntake::fits_into_flight(const PictureOffer& offer, const PictureFacts& facts) const {
  if (const auto same_name = of_name(offer.name)) {
    return PictureRefusal{PictureProblem::name_taken,
                          fmt::format("frame {} has this name and other bytes", same_name->frame)};
  }
  if (const auto same_bytes = of_content(facts.sha256)) {
    return PictureRefusal{PictureProblem::content_known, fmt::format("frame {} has the same bytes", *same_bytes)};
  }
  if (last_time_s_ && offer.telemetry.time_s <= *last_time_s_) {
    return PictureRefusal{PictureProblem::out_of_order,
                          fmt::format("expected a time after that of the picture before, {:.3f} s, found {:.3f} s",
                                      *last_time_s_, offer.telemetry.time_s)};
  }
  if (next_frame() >= limits_.flight_pictures ||
      facts.bytes > limits_.flight_bytes - std::min(bytes_, limits_.flight_bytes)) {
    return PictureRefusal{PictureProblem::flight_full,
                          fmt::format("expected at most {} and {} bytes in a flight",
                                      count(limits_.flight_pictures, "picture"), limits_.flight_bytes)};
  }
  return facts;
}

std::optional<StoredPictures::Named> PictureIntake::of_name(std::string_view name) const {
  const auto found = frame_of_name_.find(name);
  if (found == frame_of_name_.end()) return stored_.of_name(name);
  return StoredPictures::Named{found->second, added_.at(found->second).facts.sha256};
}

std::optional<std::size_t> PictureIntake::of_content(const Sha256& content) const {
  const auto found = frame_of_content_.find(content);
  return found == frame_of_content_.end() ? stored_.of_content(content) : std::optional(found->second);
}

void PictureIntake::name_files() {
  for (auto& [path, file] : files_) {
    file->replace();
    named_.push_back(path);
  }
  files_.clear();  // closes them
}

}  // namespace nadir
