// A folder into which another program writes images, one file each.
//
// An image is delivered when its writer has closed it or moved it into place, and only when it is complete. Pending
// images are delivered in the order of their names. A truncated file is reported as a failure, and delivered once its
// writer has completed it.
//
// An image has the time at which it is noticed. Where this thread had to wait for a processor before, the file's own
// time of its last change says when within that time it came.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>

#include "base/bytes.hpp"
#include "camera/camera_source.hpp"
#include "service/clock.hpp"

namespace nadir {

// Whether these bytes are a complete JPEG, PNG, WebP or TIFF, by the markers at its begin and end, or its directory.
// Nothing is decoded: this detects truncation, not damage inside. Bytes after the end are ignored, as decoders do.
bool is_complete_image(ByteView bytes);

// Whether a file of this name counts as an image: .jpg, .jpeg, .png, .webp, .tif, .tiff in any case, and not hidden.
bool has_image_name(const std::filesystem::path& name);

class FolderWatch;

class FolderCamera final : public CameraSource {
 public:
  FolderCamera(std::filesystem::path folder, const FlightClock& clock, Backlog backlog = Backlog::skip);
  ~FolderCamera() override;

  // A folder that is missing or vanishes is a failure until it is back.
  CameraReading next(std::chrono::milliseconds at_most, std::stop_token stop) override;

  std::string describe() const override { return "folder " + folder_.string(); }

 private:
  // A file and its state: distinguishes an image from its successor under the same name.
  struct Version {
    std::int64_t modified_ns = 0;
    std::uint64_t size = 0;
    std::uint64_t inode = 0;
    std::string name{};

    bool operator==(const Version&) const = default;
  };

  struct Noticed {
    double time_s = 0, delayed_s = 0;  // it may have come by so much before
  };

  static std::optional<Version> version_of(const std::filesystem::path& file);

  std::optional<CameraReading> open();
  void scan_folder(bool all);
  std::optional<CameraReading> take(const std::string& name, const Noticed& noticed);
  Noticed notice();

  std::filesystem::path folder_;
  const FlightClock& clock_;
  Backlog backlog_;
  std::unique_ptr<FolderWatch> watch_;
  std::map<std::string, Noticed> pending_;  // by name
  double delayed_s_ = 0;                    // thread_delayed_s() when it last looked
  Version last_;                            // delivered last
};

}  // namespace nadir
