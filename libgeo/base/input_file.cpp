#include "base/input_file.hpp"

#include <dirent.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/openat2.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <memory>
#include <utility>
#include <vector>

#include "base/error.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kHashedBlock_bytes = 1 << 20;
constexpr std::size_t kMaxFolderDepth = 8;
// Without waiting: opening a pipe must not wait for its writer, nor a terminal become ours.
constexpr int kOpenInput = O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY;

std::string advice_for(int error_number) {
  switch (error_number) {
    case ENOENT:
    case ENOTDIR: return "check the path";
    case EACCES:
    case EPERM: return "check the permissions of the file and of its folders";
    case ENAMETOOLONG: return "move it to a shorter path: a name may have 255 bytes, a path 4095";
    case ELOOP: return "symbolic links are not followed here: put the file itself in its place";
    case EIO: return "check the storage medium";
    case EMFILE:
    case ENFILE: return "raise the limit of open files";
    default: return {};
  }
}

[[noreturn]] void fail_to(const char* what, const fs::path& where, int error_number) {
  throw Error(
      {.what = what, .where = where, .found = system_error_text(error_number), .fix = advice_for(error_number)});
}

const char* kind_of(mode_t mode) {
  if (S_ISDIR(mode)) return "a folder";
  if (S_ISFIFO(mode)) return "a pipe";
  if (S_ISSOCK(mode)) return "a socket";
  return "a device";
}

