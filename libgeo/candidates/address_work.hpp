// What workers take out of the candidate service's catalogue, address by address, and what they write back: verdicts on
// tiles, votes between flights, promotions.
//
// A worker claims addresses, works on their images for as long as that takes, and writes what it found. Meanwhile no
// other worker gets these addresses: a tile gets one verdict, by all that was decided about its address before it, and
// an address one vote by all of its tiles. So what is decided depends on the tiles, and not on how many workers there
// are or in which order they come.
//
// PostGIS: a claim is an open transaction that holds the addresses' rows, taken by FOR UPDATE SKIP LOCKED; each worker
// has a connection of its own. A claim ends with its connection. A worker that is killed, cut off from the server, or
// silent for CatalogueDatabase::silence() gives its addresses back by that alone, and nothing of its work was ever
// there. So that a slow one is not taken for one that hangs, it writes what it has found within Claim::work_time, and
// the other addresses are free again. SpatiaLite: one process has the file, with one connection, which keeps the claims
// of its workers in memory.
//
// For the thread of its CandidateCatalogue, of which it is a part.
#pragma once

#include <chrono>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "candidates/catalogue_rows.hpp"
#include "catalogue/database.hpp"

namespace nadir {

// An address of a claim, as it was found.
struct AddressTask {
  TileKey key;
  std::vector<TileRow> waiting{};  // for a verdict, with their sidecars, in the order of their announcement
  AddressCandidates standing{};    // what was accepted and voted on before
};

// What a worker found out about it.
struct AddressResult {
  struct Judged {
    TileVerdict verdict;
    std::string keyid;
    Sha256 sha256{};
    // The bytes that are there are not the tile's. Where they lie is forgotten, unless an accepted or a waiting tile
    // has the same digest: announced again, the tile is missing and can be sent.
    bool damaged = false;
  };
  TileKey key;
  std::vector<Judged> judged{};
  std::vector<std::int64_t> standing{};    // tiles that took part in the vote, besides those judged now
  std::optional<std::int64_t> promoted{};  // before
  std::optional<Outcome> outcome{};        // none: the address has to be voted on again
};

class AddressWork {
 public:
  explicit AddressWork(CatalogueDatabase& database) : database_(database) {}

  struct Claim {
    std::uint64_t number = 0;  // 0: of nothing
    std::vector<AddressTask> addresses{};
    bool more = false;                                     // perhaps
    std::optional<std::chrono::milliseconds> work_time{};  // until it writes, of at least one address; nullopt: any
  };
  // The addresses of the first `limit` tiles of a complete upload whose bytes are there and that have no verdict, but
  // for some tiles. Other uploads' tiles at these addresses come with them.
  Claim claim_tiles(std::int64_t upload, std::size_t limit, const std::set<std::int64_t>& but = {});
  // Up to `limit` addresses whose accepted tiles have not been voted on, except those in `but`.
  Claim claim_votes(std::size_t limit, const std::set<TileKey>& but = {});

  // Writes the results, of all addresses or of some, in one transaction and ends the claim. Tiles that `revoked` keys
  // have signed, by now, are rejected, and an address with such a tile, or with one that was withdrawn meanwhile, has
  // to be voted on again. False: the claim was lost meanwhile, and nothing is written.
  [[nodiscard]] bool write(const Claim& claim, std::span<AddressResult> results, std::int64_t now_ms,
                           const std::set<std::string>& revoked);
  void release(const Claim& claim);

  // Accepted tiles that these keys have signed become rejected, and those that a worker is about to accept; what was
  // promoted at their addresses is so no more, and the others are voted on again. Returns how many tiles.
  std::int64_t withdraw(const std::set<std::string>& keys);

 private:
  class Writing;
  std::vector<TileKey> lock_addresses(const std::string& from, const std::string& where, const std::string& order,
                                      std::size_t limit);
  Claim claim(std::vector<TileKey> keys, const std::string& but_tiles);
  std::string but_claimed() const;
  void end_hung_claims();
  void read_waiting(std::vector<AddressTask>& addresses, std::span<const TileKey> keys, const std::string& but_tiles);
  void read_standing(std::vector<AddressTask>& addresses, std::span<const TileKey> keys);
  std::set<std::string> with_noted_keys(std::set<std::string> revoked, std::span<const AddressResult> results);
  std::set<std::int64_t> withdrawn_among(std::span<const AddressResult> results);
  void add_votes(std::span<const Vote> votes);
  void forget_bytes(std::span<const Sha256> tiles);
  void add_promotions(std::span<const Promotion> promotions);

  CatalogueDatabase& database_;
  std::uint64_t locking_ = 0;                                // PostGIS: the claim whose transaction is open
  std::map<std::uint64_t, std::vector<TileKey>> claimed_{};  // SpatiaLite
};

}  // namespace nadir
