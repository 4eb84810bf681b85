// SQLite with values and exceptions.
//
// A file from outside can neither be changed nor change anything: it is read through one descriptor, immutable and
// defensive, without functions from its schema and without any other file (sqlite_input.hpp). What a statement may cost
// is bounded by the size of the file: work (virtual machine instructions), milliseconds, bytes put aside for sorting,
// and, where the schema is plain, bytes of results, which then cannot be more than the file holds. Beyond any of these
// it is an Error.
//
// SqliteSchema::plain is for files whose integrity is not known yet (packages before and while they are verified): a
// view, a trigger, a virtual table or a generated column is code that runs when a table is read, and such a file is
// refused before anything of it runs. Other programs' MBTiles may keep their tiles in a view.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "base/bytes.hpp"
#include "base/input_file.hpp"
#include "base/monotonic.hpp"

struct sqlite3;
struct sqlite3_stmt;

namespace nadir {

class SqliteDatabase;
class SqliteInput;

enum class SqliteSchema {
  plain,  // tables with stored columns, and indexes on them
  any,
};

// A prepared statement. Parameters count from 1, columns from 0. Texts and blobs handed out live until the next step.
class SqliteStatement {
 public:
  SqliteStatement& bind(int parameter, std::int64_t value);
  SqliteStatement& bind(int parameter, std::string_view text);
  SqliteStatement& bind(int parameter, ByteView blob);  // must outlive the step
  SqliteStatement& bind_null(int parameter);
  SqliteStatement& bind_real(int parameter, double value);  // NaN is stored as NULL
  SqliteStatement& bind_real(int parameter, const std::optional<double>& value);

  bool step();  // true: a row is there. Throws Error when the file is damaged.
  void reset();
  void run() {  // for statements without rows; ready to be bound again
    step();
    reset();
  }

  bool is_null(int column) const;
  std::int64_t integer(int column) const;
  double real(int column) const;
  std::string_view text(int column) const;
  ByteView blob(int column) const;

 private:
  friend class SqliteDatabase;
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const;
  };
  SqliteStatement(sqlite3_stmt* statement, const SqliteDatabase& database);

  std::shared_ptr<const SqliteInput> input_;  // outlives the statement; null: not from outside
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  const SqliteDatabase* database_;
};

class SqliteDatabase {
 public:
  // Throws Error when the file is missing, is no SQLite database, or its schema is not plain where it must be.
  static SqliteDatabase open_immutable(const std::filesystem::path& path, SqliteSchema schema = SqliteSchema::any);
  static SqliteDatabase open_immutable(InputFile file, SqliteSchema schema, MonotonicMs clock = steady_clock_ms);
  static SqliteDatabase create(const std::filesystem::path& path);  // Throws Error when the file exists.
  // A database that this program continues: created when it is missing; what a killed writer left unfinished is rolled
  // back. Throws Error when it is not an SQLite database, or its journal would do more than that.
  static SqliteDatabase open_writable(const std::filesystem::path& path);
  static SqliteDatabase in_memory();  // empty, without a file

  // Limits the work of each statement to what rows of this many bytes can need; beyond that it is an Error.
  void limit_work(std::uint64_t bytes);

  SqliteStatement prepare(std::string_view sql) const&;
  SqliteStatement prepare(std::string_view sql) const&& = delete;  // a statement uses its database
  void execute(const std::string& sql) const;
  // All that `work` changes, or nothing of it when it throws or cannot be committed.
  void transaction(const std::function<void()>& work) const;
  bool has_table(std::string_view name) const;  // or a view
  void close();                                 // throws where the destructor would swallow the error

  const std::filesystem::path& path() const { return path_; }
  [[noreturn]] void fail(const char* doing) const;  // throws Error with SQLite's message

 private:
  friend class SqliteStatement;
  struct Close {
    void operator()(sqlite3* handle) const;
  };
  // What one run of a statement may cost.
  struct Work {
    std::int64_t limit = 0;  // thousands of SQLite's virtual machine instructions
    std::atomic<std::int64_t> left = 0;
    std::int64_t limit_ms = 0;  // of one step; 0: without limit
    std::atomic<std::int64_t> deadline_ms = 0;
    MonotonicMs clock;
    std::uint64_t limit_bytes = 0;  // of results; 0: without limit
    std::atomic<std::uint64_t> bytes = 0;
    std::atomic<bool> late = false;
  };
  static int spend(void* work);
  void begin_statement() const;
  void begin_step() const;
  void count_row(sqlite3_stmt* row) const;
  void require_plain_schema() const;
  SqliteDatabase(std::filesystem::path path, int flags, const std::string& uri);

  SqliteDatabase(InputFile file, std::uint64_t working_bytes);

  std::filesystem::path path_;
  std::shared_ptr<const SqliteInput> input_;  // outlives the handle; null: not from outside
  std::unique_ptr<Work> work_;                // outlives the handle, null: without limit
  std::unique_ptr<sqlite3, Close> handle_;
};

}  // namespace nadir
