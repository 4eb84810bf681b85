#include "desk/photo_imports.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "base/csv.hpp"
#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "base/input_file.hpp"
#include "base/plural.hpp"
#include "base/printable.hpp"
#include "replay/flight_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr const char *kPhotos = "photos", *kLog = "log", *kFlight = "flight", *kMade = "made", *kCamera = "camera.yaml";
constexpr std::size_t kMaxFolders = 2;  // above a photo

// Parts that are plain names of files: nothing else becomes part of a path.
std::optional<fs::path> plain_path(std::string_view name) {
  fs::path path;
  std::size_t parts = 0;
  for (;;) {
    const std::size_t slash = name.find('/');
    const std::string_view part = name.substr(0, slash);
    if (!plain_picture_name(part) || ++parts > kMaxFolders + 1) return std::nullopt;
    path /= part;
    if (slash == std::string_view::npos) return path;
    name.remove_prefix(slash + 1);
  }
}

std::size_t files_beneath(const fs::path& folder, std::uint64_t& bytes) {
  std::size_t files = 0;
  std::error_code code;
  for (const auto& entry : fs::recursive_directory_iterator(folder, code)) {
    if (!entry.is_regular_file(code)) continue;
    ++files;
    bytes += entry.file_size(code);
  }
  return files;
}

bool hidden(const fs::directory_entry& entry) { return entry.path().filename().string().front() == '.'; }

}  // namespace

std::string_view name_of(ImportedFile::Outcome outcome) {
  switch (outcome) {
    case ImportedFile::Outcome::stored: return "stored";
    case ImportedFile::Outcome::known: return "known";
    case ImportedFile::Outcome::refused: return "refused";
  }
  return {};
}

PhotoImports::PhotoImports(fs::path folder, ImportLimits limits, std::function<std::string()> new_id)
    : folder_(std::move(folder)), limits_(limits), new_id_(std::move(new_id)) {
  std::error_code code;
  fs::create_directories(folder_, code);
  if (code) {
    throw Error({.what = "cannot create the desk's folder",
                 .where = folder_.string(),
                 .found = code.message(),
                 .fix = "check the owner of the folder above it, and its disk"});
  }
  for (const auto& entry : fs::directory_iterator(folder_)) {
    if (hidden(entry)) fs::remove_all(entry.path(), code);
  }
}

std::string PhotoImports::begin() {
  const std::lock_guard lock(mutex_);
  const auto there = static_cast<std::size_t>(std::distance(fs::directory_iterator(folder_), {}));
  if (there >= limits_.imports) {
    throw UsageError({.what = "too many imports are unfinished",
                      .expected = fmt::format("at most {}", count(limits_.imports, "import")),
                      .fix = "finish or remove one of them"});
  }
  std::string id = new_id_();
  while (fs::exists(folder_of(id))) id = new_id_();
  fs::create_directories(folder_of(id) / kPhotos);
  sync_to_disk(folder_of(id));
  sync_to_disk(folder_);
  return id;
}

std::vector<StoredImport> PhotoImports::list() const {
  const std::lock_guard lock(mutex_);
  std::vector<StoredImport> imports;
  for (const auto& entry : fs::directory_iterator(folder_)) {
    if (hidden(entry)) continue;
    StoredImport& one = imports.emplace_back();
    one.id = entry.path().filename().string();
    one.photos = files_beneath(entry.path() / kPhotos, one.bytes);
    one.log = fs::exists(entry.path() / kLog);
  }
  std::sort(imports.begin(), imports.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
  return imports;
}

bool PhotoImports::known(std::string_view id) const {
  return plain_picture_name(id) && fs::is_directory(folder_of(id) / kPhotos);
}

// Hidden first: a removal that is interrupted leaves no half of an import, and the next desk ends it.
bool PhotoImports::remove(std::string_view id) {
  const std::lock_guard lock(mutex_);
  if (!known(id)) return false;
  const fs::path hidden = folder_ / ("." + std::string(id));
  fs::rename(folder_of(id), hidden);
  fs::remove_all(hidden);
  return true;
}

ImportedFile PhotoImports::put_photo(std::string_view id, std::string_view name, ByteView bytes) const {
  const auto path = plain_path(name);
  if (!path) {
    return {printable(name), ImportedFile::Outcome::refused,
            "expected the plain name of a file, with at most two folders above it"};
  }
  std::error_code code;
  fs::create_directories((folder_of(id) / kPhotos / *path).parent_path(), code);
  if (code) return {printable(name), ImportedFile::Outcome::refused, "a photo has the name of a folder above it"};
  return put(folder_of(id) / kPhotos / *path, name, bytes);
}

ImportedFile PhotoImports::put_log(std::string_view id, ByteView bytes) const {
  return put(folder_of(id) / kLog, kLog, bytes);
}

ImportedFile PhotoImports::put(const fs::path& path, std::string_view name, ByteView bytes) const {
  const auto refused = [&](std::string reason) {
    return ImportedFile{printable(name), ImportedFile::Outcome::refused, std::move(reason)};
  };
  if (bytes.empty()) return refused("the file has 0 bytes");
  if (bytes.size() > limits_.file_bytes) {
    return refused(fmt::format("expected at most {} bytes, found {}", limits_.file_bytes, bytes.size()));
  }
  PendingFile file(path, bytes);
  if (file.create()) return {printable(name), ImportedFile::Outcome::stored};
  if (!fs::is_regular_file(path)) return refused("a folder has this name");
  const InputFile there{path};
  if (there.size() == bytes.size() && sha256(there.read(limits_.file_bytes)) == sha256(bytes)) {
    return {printable(name), ImportedFile::Outcome::known};
  }
  return refused("another file has this name");
}

ImportedPhotos PhotoImports::import(std::string_view id, ImportRequest stated, std::string_view camera_text) const {
  const fs::path folder = folder_of(id), made = folder / kMade;
  fs::remove_all(made);  // of an attempt before
  stated.photos = {folder / kPhotos};
  if (fs::exists(folder / kLog)) stated.log = folder / kLog;
  stated.transfer = FrameTransfer::link;
  if (!camera_text.empty()) {
    stated.camera = folder / kCamera;
    write_file_atomic(*stated.camera, camera_text);
  }
  NoProgress progress;
  ImportedPhotos imported;
  imported.result = import_flight(stated, made, progress);
  if (imported.result.findings.has_errors()) return imported;
  imported.camera_text = read_text_file(made / "camera.yaml");
  imported.rows = read_telemetry(made / "telemetry.csv");
  for (const Telemetry& row : imported.rows) {
    imported.photos.push_back(fs::read_symlink(made / "frames" / row.frame));
  }
  fs::remove_all(made);
  return imported;
}

std::optional<std::string> PhotoImports::flight_of(std::string_view id) const {
  if (!fs::exists(folder_of(id) / kFlight)) return std::nullopt;
  return read_text_file(folder_of(id) / kFlight);
}

void PhotoImports::set_flight(std::string_view id, std::string_view flight) const {
  write_file_atomic(folder_of(id) / kFlight, std::string(flight));
}

}  // namespace nadir
