// The file of a database from outside, as SQLite sees it: one open file to read, working memory up to a limit, and
// nothing else. It is a VFS (www.sqlite.org/vfs.html) of one connection.
//
//   - The database is read through the descriptor that was opened: the file that was hashed, whatever its name means
//   now.
//   - There is no other file: no journal, no write-ahead log, no temporary file. What SQLite would write to a temporary
//     file stays in memory, and beyond the limit the statement fails.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "base/input_file.hpp"

struct sqlite3;

namespace nadir {

class SqliteInput {
 public:
  // working_bytes: how much the connection may put aside while it sorts and groups.
  SqliteInput(InputFile file, std::uint64_t working_bytes);
  ~SqliteInput();
  SqliteInput(const SqliteInput&) = delete;
  SqliteInput& operator=(const SqliteInput&) = delete;

  // As sqlite3_open_v2(). This must outlive the connection and its statements.
  int open(sqlite3** handle) const;

  const InputFile& file() const;
  bool working_memory_spent() const;  // a statement failed because it needed more

  struct Impl;

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
