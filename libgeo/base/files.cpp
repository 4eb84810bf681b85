#include "base/files.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <utility>

#include "base/error.hpp"
#include "base/input_file.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

[[noreturn]] void fail(std::string what, const fs::path& where, int error_number) {
  std::string fix;
  if (error_number == ENOSPC || error_number == EDQUOT) {
    fix = "free space on this disk, or write elsewhere";
    throw OutOfSpace({.what = std::move(what), .where = where, .found = system_error_text(error_number), .fix = fix});
  }
  if (error_number == EACCES || error_number == EPERM) fix = "check the permissions of the file and of its folder";
  if (error_number == EROFS) fix = "this medium is read-only: write elsewhere";
  if (error_number == ENOENT || error_number == ENOTDIR) fix = "create the folder first, or correct the path";
  if (error_number == ENAMETOOLONG) fix = "choose a shorter path: a name may have 255 bytes, a path 4095";
  if (error_number == EIO) fix = "check the storage medium";
  throw Error({.what = std::move(what), .where = where, .found = system_error_text(error_number), .fix = fix});
}

void sync_path(const fs::path& path, int flags) {
  const FileDescriptor fd(::open(path.c_str(), flags | O_CLOEXEC));
  if (fd.get() < 0 || ::fsync(fd.get()) != 0) fail("cannot sync to disk", path, errno);
}

fs::path parent_of(const fs::path& path) { return path.has_parent_path() ? path.parent_path() : fs::path("."); }

void write_all(int fd, ByteView bytes, const fs::path& path) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) fail("cannot write", path, errno);
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
}

int rename_without_replacing(const fs::path& from, const fs::path& to) {
  return ::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE);
}

}  // namespace

Bytes read_file(const fs::path& path, std::uint64_t max_size) { return InputFile(path).read(max_size); }

std::string read_text_file(const fs::path& path, std::uint64_t max_size) {
  return std::string(as_text(read_file(path, max_size)));
}

