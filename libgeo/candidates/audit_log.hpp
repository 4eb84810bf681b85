// Who did what to the service, for whoever looks into it afterwards: one JSON object a line, appended and never
// changed.
//   {"n": 17, "at": "…", "act": "batch.announce", "result": "opened", "token": "ground-1", "client": "…", "key": "…",
//    "subject": "…", "detail": "…"}
// Everything beyond ASCII and every control character is escaped, so that what a caller sends can begin no line of its
// own. n counts without gaps over files and restarts: a line that was taken out leaves a hole. A line is one write, so
// a killed process leaves whole lines and at most one torn one, which the next start closes.
//
// Bounded: a file of this size is set aside as audit.1.jsonl (the older ones move on), and the oldest goes. So that a
// caller cannot drive out what it did before, equal acts of one caller are written so many times a minute; a line then
// says how many more there were.
//
// A disk that is full, or a process that hangs with the file's lock, costs lines, never the service: fault() says so,
// and once there is room an entry "audit.gap" says how many are missing. For any thread, and for several processes:
// each line is written under the file's lock.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "base/time.hpp"

namespace nadir {

class FileLock;

struct AuditEntry {
  std::string act;        // "batch.announce"
  std::string result;     // "opened", "refused"
  std::string token{};    // id of the token, when there was a known one
  std::string client{};   // whose name the uploads bear
  std::string key{};      // id of the key that signed
  std::string subject{};  // upload, airframe, root version
  std::string detail{};
};

struct AuditLimits {
  std::uint64_t file_bytes = std::uint64_t{16} << 20;
  int files = 8;
  std::int64_t equal_per_minute = 60;
};

class AuditLog {
 public:
  // Creates the folder where it is missing. clock: must outlive this.
  AuditLog(std::filesystem::path folder, const Clock& clock, AuditLimits limits = {});
  ~AuditLog();
  AuditLog(const AuditLog&) = delete;
  AuditLog& operator=(const AuditLog&) = delete;

  void record(const AuditEntry& entry);  // never throws
  void flush();                          // writes the counts of the minutes that are over, and what a gap lacks
  std::string fault();                   // why lines cannot be written; empty: they can

 private:
  struct Minute {
    std::int64_t number = 0;  // minutes since 1970
    std::int64_t acts = 0;
    AuditEntry last;
  };
  void open();
  void read_end();
  void rotate();
  void lock_newest(std::optional<FileLock>& lock);
  void write(const AuditEntry& entry, std::int64_t more);
  bool close_gap();
  bool append(const AuditEntry& entry, std::int64_t more);
  void write_suppressed(std::int64_t minute);

  const std::filesystem::path folder_;
  const Clock& clock_;
  const AuditLimits limits_;
  std::mutex mutex_;
  int fd_ = -1;
  std::uint64_t size_ = 0;
  std::int64_t next_ = 1;
  std::int64_t unwritten_ = 0;
  std::string why_unwritten_;
  std::map<std::string, Minute> minutes_;  // by act, result, token
};

}  // namespace nadir
