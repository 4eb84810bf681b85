// The photos of one flight, out of what people have: folders with subfolders of a hundred, names that repeat in each,
// several cameras in one folder, several photos in one second, HEIC among JPEG, files that are no photos.
//
// Photos are ordered by the camera's clock, and by name where it is the same or missing. A clock that shows whole
// seconds is taken at the middle of its second; several photos of one second are spread evenly over it.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "base/progress.hpp"
#include "flight_import/photo_metadata.hpp"

namespace nadir {

struct Photo {
  PhotoFacts facts;
  std::string name;     // of the frame: the file's, made unique
  double camera_s = 0;  // its time; only in order (0, 1, 2 …) in a set without times
};

struct PhotoSet {
  std::vector<Photo> photos;  // in order; of one camera and size
  bool timed = false;         // camera_s is time
  double step_s = 1;          // the width within which each time is uncertain
  // Wall clock less UTC where the photos say so: by their zone, or by GPS or exposure times.
  std::optional<double> zone_s;
  std::string zone_from;    // "the photos' offset from UTC", "their GPS times"
  double zone_sigma_s = 0;  // of zone_s
  Findings findings;        // what was left out and what was assumed
};

struct PhotoSource {
  std::vector<std::filesystem::path> paths;  // folders (with their subfolders) or files
  std::string model;                         // the camera to be chosen, by its model; empty: of which there are most
  std::optional<double> interval_s;          // between photos without a time, in the order of their names
};

// Throws UsageError when there are no photos, or none that can be read.
PhotoSet gather_photos(const PhotoSource& source, Progress& progress);

// "DJI_0099" before "DJI_0100" and "img9" before "img10".
bool natural_less(std::string_view a, std::string_view b);

}  // namespace nadir
