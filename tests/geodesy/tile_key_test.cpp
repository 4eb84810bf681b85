#include "geodesy/web_mercator.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

// The MBTiles 1.3 specification's own example: "the tile 11/327/791 is inserted as 11, 327, 1256".
TEST(TileKey, MbtilesSpecificationsExample) {
  const TileKey key{11, 327, 791};
  EXPECT_EQ(key.tms_row(), 1256U);
  EXPECT_EQ(TileKey::from_tms(11, 327, 1256), key);
}

TEST(TileKey, TmsIsItsOwnInverseAtEveryZoom) {
  for (std::uint8_t z = 0; z <= kMaxZoom; ++z) {
    const std::uint32_t last = (std::uint32_t{1} << z) - 1;
    EXPECT_EQ((TileKey{z, 0, 0}).tms_row(), last);
    EXPECT_EQ(TileKey::from_tms(z, 0, last), (TileKey{z, 0, 0}));
  }
}

TEST(TileKey, KnowsWhatIsValid) {
  EXPECT_TRUE((TileKey{0, 0, 0}).valid());
  EXPECT_FALSE((TileKey{0, 1, 0}).valid());
  EXPECT_TRUE((TileKey{24, (1U << 24U) - 1, 0}).valid());
  EXPECT_FALSE((TileKey{25, 0, 0}).valid());
  EXPECT_EQ((TileKey{5, 9, 12}).parent(), (TileKey{4, 4, 6}));
}

TEST(TileKey, TextHasOneSpelling) {
  const TileKey key{19, 438048, 225763};
  EXPECT_EQ(to_text(key), "19/438048/225763");
  EXPECT_EQ(parse_tile_key("19/438048/225763"), key);
  for (const char* bad : {"", "19/1", "19/1/2/3", "19/-1/2", "19/1/2 ", "2/4/0", "2/0/4", "25/0/0", "a/b/c", "19//2",
                          "19/01/2", "300/0/0", "19/4294967297/0"}) {
    EXPECT_EQ(parse_tile_key(bad), std::nullopt) << bad;
  }
}

TEST(TileKey, SortsByZoomColumnRow) {
  EXPECT_LT((TileKey{1, 1, 1}), (TileKey{2, 0, 0}));
  EXPECT_LT((TileKey{2, 0, 3}), (TileKey{2, 1, 0}));
}

}  // namespace
}  // namespace nadir
