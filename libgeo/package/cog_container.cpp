#include "package/cog_container.hpp"

#include <algorithm>
#include <exception>

#include "package/manifest.hpp"
#include "package/mbtiles_container.hpp"
#include "package/sidecar_table.hpp"

namespace nadir {
namespace {

// Tiles that are cut out of decoded blocks are absent when nothing of them is shown: that needs their pixels.
class Blocks final : public TileCursor {
 public:
  Blocks(const CogReader& reader, bool with_bytes) : reader_(reader), keys_(reader.keys()), with_bytes_(with_bytes) {}

  bool next() override {
    bytes_.reset();
    failure_ = nullptr;
    while (next_ < keys_.size()) {
      key_ = keys_[next_++];
      if (!with_bytes_) return true;
      try {
        bytes_ = reader_.read(key_);
        if (bytes_) return true;
      } catch (const Error&) {
        failure_ = std::current_exception();
        return true;
      }
    }
    return false;
  }

  std::optional<TileKey> key() const override { return key_; }
  std::string address() const override { return "tile " + to_text(key_); }
  ByteView bytes() override {
    if (failure_) std::rethrow_exception(failure_);
    return bytes_ ? ByteView(*bytes_) : ByteView();
  }
  std::optional<Bytes> mask() override { return reader_.read_mask(key_); }

 private:
  const CogReader& reader_;
  std::vector<TileKey> keys_;
  bool with_bytes_;
  std::size_t next_ = 0;
  TileKey key_;
  std::optional<Bytes> bytes_;
  std::exception_ptr failure_;
};

class CogContainer final : public TileContainer {
 public:
  explicit CogContainer(const std::filesystem::path& path) : reader_(path), path_(path) {
    const std::filesystem::path beside = path.parent_path() / std::filesystem::path(kSidecarFile).filename();
    if (std::filesystem::exists(beside)) sidecars_.emplace(SqliteDatabase::open_immutable(beside));
  }

  std::string_view kind() const override { return "cog"; }
  std::unique_ptr<TileCursor> tiles(bool with_bytes) const override {
    return std::make_unique<Blocks>(reader_, with_bytes);
  }
  std::uint64_t count() const override { return reader_.keys().size(); }

  std::vector<ZoomSummary> summary() const override {
    std::vector<ZoomSummary> zooms;
    for (const TileKey& key : reader_.keys()) {
      const std::int64_t x = key.x, y = key.tms_row();
      if (zooms.empty() || zooms.back().zoom != key.z) zooms.push_back({key.z, 0, 0, x, x, y, y});
      ZoomSummary& zoom = zooms.back();
      ++zoom.tiles;
      zoom.bytes += static_cast<std::int64_t>(reader_.stored_size(key));
      zoom.first_column = std::min(zoom.first_column, x), zoom.last_column = std::max(zoom.last_column, x);
      zoom.first_tms_row = std::min(zoom.first_tms_row, y), zoom.last_tms_row = std::max(zoom.last_tms_row, y);
    }
    return zooms;
  }

  std::map<std::string, std::string> metadata() const override {
    return sidecars_ ? metadata_in(*sidecars_) : std::map<std::string, std::string>();
  }
  const SqliteDatabase* sidecars() const override {
    return sidecars_ && has_sidecars(*sidecars_) ? &*sidecars_ : nullptr;
  }

  Findings remarks() const override {
    Findings findings;
    for (const std::string& overview : reader_.left_out()) {
      findings.add({.code = "tiff.grid",
                    .severity = Severity::warning,
                    .where = path_.filename().string() + ", overview of " + overview,
                    .expected = "pixels that lie on those of a zoom of the web map",
                    .found = "pixels between them: the overview is not used",
                    .fix = "gdal_translate -of COG -co TILING_SCHEME=GoogleMapsCompatible -co ALIGNED_LEVELS=N, N the "
                           "number of zooms"});
    }
    return findings;
  }

 private:
  CogReader reader_;
  std::filesystem::path path_;
  std::optional<SqliteDatabase> sidecars_;
};

}  // namespace

std::unique_ptr<TileContainer> open_cog_container(const std::filesystem::path& path) {
  return std::make_unique<CogContainer>(path);
}

}  // namespace nadir
