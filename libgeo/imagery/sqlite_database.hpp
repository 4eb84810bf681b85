// SQLite with values and exceptions. Files from outside are opened so that they can neither be changed nor change
// anything (read-only, immutable, defensive, no functions from their schema), and so that no view in them can run
// forever: the work of a statement is limited by the size of the file; beyond that it is an Error.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "base/bytes.hpp"

struct sqlite3;
struct sqlite3_stmt;

namespace nadir {

class SqliteDatabase;

// A prepared statement. Parameters count from 1, columns from 0. Texts and blobs handed out live until the next step.
class SqliteStatement {
 public:
  SqliteStatement& bind(int parameter, std::int64_t value);
  SqliteStatement& bind(int parameter, std::string_view text);
  SqliteStatement& bind(int parameter, ByteView blob);  // must outlive the step
  SqliteStatement& bind_null(int parameter);

  bool step();  // true: a row is there. Throws Error when the file is damaged.
  void reset();
  void run() {  // for statements without rows; ready to be bound again
    step();
    reset();
  }

  bool is_null(int column) const;
  std::int64_t integer(int column) const;
  std::string_view text(int column) const;
  ByteView blob(int column) const;

 private:
  friend class SqliteDatabase;
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const;
  };
  SqliteStatement(sqlite3_stmt* statement, const SqliteDatabase& database)
      : statement_(statement), database_(&database) {}

  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  const SqliteDatabase* database_;
};

class SqliteDatabase {
 public:
  // Throws Error when the file is missing, or is no SQLite database.
  static SqliteDatabase open_immutable(const std::filesystem::path& path);
  static SqliteDatabase create(const std::filesystem::path& path);  // Throws Error when the file exists.
  // A database that this program continues: created when it is missing; what a killed writer left unfinished is rolled
  // back. Throws Error when it is not an SQLite database, or its journal would do more than that.
  static SqliteDatabase open_writable(const std::filesystem::path& path);
  static SqliteDatabase in_memory();  // empty, without a file

  // Limits the work of each statement to what rows of this many bytes can need; beyond that it is an Error.
  void limit_work(std::uint64_t bytes);

  SqliteStatement prepare(std::string_view sql) const;
  void execute(const std::string& sql) const;
  bool has_table(std::string_view name) const;  // or a view
  void close();                                 // throws where the destructor would swallow the error

  const std::filesystem::path& path() const { return path_; }
  [[noreturn]] void fail(const char* doing) const;  // throws Error with SQLite's message

 private:
  friend class SqliteStatement;
  struct Close {
    void operator()(sqlite3* handle) const;
  };
  // In thousands of SQLite's virtual machine instructions, for one run of a statement.
  struct Work {
    std::int64_t limit = 0;
    std::atomic<std::int64_t> left = 0;
  };
  static int spend(void* work);
  void begin_statement() const;
  SqliteDatabase(std::filesystem::path path, int flags, const std::string& uri);

  std::filesystem::path path_;
  std::unique_ptr<Work> work_;  // outlives the handle, null: without limit
  std::unique_ptr<sqlite3, Close> handle_;
};

}  // namespace nadir
