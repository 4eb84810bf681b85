#include "vision/place_index.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numbers>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "base/random.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "support/cancel_after.hpp"
#include "vision/place_index_builder.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

constexpr LonLat kOrigin{8.5, 47.4};
constexpr int kZoom = 17;

const test::Landscape& index_landscape() {
  static const test::Landscape world(5, 400, 1.0);
  return world;
}

// The index_landscape as tiles. What lies east of 200 m is a lake; what lies north of 250 m is unknown.
class Tiles final : public TileSource {
 public:
  Tiles() : frame_(kOrigin) {
    for (const double east_m : {-380.0, 380.0}) {
      for (const double north_m : {-380.0, 380.0}) {
        const TileKey key = tile_at(frame_.lonlat_from_plane({east_m, north_m}), kZoom);
        first_ = keys.empty() ? key : TileKey{key.z, std::min(first_.x, key.x), std::min(first_.y, key.y)};
        last_ = {key.z, std::max(last_.x, key.x), std::max(last_.y, key.y)};
        keys.push_back(key);
      }
    }
    keys.clear();
    for (std::uint32_t x = first_.x; x <= last_.x; ++x) {
      for (std::uint32_t y = first_.y; y <= last_.y; ++y) {
        keys.push_back({kZoom, x, y});
        pictures_.emplace_back(keys.back(), draw(keys.back()));
      }
    }
  }
  ZoomRange zooms() const override { return {kZoom, kZoom}; }
  std::optional<Bytes> read(const TileKey& key) const override {
    for (const auto& [at, picture] : pictures_) {
      if (at == key) return picture;
    }
    return std::nullopt;
  }

  std::vector<TileKey> keys;

 private:
  Bytes draw(const TileKey& key) const {
    cv::Mat image(kTileSize, kTileSize, CV_8UC4);
    for (int row = 0; row < kTileSize; ++row) {
      for (int column = 0; column < kTileSize; ++column) {
        const PlanePoint at = frame_.plane_from_lonlat(
            lonlat_from_pixel({key.x * 256.0 + column + 0.5, key.y * 256.0 + row + 0.5}, kZoom));
        const double grey = at.east_m > 200 ? 60 : index_landscape().grey(at);
        const auto value = static_cast<std::uint8_t>(std::clamp(grey, 0.0, 255.0));
        const std::uint8_t alpha = at.north_m > 250 ? 0 : 255;
        image.at<cv::Vec4b>(row, column) = {value, value, value, alpha};
      }
    }
    return encode_image(image, ImageFormat::png);
  }

  LocalFrame frame_;
  TileKey first_, last_;
  std::vector<std::pair<TileKey, Bytes>> pictures_;
};

const Tiles& tiles() {
  static const Tiles all;
  return all;
}

PlaceIndex build(std::vector<double> footprints_m) {
  NoProgress progress;
  return build_place_index({&tiles(), tiles().keys, sha256({}), kOrigin},
                           {.footprints_m = std::move(footprints_m), .gsd_m = std::nullopt, .overlap_percent = 50},
                           progress);
}

const PlaceIndex& index() {
  static const PlaceIndex made = build({120, 180});
  return made;
}

// What a camera over `place` sees, of another light, north-up by a heading that is wrong by `error_rad`.
PlaceQuery picture_of(PlanePoint place, double error_rad, double gsd_m = 1.0) {
  const int side = static_cast<int>(std::lround(190 / gsd_m));
  PlaceQuery query{cv::Mat(side, side, CV_8UC1), cv::Mat(side, side, CV_8UC1, cv::Scalar(0)), gsd_m, radians(15)};
  for (int row = 0; row < side; ++row) {
    for (int column = 0; column < side; ++column) {
      // By its own sines: what lies east of the middle in truth appears turned clockwise by the error.
      const double x = (column + 0.5 - side / 2.0) * gsd_m, south = (row + 0.5 - side / 2.0) * gsd_m;
      const double east_m = std::cos(error_rad) * x + std::sin(error_rad) * south;
      const double north_m = std::sin(error_rad) * x - std::cos(error_rad) * south;
      const double grey = 255 - 0.7 * index_landscape().grey({place.east_m + east_m, place.north_m + north_m});
      query.grey.at<std::uint8_t>(row, column) = static_cast<std::uint8_t>(std::clamp(grey, 0.0, 255.0));
      if (std::abs(x) < 75 && std::abs(south) < 52) query.mask.at<std::uint8_t>(row, column) = 255;
    }
  }
  return query;
}

