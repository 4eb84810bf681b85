// Reading and writing files so that a kill or a full disk never leaves half a result under its final name.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "base/bytes.hpp"

namespace nadir {

// The whole file. Throws Error when it is missing, unreadable, not a regular file, or larger than max_size bytes
// (sizes are checked before anything is read). See input_file.hpp for what somebody may change meanwhile.
Bytes read_file(const std::filesystem::path& path, std::uint64_t max_size = std::uint64_t{1} << 32);
std::string read_text_file(const std::filesystem::path& path, std::uint64_t max_size = std::uint64_t{1} << 26);

// A file that has no name until its bytes are complete and on the disk (O_TMPFILE): nobody can open it early, guess
// what it will be called, or have planted a link there; and a process that dies leaves nothing. Its mode is set before
// the first byte is written. Where the file system has no unnamed files (FAT, some network ones), the file has a random
// hidden name that is created anew (O_EXCL) until then.
//
// What has the final name already is never written to. A symbolic link is replaced itself; its target is not touched.
//
// Without a name at the end it is a spool: bytes that are larger than memory, on the disk beside what they will become.
class PendingFile {
 public:
  enum class Until { unnamed, hidden_name };  // hidden_name: as where unnamed files do not exist

  // mode: permission bits, 0600 for private keys. Throws Error, OutOfSpace.
  PendingFile(std::filesystem::path path, ByteView bytes, unsigned mode = 0644, Until until = Until::unnamed);
  ~PendingFile();
  PendingFile(const PendingFile&) = delete;
  PendingFile& operator=(const PendingFile&) = delete;

  void append(ByteView bytes);
  std::uint64_t size() const { return size_; }
  bool read_at(std::uint64_t at, std::span<std::uint8_t> target) const;  // false when the file ends before

  // Both sync the file and the folder. create(): false when something has the name already, be it a dangling link; of
  // several processes one succeeds.
  bool create();
  void replace();

 private:
  void take_hidden_name(bool create);
  bool link_to(const std::string& name) const;
  void sync() const;
  void sync_folder() const;
  void discard();

  std::filesystem::path path_;
  std::uint64_t size_ = 0;
  std::string name_, hidden_;  // in the folder; the second is empty while the file is unnamed or once it has its name
  int folder_ = -1;
  int file_ = -1;
};

// One PendingFile that replaces what is there.
void write_file_atomic(const std::filesystem::path& path, ByteView bytes, unsigned mode = 0644);
void write_file_atomic(const std::filesystem::path& path, std::string_view text, unsigned mode = 0644);

// One that does not: throws UsageError when the path exists, be it since a moment ago.
void write_new_file(const std::filesystem::path& path, std::string_view text, unsigned mode = 0644);

// Throws UsageError when others than the owner may access the file (mode wider than 0600), Error when it is absent. A
// secret that others can read is an error, not a warning.
void require_private_mode(const std::filesystem::path& path);

// Syncs a file or a folder: its contents survive a power cut once this returns. Throws Error.
void sync_to_disk(const std::filesystem::path& path);

// A folder that is filled under a hidden name beside its final one (".NAME.staging") and appears under the final name
// in one step. A process that dies leaves the staging folder behind and the next one takes it over; a lock keeps two
// processes apart. Without commit() or keep() the destructor removes everything.
class StagingDirectory {
 public:
  enum class Leftovers { discard, keep };  // what a process that died left in the staging folder

  // Throws Error when the final path exists, its parent does not, or another process is building it.
  explicit StagingDirectory(std::filesystem::path final_path, Leftovers leftovers = Leftovers::discard);
  ~StagingDirectory();
  StagingDirectory(const StagingDirectory&) = delete;
  StagingDirectory& operator=(const StagingDirectory&) = delete;

  const std::filesystem::path& path() const { return staging_path_; }
  bool found_leftovers() const { return found_leftovers_; }

  // Whether the folder stays for a later process without a commit.
  void keep(bool stay) { keep_ = stay; }

  // Syncs every file and folder and renames. Never replaces something that appeared in the meantime.
  void commit();

 private:
  std::filesystem::path final_path_;
  std::filesystem::path staging_path_;
  std::filesystem::path lock_path_;
  int lock_ = -1;
  bool found_leftovers_ = false;
  bool keep_ = false;
  bool committed_ = false;
};

// A file that is read from its beginning and continued where reading stopped.
class AppendFile {
 public:
  explicit AppendFile(std::filesystem::path path);  // created when it is missing
  ~AppendFile();
  AppendFile(const AppendFile&) = delete;
  AppendFile& operator=(const AppendFile&) = delete;

  std::uint64_t size() const;
  std::uint64_t position() const { return position_; }
  bool read(std::span<std::uint8_t> target);  // false, and the position stays, when fewer bytes are left
  void cut(std::uint64_t position);           // the file ends there from now on
  void append(ByteView bytes);                // at the position, which is the end

 private:
  std::filesystem::path path_;
  std::uint64_t position_ = 0;
  int fd_ = -1;
};

}  // namespace nadir