PendingFile::PendingFile(fs::path path, ByteView bytes, unsigned mode, Until until)
    : path_(std::move(path)), name_(path_.filename()) {
  folder_ = ::open(parent_of(path_).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder_ < 0) fail("cannot create", path_, errno);
  try {
    // An unnamed file gets its name through /proc.
    if (until == Until::unnamed && ::access("/proc/self/fd", X_OK) == 0) {
      file_ = ::openat(folder_, ".", O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    }
    if (file_ < 0) take_hidden_name(true);
    if (::fchmod(file_, mode) != 0) fail("cannot set the mode", path_, errno);
    append(bytes);
    sync();
  } catch (...) {
    discard();
    throw;
  }
}

PendingFile::~PendingFile() { discard(); }

void PendingFile::append(ByteView bytes) {
  write_all(file_, bytes, path_);
  size_ += bytes.size();
}

bool PendingFile::read_at(std::uint64_t at, std::span<std::uint8_t> target) const {
  while (!target.empty()) {
    const ssize_t got = ::pread(file_, target.data(), target.size(), static_cast<off_t>(at));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail("cannot read", path_, errno);
    if (got == 0) return false;
    at += static_cast<std::uint64_t>(got);
    target = target.subspan(static_cast<std::size_t>(got));
  }
  return true;
}

void PendingFile::discard() {
  if (!hidden_.empty()) ::unlinkat(folder_, hidden_.c_str(), 0);
  hidden_.clear();
  for (int* fd : {&file_, &folder_}) {
    if (*fd >= 0) ::close(std::exchange(*fd, -1));
  }
}

// create: makes the file there, else gives the unnamed one this name.
void PendingFile::take_hidden_name(bool create) {
  for (int tries_left = 16;; --tries_left) {
    std::uint64_t random = 0;
    if (::getrandom(&random, sizeof random, 0) != sizeof random) fail("cannot create", path_, errno);
    const std::string name = fmt::format(".{:.200}.{:016x}.tmp", name_, random);
    if (create) {
      file_ = ::openat(folder_, name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
    }
    if (create ? file_ >= 0 : link_to(name)) {
      hidden_ = name;
      return;
    }
    if (errno != EEXIST || tries_left == 0) fail("cannot create", path_, errno);
  }
}

bool PendingFile::link_to(const std::string& name) const {
  const std::string unnamed = fmt::format("/proc/self/fd/{}", file_);
  return ::linkat(AT_FDCWD, unnamed.c_str(), folder_, name.c_str(), AT_SYMLINK_FOLLOW) == 0;
}

bool PendingFile::create() {
  sync();
  if (hidden_.empty()) {
    if (!link_to(name_)) {
      if (errno == EEXIST) return false;
      fail("cannot create", path_, errno);
    }
  } else if (::renameat2(folder_, hidden_.c_str(), folder_, name_.c_str(), RENAME_NOREPLACE) == 0) {
    hidden_.clear();
  } else if (errno == EEXIST) {
    return false;
  } else if (errno != EINVAL ||  // a file system without this flag
             ::linkat(folder_, hidden_.c_str(), folder_, name_.c_str(), 0) != 0) {
    if (errno == EEXIST) return false;
    fail("cannot create", path_, errno);
  }
  sync_folder();
  return true;
}

void PendingFile::replace() {
  sync();
  if (hidden_.empty()) take_hidden_name(false);
  if (::renameat(folder_, hidden_.c_str(), folder_, name_.c_str()) != 0) fail("cannot rename to", path_, errno);
  hidden_.clear();
  sync_folder();
}

void PendingFile::sync() const {
  if (::fsync(file_) != 0) fail("cannot sync to disk", path_, errno);
}

void PendingFile::sync_folder() const {
  if (::fsync(folder_) != 0) fail("cannot sync to disk", path_, errno);
}

void write_file_atomic(const fs::path& path, ByteView bytes, unsigned mode) {
  PendingFile(path, bytes, mode).replace();
}

void write_file_atomic(const fs::path& path, std::string_view text, unsigned mode) {
  write_file_atomic(path, as_bytes(text), mode);
}

void write_new_file(const fs::path& path, std::string_view text, unsigned mode) {
  if (PendingFile(path, as_bytes(text), mode).create()) return;
  throw UsageError({.what = "the output exists already",
                    .where = path,
                    .expected = "a path that does not exist: this file is never overwritten",
                    .fix = "choose another path, or move the existing file away"});
}

void require_private_mode(const fs::path& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) {
    throw Error({.what = "cannot open the key file",
                 .where = path,
                 .found = system_error_text(errno),
                 .fix = "check the path and the permissions of its folders"});
  }
  if ((info.st_mode & 07177) != 0) {
    char mode[8];
    std::snprintf(mode, sizeof mode, "%04o", static_cast<unsigned>(info.st_mode & 07777));
    throw UsageError({.what = "the key file is accessible to other users",
                      .where = path,
                      .expected = "mode 0600 or stricter",
                      .found = std::string("mode ") + mode,
                      .fix = "chmod 600 " + path.string()});
  }
}

void sync_to_disk(const fs::path& path) { sync_path(path, O_RDONLY); }

StagingDirectory::StagingDirectory(fs::path final_path, Leftovers leftovers) : final_path_(std::move(final_path)) {
  if (!final_path_.has_filename()) final_path_ = final_path_.parent_path();  // "out/" means "out"
  const fs::path parent = parent_of(final_path_);
  const std::string name = final_path_.filename();
  staging_path_ = parent / ("." + name + ".staging");
  lock_path_ = parent / ("." + name + ".lock");
  if (fs::exists(fs::symlink_status(final_path_))) {
    throw Error({.what = "the output exists already",
                 .where = final_path_,
                 .expected = "a path that does not exist: existing output is never changed",
                 .fix = "choose another --out, or remove the old one"});
  }
  if (!fs::is_directory(parent)) {
    throw Error({.what = "the parent folder of the output does not exist", .where = parent, .fix = "create it first"});
  }
  lock_ = ::open(lock_path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644);
  if (lock_ < 0) fail("cannot create the output", final_path_, errno);
  if (::flock(lock_, LOCK_EX | LOCK_NB) != 0) {
    ::close(std::exchange(lock_, -1));
    throw Error({.what = "another process is writing this output", .where = final_path_, .fix = "wait for it to end"});
  }
  std::error_code error;
  found_leftovers_ = fs::exists(fs::symlink_status(staging_path_));
  if (leftovers == Leftovers::discard || !fs::is_directory(fs::symlink_status(staging_path_))) {
    fs::remove_all(staging_path_, error);
  }
  if (!error) fs::create_directory(staging_path_, error);
  if (error) {
    ::unlink(lock_path_.c_str());
    ::close(std::exchange(lock_, -1));
    fail("cannot create the output", staging_path_, error.value());
  }
}

StagingDirectory::~StagingDirectory() {
  if (!committed_ && !keep_) {
    std::error_code ignored;
    fs::remove_all(staging_path_, ignored);
  }
  if (lock_ >= 0) {
    ::unlink(lock_path_.c_str());
    ::close(lock_);
  }
}

void StagingDirectory::commit() {
  for (const auto& entry : fs::recursive_directory_iterator(staging_path_)) {
    if (entry.is_symlink()) continue;
    sync_path(entry.path(), entry.is_directory() ? O_RDONLY | O_DIRECTORY : O_RDONLY);
  }
  sync_path(staging_path_, O_RDONLY | O_DIRECTORY);
  if (rename_without_replacing(staging_path_, final_path_) != 0) fail("cannot rename to", final_path_, errno);
  committed_ = true;
  sync_path(parent_of(final_path_), O_RDONLY | O_DIRECTORY);
}

AppendFile::AppendFile(fs::path path) : path_(std::move(path)) {
  fd_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644);
  if (fd_ < 0) fail("cannot open", path_, errno);
}

AppendFile::~AppendFile() { ::close(fd_); }

std::uint64_t AppendFile::size() const {
  struct stat info {};
  if (::fstat(fd_, &info) != 0) fail("cannot read the size", path_, errno);
  return static_cast<std::uint64_t>(info.st_size);
}

bool AppendFile::read(std::span<std::uint8_t> target) {
  std::size_t have = 0;
  while (have < target.size()) {
    const ssize_t got = ::pread(fd_, target.data() + have, target.size() - have, static_cast<off_t>(position_ + have));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail("cannot read", path_, errno);
    if (got == 0) return false;
    have += static_cast<std::size_t>(got);
  }
  position_ += target.size();
  return true;
}

void AppendFile::cut(std::uint64_t position) {
  if (::ftruncate(fd_, static_cast<off_t>(position)) != 0) fail("cannot truncate", path_, errno);
  position_ = position;
}

void AppendFile::append(ByteView bytes) {
  if (::lseek(fd_, static_cast<off_t>(position_), SEEK_SET) < 0) fail("cannot write", path_, errno);
  write_all(fd_, bytes, path_);
  position_ += bytes.size();
}

}  // namespace nadir