void expect_found(const std::vector<PlaceCandidate>& found, PlanePoint place, double error_rad, double turn_slack_rad) {
  ASSERT_FALSE(found.empty());
  const PlaceCandidate& best = found.front();
  const PlanePoint centre = LocalFrame(kOrigin).plane_from_lonlat(best.centre);
  EXPECT_LE(std::abs(centre.east_m - place.east_m), best.side_m / 2);
  EXPECT_LE(std::abs(centre.north_m - place.north_m), best.side_m / 2);
  EXPECT_LT(std::abs(wrap_pi(best.turn_rad + error_rad)), turn_slack_rad);
  EXPECT_LT(std::abs(centre.east_m + best.offset_m.x() - place.east_m), best.side_m / 4);
  EXPECT_LT(std::abs(centre.north_m + best.offset_m.y() - place.north_m), best.side_m / 4);
}

TEST(PlaceIndex, FindsAFrameInOtherLight) {
  for (const PlanePoint place : {PlanePoint{-150, -120}, {60, 40}, {-31, 130}, {17, -200}}) {
    for (const double error_deg : {-12.0, 3.0}) {
      SCOPED_TRACE(testing::Message() << place.east_m << ' ' << place.north_m << ' ' << error_deg);
      const double error_rad = radians(error_deg);
      expect_found(index().query(picture_of(place, error_rad), 5), place, error_rad, radians(16));
    }
  }
}

TEST(PlaceIndex, FindsAFrameUnderAnyHeading) {
  const PlanePoint place{-80, 35};
  for (const double error_deg : {100.0, -160.0}) {
    PlaceQuery query = picture_of(place, radians(error_deg));
    query.heading_range_rad = std::nullopt;
    const auto found = index().query(query, 5);
    expect_found(found, place, radians(error_deg), radians(21));
    for (std::size_t i = 1; i < found.size(); ++i) EXPECT_GE(found[i - 1].score, found[i].score);
  }
}

TEST(PlaceIndex, AQueryStopsWhenCancelled) {
  test::CancelAfter never(test::CancelAfter::kNever);
  PlaceQuery query = picture_of({60, 40}, 0);
  query.heading_range_rad = std::nullopt;
  const auto unasked = index().query(query, 5);
  query.cancel = never.cancel();
  const auto whole = index().query(query, 5);
  ASSERT_EQ(whole.size(), unasked.size());
  for (std::size_t i = 0; i < whole.size(); ++i)
    EXPECT_EQ(whole[i].score, unasked[i].score) << "asking changes nothing";
  EXPECT_GT(never.asked(), 24) << "as many headings are tried, and batches of vectors after them";
  for (const int at : {1, 24, 25, never.asked()}) {
    test::CancelAfter after(at);
    query.cancel = after.cancel();
    EXPECT_THROW(index().query(query, 5), Interrupted) << at;
    EXPECT_EQ(after.asked(), at);
  }
}

TEST(PlaceIndex, SearchesTheLayerThatFitsTheFrame) {
  const PlaceTable& table = index().table();
  ASSERT_EQ(table.layers.size(), 2U);
  EXPECT_EQ(index().query(picture_of({60, 40}, 0), 1).at(0).side_m, 120);
  EXPECT_EQ(index().query(picture_of({60, 40}, 0, 1.6), 1).at(0).side_m, 120) << "the size decides, not the pixels";
  PlaceQuery wide = picture_of({0, 0}, 0);
  wide.gsd_m = 1.5;
  EXPECT_EQ(index().query(wide, 1).at(0).side_m, 180);
}

