// What the candidate service keeps: uploads, tiles, verdicts, votes and promotions, in a SpatiaLite file or in PostGIS
// (CatalogueDatabase). Every change is one transaction and on the disk when the call returns.
//
// For one thread: the one that opened it (catalogue_thread.hpp).
#pragma once

#include <functional>
#include <set>
#include <span>
#include <string_view>

#include "candidates/address_work.hpp"
#include "candidates/catalogue_rows.hpp"
#include "catalogue/database.hpp"

namespace nadir {

// The texts of catalogue_spatialite.sql and catalogue_postgis.sql.
namespace candidate_sql {
extern const std::string_view spatialite, postgis, spatialite_views, postgis_views, postgis_shared;
}

CatalogueLayout candidate_catalogue_layout();

class CandidateCatalogue {
 public:
  using Access = CatalogueDatabase::Access;

  // write: makes an empty one where there is none. Throws Error.
  CandidateCatalogue(const CatalogueLocation& location, Access access);

  std::optional<UploadRow> upload_of_batch(const Sha256& batch_key);
  std::optional<UploadRow> upload(std::int64_t id);
  std::optional<UploadRow> upload_named(const std::string& name);  // name: hexadecimal digits, nothing else
  std::vector<UploadRow> uploads_in(UploadState state);

  // Opens an upload; refusals has one entry for each of the batch's tiles. Returns its id. Where the same batch was
  // announced a moment ago by another call, that one's.
  std::int64_t open_upload(const UploadRow& upload, const Batch& batch,
                           std::span<const std::optional<Refusal>> refusals, std::int64_t now_ms);
  // All its tiles are there. From now on workers find them.
  void start_judging(std::int64_t upload);
  // Once all its tiles have verdicts: judged. Returns those of its packs, and of those in which tiles of it lie, of
  // which no tile is accepted or waits: their tiles are forgotten, and the files are for remove_unused(). nullopt: some
  // tiles of the upload wait, or it was judged before.
  std::optional<std::vector<Sha256>> finish_judging(std::int64_t upload);
  // With its tiles and their verdicts. Returns the packs that are no longer needed, for remove_unused().
  std::vector<Sha256> forget_upload(std::int64_t upload);

  // In the batch's order.
  enum class Detail { verdicts, sidecars };
  std::vector<TileRow> tiles_of(std::int64_t upload, Detail detail);
  // From now on the pack's tiles are there. keep() puts its file into place within the transaction: whoever would
  // remove it (remove_unused()) comes before or after. It is not called for a pack all of whose tiles lie in other
  // packs: that file would never be read. Throws Error when the upload was forgotten meanwhile.
  struct PackedTile {
    Sha256 sha256;
    std::uint64_t start = 0, bytes = 0;
  };
  void add_pack(std::int64_t upload, const Sha256& pack, std::uint64_t bytes, std::span<const PackedTile> tiles,
                const std::function<void()>& keep);
  std::optional<std::uint64_t> pack_size(std::int64_t upload, const Sha256& pack);
  // Those of the packs in which no tile lies, and none comes to lie before remove() returns: since it was forgotten,
  // another upload may have brought the very same pack.
  void remove_unused(std::span<const Sha256> packs, const std::function<void(const Sha256&)>& remove);
  std::set<Sha256> packs();

  Usage usage_of(const std::string& airframe, std::int64_t since_ms);
  std::int64_t refused_batches_of(const std::string& client, std::int64_t since_ms);  // every tile of them

  AddressWork& work() { return work_; }

  void each_promoted(const std::function<void(const PromotedTile&)>& visit);  // in the order of TileKey
  CatalogueCounts counts();
  void probe();  // throws Error when the database does not answer

 private:
  std::optional<UploadRow> find_upload(const std::string& where);
  void set_state(std::int64_t upload, UploadState state);
  std::set<Sha256> packs_about(std::int64_t upload);
  std::vector<Sha256> drop_dead(std::set<Sha256> packs);
  std::int64_t number(const std::string& sql);

  CatalogueDatabase database_;
  AddressWork work_{database_};
};

}  // namespace nadir
