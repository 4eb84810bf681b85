// The database of a stored flight: its tables and their version, and the lock of the one process that has it open.
//
// SQLite in WAL mode. Other tables than these, or a trigger or view beside them, are refused: a flight may come from
// somebody else, and nothing of theirs runs here. A flight of version 3, which has no adjusted poses yet, becomes one
// of this version when it is opened: it gets the tables that it lacks, empty.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string_view>

namespace nadir {

class SqliteDatabase;

inline constexpr std::string_view kFlightFile = "flight.sqlite";
inline constexpr std::int64_t kFlightStoreVersion = 4;

enum class StoreSync {
  every_commit,  // survives a loss of power
  checkpoints    // survives a kill; a loss of power may cost the last frames, which are then processed again
};

// Called in a transaction just before it is committed and just after: where tests kill the process.
using FlightCommitHook = std::function<void(std::string_view transaction, bool committed)>;

class FlightDatabase {
 public:
  enum class Access {
    create,  // in a folder that exists, and has no flight yet; without tables until create_tables()
    open
  };

  // Throws UsageError when another process has the flight, when there is one already or none, and for other versions
  // and other tables. folder: of the flight.
  FlightDatabase(const std::filesystem::path& folder, Access access, StoreSync sync, FlightCommitHook hook);
  FlightDatabase();  // in memory, without tables
  ~FlightDatabase();
  FlightDatabase(const FlightDatabase&) = delete;
  FlightDatabase& operator=(const FlightDatabase&) = delete;

  // Whether there is a database with tables, whatever they are.
  static bool exists(const std::filesystem::path& folder);

  const SqliteDatabase& sql() const { return *database_; }
  void create_tables() const;
  // All of the work, or none of it.
  void transaction(std::string_view name, const std::function<void()>& work) const;

 private:
  void add_new_tables() const;  // to a flight of the version before

  FlightCommitHook hook_;
  int lock_ = -1;
  std::unique_ptr<SqliteDatabase> database_;
};

}  // namespace nadir
