// Opening files that somebody else may have written, and somebody may be changing.
//
// Everything from a package, a camera's folder, an SD card or a download is opened here, by three rules:
//
//   1. Only regular files. They are opened without waiting and examined before a byte is read: a pipe or a device in
//      place of a file is an Error, not a program that hangs.
//   2. A name is resolved once. An InputFile is what was opened; what is hashed and what is parsed are read from the
//      same descriptor, whatever the name means by then.
//   3. What belongs to a folder lies beneath it. A Directory is the folder that its path named at one moment; names
//      below it neither lead out of it nor pass a symbolic link (openat2(2) with RESOLVE_BENEATH and
//      RESOLVE_NO_SYMLINKS, and where the kernel or a sandbox lacks it, one openat(O_NOFOLLOW) for each part of the
//      name).
//
// Bytes of an open file can still be overwritten in place by whoever may write to it. So what is verified stays in
// memory (missions, terrain, the place index) or is hashed again whenever it is read (tiles).
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "base/bytes.hpp"
#include "base/digest.hpp"

namespace nadir {

// A file descriptor that closes itself.
class FileDescriptor {
 public:
  FileDescriptor() = default;
  explicit FileDescriptor(int fd) : fd_(fd) {}
  ~FileDescriptor();
  FileDescriptor(FileDescriptor&& other) noexcept;
  FileDescriptor& operator=(FileDescriptor&& other) noexcept;

  int get() const { return fd_; }
  explicit operator bool() const { return fd_ >= 0; }

 private:
  int fd_ = -1;
};

// An open regular file. Reading is positional and safe from several threads.
class InputFile {
 public:
  // Symbolic links are followed: this is for paths that the user gives. Throws Error when the file is missing, cannot
  // be read or is no regular file.
  explicit InputFile(const std::filesystem::path& path);

  const std::filesystem::path& path() const { return path_; }  // for messages
  std::uint64_t size() const { return size_; }                 // in bytes, when it was opened

  // Fills the target. False when the file ends before. Throws Error when the medium fails.
  bool read_at(std::uint64_t at, std::span<std::uint8_t> target) const;
  // All of it. Throws Error when it is larger than max_size bytes; the size is checked before anything is allocated.
  Bytes read(std::uint64_t max_size) const;
  // The same open file once more.
  InputFile duplicate() const;
  // SHA-256 of its first size() bytes, never more. after_block is called for every started MiB.
  Sha256 sha256(const std::function<void()>& after_block = {}) const;

 private:
  friend class Directory;
  InputFile(FileDescriptor descriptor, std::filesystem::path path);

  FileDescriptor descriptor_;
  std::filesystem::path path_;
  std::uint64_t size_ = 0;
};

class Directory {
 public:
  // Symbolic links on the way to the folder are followed, now and not again. Throws Error when it is missing or no
  // folder.
  explicit Directory(const std::filesystem::path& path);

  const std::filesystem::path& path() const { return path_; }  // for messages: by now it may name another folder

  // A file beneath the folder: parts joined by '/', none of them "." or "..", none of them a symbolic link. find():
  // nothing when there is no such name. Throws Error for everything else that is not a readable regular file.
  InputFile open(std::string_view name) const;
  std::optional<InputFile> find(std::string_view name) const;

  // What lies beneath, in no order.
  enum class Kind { file, link, other };
  struct Entry {
    std::string name;  // relative to the folder, with '/'
    Kind kind = Kind::file;
  };
  // Visits everything but folders, those in folders too, but no deeper than eight of them; returns early when visit()
  // returns false. Throws Error when a folder cannot be read.
  void walk(const std::function<bool(const Entry&)>& visit) const;

 private:
  FileDescriptor open_beneath(std::string_view name, int flags, int& error_number) const;

  FileDescriptor descriptor_;
  std::filesystem::path path_;
};

}  // namespace nadir
