// The outbox on disk: FOLDER/outbox.sqlite with all that is known of each tile, its bytes included
// (docs/formats/outbox.md). What a transaction has committed survives a kill and a loss of power (synchronous=FULL);
// one program at a time changes it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string_view>

#include "imagery/sqlite_database.hpp"
#include "upload/tile_state.hpp"

namespace nadir {

inline constexpr std::string_view kOutboxFile = "outbox.sqlite";

// Called right before and right after the commit of each transition, with its name. For tests that kill.
using TransitionHook = std::function<void(std::string_view transition, bool committed)>;

class OutboxDatabase {
 public:
  enum class Access { make, write, read };

  // make: also where there is none yet. Throws UsageError when the folder holds something else, Error when another
  // program writes to it.
  OutboxDatabase(const std::filesystem::path& folder, Access access, TransitionHook hook = {});
  ~OutboxDatabase();
  OutboxDatabase(const OutboxDatabase&) = delete;
  OutboxDatabase& operator=(const OutboxDatabase&) = delete;

  SqliteStatement prepare(std::string_view sql) const { return database_->prepare(sql); }

  // All of `work` or nothing of it.
  void transition(std::string_view name, const std::function<void()>& work);

  // Within a transition: every tile of the batch in the state `before` goes on; how many did.
  std::int64_t move_tiles(std::int64_t batch, TileState before, TileState after, std::int64_t now_ms);
  std::int64_t changes() const;

  // Gives the room of what was deleted back to the disk.
  void shrink();

 private:
  void open(const std::filesystem::path& file, Access access);
  void lay_out();
  void bring_up_to_date(std::int64_t from);
  void add_versions(std::int64_t first);  // within a transaction

  int lock_ = -1;
  TransitionHook hook_;
  std::unique_ptr<SqliteDatabase> database_;
};

}  // namespace nadir
