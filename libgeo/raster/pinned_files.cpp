#include "raster/pinned_files.hpp"

#include <cpl_conv.h>
#include <cpl_string.h>
#include <cpl_vsi.h>
#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "raster/gdal_dataset.hpp"

namespace nadir {
namespace {

constexpr const char* kPrefix = "/vsipinned/";  // GDAL keeps the pointer
// The rows of tiles that a metatile touches in a wide image lie far apart in its file: some dozens of blocks.
constexpr std::uint64_t kCache_bytes = std::uint64_t{96} << 20;

// A URL as GDAL's drivers would take it apart is no path. The last part says to them and to people what it is.
std::string name_for_gdal(const std::string& url) {
  return fmt::format("{}/{}", sha256(as_bytes(url)).hex().substr(0, 32), url.substr(url.rfind('/') + 1));
}

// GDAL keeps its file systems for the whole process; so are these.
struct Mounts {
  std::mutex mutex;
  std::map<std::string, std::unique_ptr<PinnedObject>, std::less<>> objects;  // by their names beneath the prefix
  std::shared_ptr<BlockCache> cache = std::make_shared<BlockCache>(kCache_bytes);

  PinnedObject* find(std::string_view name) {
    const std::lock_guard lock(mutex);
    const auto found = objects.find(name);
    return found == objects.end() ? nullptr : found->second.get();
  }
};

Mounts& mounts() {
  static Mounts all;
  return all;
}

PinnedObject* behind(const char* name) { return mounts().find(name); }

// An open file. What goes wrong is remembered by the object, because GDAL knows only "fewer bytes".
struct OpenFile {
  PinnedObject& object;
  std::uint64_t at = 0;
  bool at_end = false;
};

int stat_object(void*, const char* name, VSIStatBufL* stat, int) {
  const PinnedObject* object = behind(name);
  std::memset(stat, 0, sizeof *stat);
  if (object == nullptr) return -1;
  stat->st_mode = S_IFREG | S_IRUSR;
  stat->st_size = static_cast<decltype(stat->st_size)>(object->pin().bytes);
  return 0;
}

void* open_object(void*, const char* name, const char* access) {
  PinnedObject* object = behind(name);
  if (object == nullptr || std::strpbrk(access, "wa+") != nullptr) {
    errno = object == nullptr ? ENOENT : EROFS;
    return nullptr;
  }
  return new OpenFile{*object};
}

std::size_t read_object(void* handle, void* target, std::size_t size, std::size_t count) {
  auto& file = *static_cast<OpenFile*>(handle);
  const std::uint64_t all = file.object.pin().bytes;
  const std::uint64_t wanted = size * count;
  const std::uint64_t there = std::min<std::uint64_t>(wanted, all - std::min(file.at, all));
  file.at_end = there < wanted;
  if (there == 0) return 0;
  try {
    file.object.read_at(file.at, {static_cast<std::uint8_t*>(target), static_cast<std::size_t>(there)});
  } catch (const std::exception& error) {  // nothing may be thrown through GDAL
    CPLError(CE_Failure, CPLE_FileIO, "%s", error.what());
    return 0;
  }
  file.at += there;
  return static_cast<std::size_t>(there / size);
}

// As GDAL calls it when it reads many tiles at once: those of a row lie one after the other, and are fetched together.
int read_ranges(void* handle, int count, void** targets, const vsi_l_offset* offsets, const std::size_t* sizes) {
  auto& file = *static_cast<OpenFile*>(handle);
  const ObjectPin& pin = file.object.pin();
  std::vector<std::pair<std::uint64_t, std::uint64_t>> spans;  // begin, end
  for (int i = 0; i < count; ++i) {
    if (offsets[i] < pin.bytes)
      spans.emplace_back(offsets[i], std::min<std::uint64_t>(offsets[i] + sizes[i], pin.bytes));
  }
  std::sort(spans.begin(), spans.end());
  try {
    for (std::size_t i = 0; i < spans.size();) {
      auto [begin, end] = spans[i++];
      while (i < spans.size() && spans[i].first <= end + pin.block_bytes) end = std::max(end, spans[i++].second);
      file.object.prefetch(begin, end - begin);
    }
  } catch (const std::exception& error) {  // nothing may be thrown through GDAL
    CPLError(CE_Failure, CPLE_FileIO, "%s", error.what());
    return -1;
  }
  for (int i = 0; i < count; ++i) {
    file.at = offsets[i];
    if (read_object(handle, targets[i], 1, sizes[i]) != sizes[i]) return -1;
  }
  return 0;
}

int seek_object(void* handle, vsi_l_offset offset, int whence) {
  auto& file = *static_cast<OpenFile*>(handle);
  const std::uint64_t base = whence == SEEK_CUR ? file.at : whence == SEEK_END ? file.object.pin().bytes : 0;
  file.at = base + offset;
  file.at_end = false;
  return 0;
}

void install_file_system() {
  VSIFilesystemPluginCallbacksStruct* calls = VSIAllocFilesystemPluginCallbacksStruct();
  calls->stat = stat_object;
  calls->open = open_object;
  calls->read = read_object;
  calls->read_multi_range = read_ranges;
  calls->seek = seek_object;
  calls->tell = [](void* handle) -> vsi_l_offset { return static_cast<OpenFile*>(handle)->at; };
  calls->eof = [](void* handle) { return static_cast<OpenFile*>(handle)->at_end ? 1 : 0; };
  calls->close = [](void* handle) {
    delete static_cast<OpenFile*>(handle);
    return 0;
  };
  // Nothing lies beside an object: no world file, no mask, no overviews.
  calls->sibling_files = [](void*, const char*) { return static_cast<char**>(CPLCalloc(1, sizeof(char*))); };
  VSIInstallPluginHandler(kPrefix, calls);
  VSIFreeFilesystemPluginCallbacksStruct(calls);
}

std::string sign(const ObjectAddress& object) {
  const QuietGdal quiet;
  const char* const prefix = object.store == ObjectAddress::Store::s3   ? "/vsis3/"
                             : object.store == ObjectAddress::Store::gs ? "/vsigs/"
                                                                        : "/vsiaz/";
  const std::string name = prefix + object.container + "/" + object.key;
  char* url = VSIGetSignedURL(name.c_str(), nullptr);
  std::string text = url == nullptr ? "" : url;
  CPLFree(url);
  if (text.empty()) {
    throw UsageError({.what = "there are no credentials for object storage",
                      .where = object.url,
                      .expected = "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, ~/.aws/credentials, or "
                                  "AWS_NO_SIGN_REQUEST=YES (s3); GS_ACCESS_KEY_ID and GS_SECRET_ACCESS_KEY (gs); "
                                  "AZURE_STORAGE_ACCOUNT and AZURE_STORAGE_ACCESS_KEY (az)",
                      .found = QuietGdal::last_error(),
                      .fix = "set them in the environment; docs/commands/cache-pin.md says more"});
  }
  // GDAL signs with an empty key where it was asked not to sign.
  if (object.store == ObjectAddress::Store::s3 && CPLTestBool(CPLGetConfigOption("AWS_NO_SIGN_REQUEST", "NO"))) {
    text.resize(std::min(text.size(), text.find('?')));
  }
  return text;
}

// GDAL signs for an hour, and may ask the machine's cloud for new credentials each time: a signature serves ten
// minutes.
std::string signed_by_gdal(const ObjectAddress& object) {
  using Clock = std::chrono::steady_clock;
  struct Signature {
    std::string url;
    Clock::time_point since;
  };
  static std::mutex mutex;
  static std::map<std::string, Signature> signatures;
  const std::lock_guard lock(mutex);
  Signature& known = signatures[object.url];
  if (known.url.empty() || Clock::now() - known.since > std::chrono::minutes(10)) known = {sign(object), Clock::now()};
  return known.url;
}

}  // namespace

std::shared_ptr<ObjectClient> object_client() {
  static const std::shared_ptr<ObjectClient> client = [] {
    ObjectClientSettings settings;
    // GDAL's names for what is the same here. CURL_CA_BUNDLE: the certificate of a store of one's own.
    if (const char* bundle = CPLGetConfigOption("CURL_CA_BUNDLE", nullptr)) settings.authorities = bundle;
    const auto take = [](int& value, const char* name) {
      if (const char* text = CPLGetConfigOption(name, nullptr)) value = std::clamp(std::atoi(text), 1, 3600);
    };
    take(settings.connect_timeout_s, "GDAL_HTTP_CONNECTTIMEOUT");
    take(settings.request_timeout_s, "GDAL_HTTP_TIMEOUT");
    take(settings.stall_timeout_s, "GDAL_HTTP_LOW_SPEED_TIME");
    take(settings.slowest_bytes_s, "GDAL_HTTP_LOW_SPEED_LIMIT");
    take(settings.attempts, "GDAL_HTTP_MAX_RETRY");
    return std::make_shared<ObjectClient>(signed_by_gdal, settings);
  }();
  return client;
}

void mount_object(const ObjectPin& pin) {
  static std::once_flag once;
  std::call_once(once, install_file_system);
  Mounts& all = mounts();
  const std::lock_guard lock(all.mutex);
  const std::string name = name_for_gdal(pin.address.url);
  const auto found = all.objects.find(name);
  if (found == all.objects.end()) {
    all.objects.emplace(name, std::make_unique<PinnedObject>(pin, object_client(), all.cache));
  } else if (found->second->pin() != pin) {
    throw UsageError({.what = "an object is pinned twice, and not alike",
                      .where = pin.address.url,
                      .expected = "sha256 " + found->second->pin().sha256.hex(),
                      .found = "sha256 " + pin.sha256.hex(),
                      .fix = "keep the pin of the object that is there now"});
  }
}

PinnedObject* mounted_object(const std::filesystem::path& path) {
  return is_remote_name(path.string()) ? mounts().find(name_for_gdal(path.string())) : nullptr;
}

std::string gdal_name(const std::filesystem::path& path) {
  return mounted_object(path) == nullptr ? path.string() : kPrefix + name_for_gdal(path.string());
}

}  // namespace nadir
