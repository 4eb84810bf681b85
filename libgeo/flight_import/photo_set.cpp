#include "flight_import/photo_set.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>
#include <set>
#include <tuple>

#include "base/plural.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxFolderDepth = 4;
constexpr std::size_t kMostPhotos = 100'000;

struct PhotoFiles {
  std::vector<fs::path> files;
  std::size_t heic = 0, other = 0;
  fs::path first_heic;
};

void add_file(const fs::path& path, PhotoFiles& found) {
  if (path.filename().string().starts_with('.')) return;
  if (has_frame_extension(path)) {
    found.files.push_back(path);
  } else if (has_heic_extension(path)) {
    if (found.heic++ == 0) found.first_heic = path;
  } else {
    ++found.other;
  }
}

PhotoFiles list_photos(const std::vector<fs::path>& paths) {
  PhotoFiles found;
  for (const fs::path& path : paths) {
    std::error_code error;
    if (fs::is_regular_file(path, error)) {
      add_file(path, found);
      continue;
    }
    if (!fs::is_directory(path, error)) {
      throw UsageError({.what = "cannot read the photos",
                        .where = path.string(),
                        .expected = "a folder or files with photos",
                        .found = fs::exists(path, error) ? "something else" : "nothing"});
    }
    for (fs::recursive_directory_iterator at(path, error), end; !error && at != end; at.increment(error)) {
      if (at.depth() >= kMaxFolderDepth) at.disable_recursion_pending();
      std::error_code ignored;  // of a link that leads nowhere
      if (at->is_regular_file(ignored)) add_file(at->path(), found);
    }
    if (error) {
      throw UsageError({.what = "cannot read the photos", .where = path.string(), .found = error.message()});
    }
  }
  if (found.files.size() > kMostPhotos) {
    throw UsageError({.what = "too many photos for one flight",
                      .expected = fmt::format("at most {}", kMostPhotos),
                      .found = std::to_string(found.files.size())});
  }
  std::sort(found.files.begin(), found.files.end(),
            [](const fs::path& a, const fs::path& b) { return natural_less(a.string(), b.string()); });
  found.files.erase(std::unique(found.files.begin(), found.files.end()), found.files.end());
  if (found.files.empty()) {
    if (found.heic > 0) reject_heic(found.first_heic.string());
    throw UsageError({.what = "there are no photos",
                      .where = paths.empty() ? "" : paths.front().string(),
                      .expected = "files ending in .jpg, .jpeg, .png, .tif or .tiff",
                      .found = found.other == 0 ? "an empty folder" : count(found.other, "other file"),
                      .fix = "give the folder of the photos with --photos"});
  }
  return found;
}

std::string frame_name(const std::string& name) {
  std::string plain = printable(name);
  for (char& c : plain) {
    if (c == '"' || c == ',' || c == '/') c = '_';
  }
  return plain;
}

// The file's name; with that of its folder where another photo has it; with a number where that is not enough.
void name_frames(std::vector<Photo>& photos, Findings& findings) {
  std::map<std::string, std::size_t> uses;
  for (const Photo& photo : photos) ++uses[frame_name(photo.facts.file.filename().string())];
  std::set<std::string> taken;
  std::size_t renamed = 0;
  for (Photo& photo : photos) {
    const std::string file = frame_name(photo.facts.file.filename().string());
    photo.name = file;
    if (uses[file] > 1) {
      photo.name = frame_name(photo.facts.file.parent_path().filename().string()) + "_" + file;
      ++renamed;
    }
    const std::string wanted = photo.name;
    for (int n = 2; !taken.insert(photo.name).second; ++n) photo.name = fmt::format("{}_{}", n, wanted);
  }
  if (renamed == 0) return;
  findings.add({.code = "import.names",
                .severity = Severity::note,
                .where = count(renamed, "photo"),
                .expected = "a name of its own for each photo",
                .found = "the same names in several folders",
                .fix = "their frames are named after folder and file"});
}

std::string camera_text(const PhotoFacts& facts) {
  const std::string name = facts.model.empty() ? "an unnamed camera" : facts.model;
  return fmt::format("{} with {}×{} pixels", name, facts.size.width, facts.size.height);
}