TEST(PlaceIndex, OmitsWaterAndMissingGround) {
  const PlaceTable& table = index().table();
  EXPECT_GT(table.layers[0].textureless, 0U);
  EXPECT_GT(table.layers[0].invalid, 0U);
  const LocalFrame frame(kOrigin);
  for (const PlaceChunk& chunk : table.chunks) {
    const PlanePoint at = frame.plane_from_lonlat(chunk.centre());
    EXPECT_LT(at.east_m, 300);
    EXPECT_LT(at.north_m, 255);
    EXPECT_EQ(chunk.tile, tile_at(chunk.centre(), kZoom));
  }
}

TEST(PlaceIndex, ABlankFrameFindsNothing) {
  PlaceQuery query = picture_of({0, 0}, 0);
  query.mask.setTo(0);
  EXPECT_TRUE(index().query(query, 5).empty());
  query.mask.setTo(255);
  query.grey.setTo(77);
  EXPECT_TRUE(index().query(query, 5).empty());
  EXPECT_TRUE(index().query(picture_of({0, 0}, 0), 0).empty());
}

TEST(PlaceIndex, IsReproducible) {
  const PlaceIndex again = build({120, 180});
  EXPECT_EQ(place_table_json(again.table()), place_table_json(index().table()));
  EXPECT_EQ(again.vectors().file(), index().vectors().file());
}

TEST(PlaceIndex, IsTheSameForAnyNumberOfThreads) {
  const auto by = [](int threads) {
    NoProgress progress;
    return build_place_index({&tiles(), tiles().keys, sha256({}), kOrigin},
                             {.footprints_m = {120}, .gsd_m = std::nullopt, .overlap_percent = 25, .threads = threads},
                             progress);
  };
  const PlaceIndex one = by(1), three = by(3);
  EXPECT_EQ(place_table_json(three.table()), place_table_json(one.table()));
  EXPECT_EQ(three.vectors().file(), one.vectors().file());
}

TEST(PlaceIndex, RejectsWhatCannotBeIndexed) {
  EXPECT_THROW(build({20}), UsageError) << "too few pixels";
  NoProgress progress;
  const LocalFrame frame(kOrigin);
  const TileKey lake = tile_at(frame.lonlat_from_plane({330, 0}), kZoom);
  EXPECT_THROW(build_place_index({&tiles(), {lake}, {}, kOrigin},
                                 {.footprints_m = {60}, .gsd_m = std::nullopt, .overlap_percent = 50}, progress),
               UsageError);
}

TEST(PlaceTable, RoundTrips) {
  const std::string text = place_table_json(index().table());
  const PlaceTable read = parse_place_table(text, "test");
  EXPECT_EQ(place_table_json(read), text);
  EXPECT_EQ(read.projection.basis, index().table().projection.basis);
}

TEST(PlaceTable, RejectsEverythingElse) {
  const std::string text = place_table_json(index().table());
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string changed = text;
    const std::size_t at = changed.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return changed.replace(at, from.size(), to);
  };
  for (const std::string& bad :
       {std::string(), std::string("{}"), std::string("[1]"), with("\"schema\"", "\"shema\""),
        with("table/1", "table/2"), with("ogc6x8x8/1", "ogc6x8x8/0"), with("\"zoom\":17", "\"zoom\":25"),
        with("\"zoom\":17", "\"zoom\":1"), with("\"overlap_percent\":50", "\"overlap_percent\":-1"),
        with("\"overlap_percent\":50", "\"overlap_percent\":18446744073709551615"),
        with("\"side_px\":", "\"side_px\":9"), with("\"count\":", "\"count\":9"), with("\"mean\":\"", "\"mean\":\"A"),
        with("\"mean\":", "\"x\":1,\"mean\":"), with("\"chunks\":[[", "\"chunks\":[[0.5,"),
        with("\"chunks\":[[", "\"chunks\":[[1,")}) {
    EXPECT_THROW(parse_place_table(bad, "test"), Error) << bad.substr(0, 60);
  }
}

