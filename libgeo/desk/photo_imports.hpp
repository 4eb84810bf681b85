// Photos that are on their way to becoming a flight: what people have is uploaded as it is, photos with EXIF and an
// autopilot's log, and then imported as `nadir flight import` does (flight_import/flight_import.hpp).
//
//   FOLDER/ID/photos/…   as they were sent, with up to two folders above each
//   FOLDER/ID/log        an autopilot's log
//   FOLDER/ID/flight     the flight that it is becoming, once that exists: after a kill it goes on with this one
//
// What is missing for a flight (a focal length, a height) is asked for, and the files stay until the import is finished
// or removed. A file that was answered is synced.
//
// Safe from several threads, but an import is finished by one at a time (its lane in the API's queue).
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "flight_import/flight_import.hpp"
#include "flights/picture_intake.hpp"

namespace nadir {

struct ImportLimits {
  std::size_t imports = 16;  // at a time
  std::size_t files = 100'000;
  std::uint64_t file_bytes = std::uint64_t{256} << 20;
};

struct StoredImport {
  std::string id;
  std::size_t photos = 0;
  std::uint64_t bytes = 0;
  bool log = false;
};

struct ImportedFile {
  enum class Outcome { stored, known, refused };
  std::string name;
  Outcome outcome = Outcome::stored;
  std::string reason{};  // of refused ones
};
std::string_view name_of(ImportedFile::Outcome outcome);

// What the photos became: camera, telemetry, and each frame's photo.
struct ImportedPhotos {
  ImportResult result;
  std::string camera_text;
  std::vector<Telemetry> rows;                // in the order of time
  std::vector<std::filesystem::path> photos;  // of each row
};

class PhotoImports {
 public:
  // Creates the folder. Throws Error when it cannot be written.
  PhotoImports(std::filesystem::path folder, ImportLimits limits, std::function<std::string()> new_id);

  std::string begin();  // its id. Throws UsageError when there are too many
  std::vector<StoredImport> list() const;
  bool known(std::string_view id) const;
  bool remove(std::string_view id);  // false: there is none

  // name: "DJI_0001.JPG" or "100MEDIA/DJI_0001.JPG". The same file under the same name is `known`.
  ImportedFile put_photo(std::string_view id, std::string_view name, ByteView bytes) const;
  ImportedFile put_log(std::string_view id, ByteView bytes) const;

  // stated: all but where the files are. camera_text: of a camera.yaml; empty: a draft is made. Where something is
  // missing, the result's findings have errors, and there are no rows. Throws UsageError for sources that cannot be
  // read at all.
  ImportedPhotos import(std::string_view id, ImportRequest stated, std::string_view camera_text) const;

  // The flight that this import is becoming.
  std::optional<std::string> flight_of(std::string_view id) const;
  void set_flight(std::string_view id, std::string_view flight) const;

 private:
  std::filesystem::path folder_of(std::string_view id) const { return folder_ / id; }
  ImportedFile put(const std::filesystem::path& path, std::string_view name, ByteView bytes) const;

  const std::filesystem::path folder_;
  const ImportLimits limits_;
  const std::function<std::string()> new_id_;
  mutable std::mutex mutex_;  // of the list of imports
};

}  // namespace nadir
