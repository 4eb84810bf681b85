// The outbox on disk: FOLDER/outbox.sqlite with all that is known of each tile, its bytes included
// (docs/formats/outbox.md). What a transaction has committed survives a kill and a loss of power (synchronous=FULL);
// one program at a time changes it.
//
// The guarantees of an outbox (only allowed transitions, no image deleted before its verdict) are enforced by triggers
// and two tables inside the file, which may come from a damaged disk or an untrusted source: opening it checks that
// they are exactly those of its version.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>

#include "imagery/sqlite_database.hpp"

namespace nadir {

// State of a candidate tile on its way from the outbox to a verdict (docs/sync.md has the diagram).
enum class TileState : std::uint8_t {
  staged,     // in the outbox
  sealed,     // in a signed batch
  announced,  // the service lacks it
  sending,    // its pack is on the wire
  waiting,    // its pack was interrupted, the next attempt will come
  sent,       // the service has its bytes; the verdict is awaited
  parked,     // no further attempt until the operator retries it
  accepted,   // final
  rejected,   // final, with a code
  duplicate,  // final: this very candidate was accepted before
  refused,    // final, with a code: the service declined it when it was announced
  damaged     // final: what the outbox holds of it is not what was staged
};

inline constexpr std::array kTileStates{TileState::staged,    TileState::sealed,   TileState::announced,
                                        TileState::sending,   TileState::waiting,  TileState::sent,
                                        TileState::parked,    TileState::accepted, TileState::rejected,
                                        TileState::duplicate, TileState::refused,  TileState::damaged};

std::string_view name_of(TileState state);  // "STAGED", as the outbox holds it
std::optional<TileState> parse_tile_state(std::string_view name);
constexpr bool is_final(TileState state) { return state >= TileState::accepted; }

// The texts of outbox.sql and, since versions 2, 3 and 4, outbox_strikes.sql, outbox_damaged.sql and
// outbox_installed.sql.
namespace outbox_sql {
extern const std::string_view tables, strikes, damaged, installed;
}

inline constexpr std::int64_t kOutboxVersion = 4;

// The statements that make this version of the tables from the one before it; version 1 from an empty database.
std::string_view outbox_statements(std::int64_t version);

inline constexpr std::string_view kOutboxFile = "outbox.sqlite";

// Called right before and right after the commit of each transition, with its name. For tests that kill.
using TransitionHook = std::function<void(std::string_view transition, bool committed)>;

class OutboxDatabase {
 public:
  enum class Access { make, write, read };

  // make: creates it where there is none yet. Throws UsageError when the folder holds something else, Error when
  // another program writes to it.
  OutboxDatabase(const std::filesystem::path& folder, Access access, TransitionHook hook = {});
  ~OutboxDatabase();
  OutboxDatabase(const OutboxDatabase&) = delete;
  OutboxDatabase& operator=(const OutboxDatabase&) = delete;

  SqliteStatement prepare(std::string_view sql) const { return database_->prepare(sql); }

  // All of `work` or nothing of it.
  void transition(std::string_view name, const std::function<void()>& work);

  // Within a transition: every tile of the batch in the state `before` becomes `after`; how many did.
  std::int64_t move_tiles(std::int64_t batch, TileState before, TileState after, std::int64_t now_ms);
  std::int64_t changes() const;

  // Returns the space of what was deleted to the disk.
  void shrink();

 private:
  void open(const std::filesystem::path& file, Access access);
  void create_tables();
  void migrate(std::int64_t from);
  void add_versions(std::int64_t first);  // within a transaction

  int lock_ = -1;
  TransitionHook hook_;
  std::unique_ptr<SqliteDatabase> database_;
};

}  // namespace nadir