// One part of a name after the other, none of them a link. For kernels and sandboxes without openat2.
int open_part_by_part(int folder, std::string_view name, int flags) {
  FileDescriptor held;
  int at = folder;
  for (;;) {
    const std::size_t slash = name.find('/');
    const std::string part(name.substr(0, slash));
    if (slash == std::string_view::npos) return ::openat(at, part.c_str(), flags | O_NOFOLLOW);
    FileDescriptor next(::openat(at, part.c_str(), O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
    if (!next) return -1;
    held = std::move(next);
    at = held.get();
    name.remove_prefix(slash + 1);
  }
}

bool leads_astray(std::string_view name) {
  for (std::size_t begin = 0; begin <= name.size();) {
    const std::size_t end = std::min(name.find('/', begin), name.size());
    const std::string_view part = name.substr(begin, end - begin);
    if (part.empty() || part == "." || part == ".." || part.find('\0') != std::string_view::npos) return true;
    begin = end + 1;
  }
  return false;
}

using DirectoryStream = std::unique_ptr<DIR, int (*)(DIR*)>;

DirectoryStream stream_of(FileDescriptor folder, const fs::path& where) {
  const int fd = ::fcntl(folder.get(), F_DUPFD_CLOEXEC, 0);
  DirectoryStream stream(fd < 0 ? nullptr : ::fdopendir(fd), &::closedir);
  if (stream) return stream;
  const int error_number = errno;
  if (fd >= 0) ::close(fd);
  fail_to("cannot read the folder", where, error_number);
}

}  // namespace

FileDescriptor::~FileDescriptor() {
  if (fd_ >= 0) ::close(fd_);
}

FileDescriptor::FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

FileDescriptor& FileDescriptor::operator=(FileDescriptor&& other) noexcept {
  std::swap(fd_, other.fd_);
  return *this;
}

InputFile::InputFile(const fs::path& path) : InputFile(FileDescriptor(::open(path.c_str(), kOpenInput)), path) {}

InputFile::InputFile(FileDescriptor descriptor, fs::path path)
    : descriptor_(std::move(descriptor)), path_(std::move(path)) {
  if (!descriptor_) fail_to("cannot open", path_, errno);
  struct stat info {};
  if (::fstat(descriptor_.get(), &info) != 0) fail_to("cannot read the size", path_, errno);
  if (!S_ISREG(info.st_mode)) {
    throw Error({.what = "not a file", .where = path_, .expected = "a regular file", .found = kind_of(info.st_mode)});
  }
  size_ = static_cast<std::uint64_t>(info.st_size);
}

bool InputFile::read_at(std::uint64_t at, std::span<std::uint8_t> target) const {
  for (std::size_t have = 0; have < target.size();) {
    const ssize_t got =
        ::pread(descriptor_.get(), target.data() + have, target.size() - have, static_cast<off_t>(at + have));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail_to("cannot read", path_, errno);
    if (got == 0) return false;
    have += static_cast<std::size_t>(got);
  }
  return true;
}

Bytes InputFile::read(std::uint64_t max_size) const {
  if (size_ > max_size) {
    throw Error({.what = "the file is too large",
                 .where = path_,
                 .expected = fmt::format("at most {} bytes", max_size),
                 .found = fmt::format("{} bytes", size_),
                 .fix = "check that this is the right file"});
  }
  Bytes bytes(size_);
  std::size_t have = 0;
  while (have < bytes.size()) {
    const ssize_t got = ::pread(descriptor_.get(), bytes.data() + have, bytes.size() - have, static_cast<off_t>(have));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail_to("cannot read", path_, errno);
    if (got == 0) break;  // the file shrank meanwhile
    have += static_cast<std::size_t>(got);
  }
  bytes.resize(have);
  return bytes;
}

InputFile InputFile::duplicate() const {
  return InputFile(FileDescriptor(::fcntl(descriptor_.get(), F_DUPFD_CLOEXEC, 0)), path_);
}

Sha256 InputFile::sha256(const std::function<void()>& after_block) const {
  Sha256Stream stream;
  Bytes block(std::min<std::uint64_t>(kHashedBlock_bytes, std::max<std::uint64_t>(size_, 1)));
  for (std::uint64_t at = 0; at < size_; at += block.size()) {
    const auto size = static_cast<std::size_t>(std::min<std::uint64_t>(block.size(), size_ - at));
    const std::span target = std::span(block).first(size);
    if (!read_at(at, target)) break;  // the file shrank meanwhile: another digest
    stream.update(target);
    if (after_block) after_block();
  }
  return stream.finish();
}

Directory::Directory(const fs::path& path)
    : descriptor_(::open(path.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC)), path_(path) {
  if (!descriptor_) fail_to("cannot open the folder", path_, errno);
}

FileDescriptor Directory::open_beneath(std::string_view name, int flags, int& error_number) const {
  if (leads_astray(name)) {
    error_number = EINVAL;
    return FileDescriptor();
  }
  open_how how{};
  how.flags = static_cast<decltype(how.flags)>(flags);
  how.resolve = RESOLVE_BENEATH | RESOLVE_NO_SYMLINKS | RESOLVE_NO_MAGICLINKS;
  const std::string text(name);
  long fd = ::syscall(SYS_openat2, descriptor_.get(), text.c_str(), &how, sizeof how);
  if (fd < 0 && (errno == ENOSYS || errno == EPERM)) fd = open_part_by_part(descriptor_.get(), name, flags);
  error_number = fd < 0 ? errno : 0;
  return FileDescriptor(static_cast<int>(fd));
}

std::optional<InputFile> Directory::find(std::string_view name) const {
  int error_number = 0;
  FileDescriptor file = open_beneath(name, kOpenInput, error_number);
  if (file) return InputFile(std::move(file), path_ / name);
  if (error_number == ENOENT) return std::nullopt;
  if (error_number == ENXIO) {  // a socket, or a pipe that nobody reads
    throw Error({.what = "not a file", .where = path_ / name, .expected = "a regular file", .found = "a socket"});
  }
  fail_to("cannot open", path_ / name, error_number);
}

InputFile Directory::open(std::string_view name) const {
  if (auto file = find(name)) return std::move(*file);
  fail_to("cannot open", path_ / name, ENOENT);
}

void Directory::walk(const std::function<bool(const Entry&)>& visit) const {
  std::vector<std::string> folders{""};
  while (!folders.empty()) {
    const std::string folder = std::move(folders.back());
    folders.pop_back();
    constexpr int kOpenFolder = O_RDONLY | O_DIRECTORY | O_CLOEXEC;
    int error_number = 0;
    FileDescriptor opened = folder.empty() ? FileDescriptor(::openat(descriptor_.get(), ".", kOpenFolder))
                                           : open_beneath(folder, kOpenFolder, error_number);
    if (!opened) fail_to("cannot read the folder", path_ / folder, folder.empty() ? errno : error_number);
    const DirectoryStream stream = stream_of(std::move(opened), path_ / folder);
    errno = 0;
    while (const dirent* at = ::readdir(stream.get())) {  // NOLINT(concurrency-mt-unsafe): a stream of our own
      const std::string_view name = at->d_name;
      if (name == "." || name == "..") continue;
      const std::string path = folder.empty() ? std::string(name) : fmt::format("{}/{}", folder, name);
      struct stat info {};
      if (::fstatat(::dirfd(stream.get()), at->d_name, &info, AT_SYMLINK_NOFOLLOW) != 0) {
        fail_to("cannot stat", path_ / path, errno);
      }
      if (S_ISDIR(info.st_mode)) {
        if (std::count(path.begin(), path.end(), '/') < static_cast<std::ptrdiff_t>(kMaxFolderDepth)) {
          folders.push_back(path);
          continue;
        }
        if (!visit({path, Kind::other})) return;
      } else if (!visit({path, S_ISREG(info.st_mode)   ? Kind::file
                               : S_ISLNK(info.st_mode) ? Kind::link
                                                       : Kind::other})) {
        return;
      }
      errno = 0;
    }
    if (errno != 0) fail_to("cannot read the folder", path_ / folder, errno);
  }
}

}  // namespace nadir