void keep_one_camera(std::vector<Photo>& photos, const std::string& model, Findings& findings) {
  using Kind = std::tuple<std::string, int, int, int>;
  const auto kind_of = [](const PhotoFacts& facts) {
    // Zooms of one camera are different cameras; a tenth of a millimetre is not.
    return Kind{facts.make + " " + facts.model, facts.size.width, facts.size.height,
                static_cast<int>(std::lround(facts.focal_mm.value_or(0) * 5))};
  };
  std::map<Kind, std::size_t> counts;
  std::map<Kind, std::string> texts;
  for (const Photo& photo : photos) {
    ++counts[kind_of(photo.facts)];
    texts.emplace(kind_of(photo.facts), camera_text(photo.facts));
  }
  const Kind* chosen = nullptr;
  for (const auto& [kind, number] : counts) {
    const bool wanted = model.empty() || std::get<0>(kind).ends_with(" " + model);
    if (wanted && (chosen == nullptr || number > counts.at(*chosen))) chosen = &kind;
  }
  if (chosen == nullptr) {
    std::string names;
    for (const auto& [kind, text] : texts) names += (names.empty() ? "" : "; ") + text;
    throw UsageError({.what = "no photo is of this camera", .where = "--model", .expected = names, .found = model});
  }
  if (counts.size() == 1) return;
  std::string others;
  for (const auto& [kind, number] : counts) {
    if (kind != *chosen) others += fmt::format("{}{} of {}", others.empty() ? "" : "; ", number, texts.at(kind));
  }
  findings.add({.code = "import.other_camera",
                .severity = Severity::warning,
                .where = fmt::format("{} of {} are used", counts.at(*chosen), count(photos.size(), "photo")),
                .expected = "one camera: " + texts.at(*chosen),
                .found = others,
                .fix = "--model NAME chooses another camera; import each by itself"});
  const Kind kept = *chosen;
  std::erase_if(photos, [&](const Photo& photo) { return kind_of(photo.facts) != kept; });
}

// Photos of one second, in the order of their names, each at its share of it.
void spread_bursts(PhotoSet& set) {
  std::size_t spread = 0;
  for (std::size_t i = 0; i < set.photos.size();) {
    std::size_t end = i + 1;
    while (end < set.photos.size() && set.photos[end].camera_s == set.photos[i].camera_s) ++end;
    const double number = static_cast<double>(end - i), step_s = set.step_s;
    const double from_s = set.photos[i].camera_s;
    for (std::size_t j = i; j < end; ++j) {
      set.photos[j].camera_s = from_s + step_s * (static_cast<double>(j - i) + 0.5) / number;
    }
    if (end - i > 1) spread += end - i;
    i = end;
  }
  if (spread == 0) return;
  set.findings.add({.code = "import.burst",
                    .severity = Severity::note,
                    .where = count(spread, "photo"),
                    .expected = "a time of its own for each photo",
                    .found = fmt::format("several within {} s, to which the camera writes its time", set.step_s),
                    .fix = "they are spread evenly over it, in the order of their names"});
}

void order_photos(const PhotoSource& source, PhotoSet& set) {
  std::size_t timed = 0;
  double step_s = 0;
  for (const Photo& photo : set.photos) {
    if (!photo.facts.camera_s) continue;
    ++timed;
    step_s = std::max(step_s, photo.facts.clock_step_s);
  }
  const std::size_t all = set.photos.size();
  if (timed * 2 < all || source.interval_s) {  // by name
    for (std::size_t i = 0; i < all; ++i) {
      set.photos[i].camera_s = static_cast<double>(i) * source.interval_s.value_or(1);
    }
    set.timed = source.interval_s.has_value();
    set.step_s = 0;
    if (set.timed) {
      set.findings.add({.code = "import.interval",
                        .severity = Severity::note,
                        .where = count(all, "photo"),
                        .expected = "times",
                        .found = fmt::format("assumed: {} s apart, in the order of their names", *source.interval_s)});
    }
    return;
  }
  if (timed < all) {
    set.findings.add({.code = "import.photo_time",
                      .severity = Severity::warning,
                      .where = count(all - timed, "photo"),
                      .expected = "a time (DateTimeOriginal) in each photo",
                      .found = "none",
                      .fix = "they are left out"});
    std::erase_if(set.photos, [](const Photo& photo) { return !photo.facts.camera_s; });
  }
  set.timed = true;
  set.step_s = step_s;
  std::size_t earlier = 0;
  for (std::size_t i = 0; i < set.photos.size(); ++i) {
    Photo& photo = set.photos[i];
    // Where one photo has no fraction, none counts: they would be out of order within the second.
    photo.camera_s = step_s >= 1 ? std::floor(*photo.facts.camera_s) : *photo.facts.camera_s;
    if (i > 0 && photo.camera_s < set.photos[i - 1].camera_s) ++earlier;
  }
  if (earlier > 0) {
    set.findings.add({.code = "import.order",
                      .severity = Severity::note,
                      .where = count(earlier, "photo"),
                      .expected = "names in the order of time",
                      .found = "a time earlier than that of the photo before",
                      .fix = "times decide; if the camera's clock was set in flight, import the two parts separately"});
  }
  std::stable_sort(set.photos.begin(), set.photos.end(),
                   [](const Photo& a, const Photo& b) { return a.camera_s < b.camera_s; });
  spread_bursts(set);
}

