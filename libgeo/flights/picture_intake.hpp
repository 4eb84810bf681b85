// A batch of pictures on its way into a flight: one answer for each, and the files of those that become frames.
//
//   PictureIntake intake(what the flight holds, camera, limits, folder);
//   for each picture of the batch:  answers.push_back(intake.judge(offer));
//   intake.name_files();            // complete and synced until now, but without names
//   … one transaction makes intake.added() frames of the flight …
//   intake.keep_files();            // otherwise they lose their names again
//
// picture_check.hpp looks at one picture by itself. Here it is compared with the flight and with the batch before it:
// its name, its bytes, its time, and how much room is left.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/files.hpp"
#include "base/input_file.hpp"
#include "estimation/telemetry.hpp"
#include "flights/picture_check.hpp"

namespace nadir {

// A picture that is offered: its bytes, or a file of a folder. The names of files never become paths.
struct PictureOffer {
  std::string name;
  Telemetry telemetry;  // its time and what was measured then; the frame's name becomes `name`
  ByteView bytes;
  const Directory* folder = nullptr;  // then the file of that name in it, which must not be a link
};

struct PictureAnswer {
  enum class Outcome {
    accepted,
    known,  // the same picture under the same name was accepted before: an upload that was repeated
    refused
  };

  std::string name;
  Outcome outcome = Outcome::accepted;
  std::optional<std::size_t> frame;       // of accepted and known ones
  std::optional<PictureRefusal> refusal;  // of refused ones
};

std::string_view name_of(PictureAnswer::Outcome outcome);

// What the flight holds before the batch.
struct StoredPictures {
  struct Named {
    std::size_t frame = 0;
    Sha256 sha256;
  };

  std::size_t frames = 0;
  std::optional<double> last_time_s;  // of the last frame
  std::uint64_t bytes = 0;
  std::function<std::optional<Named>(std::string_view name)> of_name;
  std::function<std::optional<std::size_t>(const Sha256& content)> of_content;
};

// Becomes a frame.
struct NewPicture {
  PictureFacts facts;
  std::string file;  // in the folder of pictures
  Telemetry telemetry;
};

class PictureIntake {
 public:
  PictureIntake(StoredPictures stored, const CameraModel& camera, const PictureLimits& limits,
                std::filesystem::path folder);
  ~PictureIntake();  // files that were not kept lose their names
  PictureIntake(const PictureIntake&) = delete;
  PictureIntake& operator=(const PictureIntake&) = delete;

  // Pictures in the order of time. Throws Error and OutOfSpace where a file cannot be stored.
  PictureAnswer judge(const PictureOffer& offer);
  const std::map<std::size_t, NewPicture>& added() const { return added_; }  // by frame

  void name_files();  // replaces what a killed process left under their names: that belongs to no batch
  void keep_files() { named_.clear(); }

 private:
  using Judgement = std::variant<PictureFacts, PictureRefusal>;
  Judgement fits_into_flight(const PictureOffer& offer, const PictureFacts& facts) const;
  std::optional<StoredPictures::Named> of_name(std::string_view name) const;
  std::optional<std::size_t> of_content(const Sha256& content) const;
  std::size_t next_frame() const { return stored_.frames + added_.size(); }

  StoredPictures stored_;
  const CameraModel& camera_;
  const PictureLimits& limits_;
  std::filesystem::path folder_;
  std::optional<double> last_time_s_;
  std::uint64_t bytes_ = 0;  // of the flight with the batch so far
  std::map<std::size_t, NewPicture> added_;
  std::map<std::string, std::size_t, std::less<>> frame_of_name_;
  std::map<Sha256, std::size_t> frame_of_content_;
  std::vector<std::pair<std::filesystem::path, std::unique_ptr<PendingFile>>> files_;
  std::vector<std::filesystem::path> named_;
};

}  // namespace nadir