TEST(PlaceTable, RefusesAnotherDescriptorByName) {
  std::string text = place_table_json(index().table());
  text.replace(text.find(kPlaceDescriptorName), kPlaceDescriptorName.size(), "netvlad64/3");
  try {
    parse_place_table(text, "places.json");
    FAIL() << "accepted";
  } catch (const Error& error) {
    EXPECT_NE(error.text().where.find("places.json /descriptor"), std::string::npos) << error.text().where;
    EXPECT_EQ(error.text().found, "\"netvlad64/3\"");
    EXPECT_EQ(error.text().expected, "\"" + std::string(kPlaceDescriptorName) + "\"");
  }
}

std::vector<PlaceVector> some_vectors(std::size_t count, std::uint64_t seed) {
  Random random(seed);
  std::vector<PlaceVector> vectors(count);
  for (PlaceVector& vector : vectors) {
    double squared = 0;
    for (float& value : vector) squared += std::pow(value = static_cast<float>(random.normal()), 2);
    for (float& value : vector) value /= static_cast<float>(std::sqrt(squared));
  }
  return vectors;
}

TEST(PlaceVectors, SearchAgreesWithBruteForce) {
  const auto all = some_vectors(300, 1), queries = some_vectors(45, 2);
  const PlaceVectors vectors(all);
  for (const auto& [first, count] : {std::pair<std::size_t, std::size_t>{0, 300}, {40, 100}, {299, 1}, {10, 0}}) {
    const auto found = vectors.search(queries, first, count, 7);
    ASSERT_EQ(found.size(), queries.size());
    for (std::size_t q = 0; q < queries.size(); ++q) {
      std::vector<std::pair<double, std::size_t>> expected;
      for (std::size_t i = first; i < first + count; ++i) {
        expected.emplace_back(-std::inner_product(queries[q].begin(), queries[q].end(), all[i].begin(), 0.0), i);
      }
      std::sort(expected.begin(), expected.end());
      ASSERT_EQ(found[q].size(), std::min<std::size_t>(7, count));
      for (std::size_t k = 0; k < found[q].size(); ++k) {
        EXPECT_EQ(found[q][k].index, expected[k].second);
        EXPECT_NEAR(static_cast<double>(found[q][k].score), -expected[k].first, 1e-5);
      }
      // Alone or among others: the same to the last bit.
      const auto alone = vectors.search(std::span(queries).subspan(q, 1), first, count, 7);
      for (std::size_t k = 0; k < found[q].size(); ++k) EXPECT_EQ(alone[0][k].score, found[q][k].score);
    }
  }
}

TEST(PlaceVectors, ReadsItsOwnFileAndNothingElse) {
  const auto all = some_vectors(5, 3);
  const Bytes file = PlaceVectors(all).file();
  EXPECT_EQ(as_text(ByteView(file).first(4)), "IxFI");
  EXPECT_EQ(std::memcmp(file.data() + 45, all.data(), 5 * sizeof(PlaceVector)), 0);
  const PlaceVectors read(file, 5, "test");
  EXPECT_EQ(read.file(), file);
  EXPECT_EQ(read.vector(3)[7], all[3][7]);

  for (std::size_t size = 0; size < file.size(); size += size < 60 ? 1 : 97) {
    EXPECT_THROW(PlaceVectors(ByteView(file).first(size), 5, "cut"), Error) << size;
  }
  EXPECT_THROW(PlaceVectors(file, 4, "count"), Error);
  EXPECT_THROW(PlaceVectors(file, 6, "count"), Error);
  for (std::size_t at = 0; at < 45; ++at) {  // sizes of terabytes among them; 16 to 31 are not used by FAISS
    if (at >= 16 && at < 32) continue;
    Bytes hostile = file;
    hostile[at] ^= 0x40;
    EXPECT_THROW(PlaceVectors(hostile, 5, "hostile"), Error) << at;
  }
  Bytes not_a_number = file;
  const float nan = std::nanf("");
  std::memcpy(not_a_number.data() + 45 + 4 * 200, &nan, sizeof nan);
  EXPECT_THROW(PlaceVectors(not_a_number, 5, "nan"), Error);
}

}  // namespace
}  // namespace nadir