void find_zone(PhotoSet& set) {
  std::vector<double> differences_s;
  for (const Photo& photo : set.photos) {
    if (photo.facts.utc_s && photo.facts.camera_s) {
      differences_s.push_back(photo.camera_s - *photo.facts.utc_s);
    }
  }
  if (differences_s.size() * 2 > set.photos.size()) {
    std::sort(differences_s.begin(), differences_s.end());
    set.zone_s = differences_s[differences_s.size() / 2];
    set.zone_from = "the UTC in the photos (GPS or exposure times)";
    set.zone_sigma_s = std::max(0.5, (differences_s.back() - differences_s.front()) / 4);
    return;
  }
  std::map<double, std::size_t> zones;
  for (const Photo& photo : set.photos) {
    if (photo.facts.zone_s) ++zones[*photo.facts.zone_s];
  }
  for (const auto& [zone_s, number] : zones) {
    if (number * 2 <= set.photos.size()) continue;
    set.zone_s = zone_s;
    set.zone_from = "the photos' offset from UTC; a camera's clock may be off by seconds";
    set.zone_sigma_s = 2;
  }
}

}  // namespace

bool natural_less(std::string_view a, std::string_view b) {
  std::size_t i = 0, j = 0;
  const auto digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  while (i < a.size() && j < b.size()) {
    if (digit(a[i]) && digit(b[j])) {
      while (i < a.size() && a[i] == '0') ++i;
      while (j < b.size() && b[j] == '0') ++j;
      std::size_t end_a = i, end_b = j;
      while (end_a < a.size() && digit(a[end_a])) ++end_a;
      while (end_b < b.size() && digit(b[end_b])) ++end_b;
      if (end_a - i != end_b - j) return end_a - i < end_b - j;
      const int order = a.substr(i, end_a - i).compare(b.substr(j, end_b - j));
      if (order != 0) return order < 0;
      i = end_a;
      j = end_b;
    } else {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i;
      ++j;
    }
  }
  if (a.size() - i != b.size() - j) return a.size() - i < b.size() - j;
  return a < b;  // "img01" and "img1"
}

PhotoSet gather_photos(const PhotoSource& source, Progress& progress) {
  const PhotoFiles files = list_photos(source.paths);
  PhotoSet set;
  if (files.heic > 0) {
    set.findings.add({.code = "import.heic",
                      .severity = Severity::warning,
                      .where = fmt::format("{}, such as {}", count(files.heic, "photo"), files.first_heic.string()),
                      .expected = "JPEG, PNG or TIFF",
                      .found = "HEIC",
                      .fix = "they are left out. HEIC is not supported: convert to JPEG"});
  }
  std::size_t unreadable = 0, damaged = 0;
  std::string why_unreadable, why_damaged;
  progress.begin("reading photos", files.files.size(), "photos");
  for (const fs::path& file : files.files) {
    try {
      PhotoFacts facts = read_photo_facts(file);
      if (!facts.problem.empty() && damaged++ == 0) why_damaged = file.string() + ": " + facts.problem;
      set.photos.push_back({std::move(facts), {}, 0});
    } catch (const Error& error) {
      if (unreadable++ == 0) {
        why_unreadable = file.string() + ": " + (error.text().found.empty() ? error.text().what : error.text().found);
      }
    }
    progress.advance();
  }
  progress.end();
  if (unreadable > 0) {
    set.findings.add({.code = "import.photo_unreadable",
                      .severity = Severity::warning,
                      .where = count(unreadable, "file"),
                      .expected = "complete images",
                      .found = why_unreadable,
                      .fix = "they are left out; copy them from the camera again"});
  }
  if (damaged > 0) {
    set.findings.add({.code = "import.photo_metadata",
                      .severity = Severity::warning,
                      .where = count(damaged, "photo"),
                      .expected = "EXIF and XMP that can be read",
                      .found = why_damaged});
  }
  if (set.photos.empty()) {
    throw UsageError({.what = "none of the photos can be read",
                      .where = files.files.front().parent_path().string(),
                      .expected = "complete images",
                      .found = why_unreadable});
  }
  keep_one_camera(set.photos, source.model, set.findings);
  order_photos(source, set);
  name_frames(set.photos, set.findings);
  find_zone(set);
  return set;
}

}  // namespace nadir
