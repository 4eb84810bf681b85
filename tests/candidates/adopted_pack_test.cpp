// A pack is forgotten, and before its file goes, another upload brings the very same pack. In a SpatiaLite file, or in
// the catalogue that NADIR_TEST_CATALOGUE names (postgis_test.py).
#include <gtest/gtest.h>

#include <cstdlib>

#include "base/error.hpp"
#include "base/files.hpp"
#include "candidates/candidate_catalogue.hpp"
#include "candidates/flight_maker.hpp"
#include "candidates/pack_store.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

class AdoptedPack : public ::testing::Test {
 protected:
  CatalogueLocation location() const {
    const char* given = std::getenv("NADIR_TEST_CATALOGUE");
    return parse_catalogue_location(given != nullptr ? given : (folder_ / "catalogue.sqlite").string());
  }
  // Another one of the same tile each time.
  std::int64_t open_upload(CandidateCatalogue& catalogue) {
    const std::string name = sha256(as_bytes(this_test() + std::to_string(++uploads_))).hex();
    const std::vector<std::optional<Refusal>> refusals(1);
    UploadRow upload;
    upload.name = name;
    upload.batch_key = sha256(as_bytes(name));
    return catalogue.open_upload(upload, flight_.batch({tile_}, uploads_).batch, refusals, 1);
  }
  static std::string this_test() { return ::testing::UnitTest::GetInstance()->current_test_info()->name(); }
  void bring(CandidateCatalogue& catalogue, std::int64_t upload) {
    const CandidateCatalogue::PackedTile packed{tile_.sidecar.sha256, start_, tile_.tile.size()};
    catalogue.add_pack(upload, pack_, bytes_.size(), {&packed, 1}, [this] {
      write_file_atomic(folder_ / "come", ByteView(bytes_));
      store_.adopt(folder_ / "come", pack_);
    });
  }
  void reject(CandidateCatalogue& catalogue, std::int64_t upload) {
    TileVerdict verdict{.tile = catalogue.tiles_of(upload, CandidateCatalogue::Detail::verdicts).at(0).id,
                        .verdict = Verdict::rejected,
                        .refusal = Refusal{.code = ReasonCode::blurred, .detail = "test"}};
    catalogue.judge({{.verdict = verdict, .sidecar = tile_.sidecar, .keyid = tile_.signature.keyid}}, 1,
                    [](TileVerdict&, const CandidateSidecar&, const CandidateCatalogue::Rivals&) {});
  }
  Bytes read(CandidateCatalogue& catalogue, std::int64_t upload) {
    const auto tiles = catalogue.tiles_of(upload, CandidateCatalogue::Detail::verdicts);
    return store_.read(tiles.at(0).blob.value(), tile_.sidecar.sha256);
  }

  test::TemporaryFolder folder_;
  PackStore store_{folder_ / "packs"};
  // Ground of each test's own: the catalogue may be the same one.
  test::FlightMaker flight_{{.ground = std::hash<std::string>()(this_test())}};
  Candidate tile_ = flight_.candidate(test::keys_in_a_row(1).at(0));
  Bytes bytes_ = test::pack_of({tile_});
  Sha256 pack_ = sha256(bytes_);
  std::uint64_t start_ = kPackHeadSize + kPackEntrySize;
  int uploads_ = 0;
  std::function<void(const Sha256&)> remove_ = [this](const Sha256& pack) { store_.remove(pack); };
};

TEST_F(AdoptedPack, StaysWhenItCameBetweenForgettingAndRemoving) {
  CandidateCatalogue judging(location(), CandidateCatalogue::Access::write);
  CandidateCatalogue taking_in(location(), CandidateCatalogue::Access::write);
  const std::int64_t first = open_upload(judging);
  bring(judging, first);
  reject(judging, first);
  const std::vector<Sha256> dead = judging.forget_dead_packs(first);
  EXPECT_EQ(dead, std::vector<Sha256>{pack_});

  const std::int64_t second = open_upload(taking_in);
  bring(taking_in, second);

  judging.remove_unused(dead, remove_);
  EXPECT_EQ(read(taking_in, second), tile_.tile) << "the second upload's tile can be judged";
  reject(judging, second);
  judging.remove_unused(judging.forget_dead_packs(second), remove_);
  EXPECT_TRUE(store_.packs().empty()) << "now nobody needs it";
}

TEST_F(AdoptedPack, IsPutIntoPlaceWhileNobodyCanRemoveIt) {
  CandidateCatalogue catalogue(location(), CandidateCatalogue::Access::write);
  const std::int64_t upload = open_upload(catalogue);
  const CandidateCatalogue::PackedTile packed{tile_.sidecar.sha256, start_, tile_.tile.size()};
  // Its file is put into place within the transaction: when that fails, there is no row either.
  EXPECT_THROW(catalogue.add_pack(upload, pack_, bytes_.size(), {&packed, 1}, [] { throw Error({.what = "full"}); }),
               Error);
  EXPECT_FALSE(catalogue.pack_size(upload, pack_));
  bring(catalogue, upload);
  EXPECT_EQ(read(catalogue, upload), tile_.tile);
}

TEST_F(AdoptedPack, OfAForgottenUploadIsNotTaken) {
  CandidateCatalogue catalogue(location(), CandidateCatalogue::Access::write);
  const std::int64_t upload = open_upload(catalogue);
  catalogue.remove_unused(catalogue.forget_upload(upload), remove_);
  EXPECT_THROW(bring(catalogue, upload), Error);
  EXPECT_TRUE(store_.packs().empty());
}

}  // namespace
}  // namespace nadir
