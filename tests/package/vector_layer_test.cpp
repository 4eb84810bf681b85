// The file of a package's vectors: the same layer gives the same bytes, and what is none is refused.
#include "package/vector_layer.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "base/error.hpp"

namespace nadir {
namespace {

VectorLayer sample_layer() {
  return {"© OpenStreetMap contributors",
          "ODbL-1.0",
          {{VectorClass::road, "primary", false, {{{11.5, 48.1}, {11.5012345, 48.1000001}}}},
           {VectorClass::water,
            "lake",
            true,
            {{{11, 48}, {11.01, 48}, {11.01, 48.01}, {11, 48}},
             {{11.004, 48.002}, {11.008, 48.006}, {11.008, 48.002}, {11.004, 48.002}}}},
           {VectorClass::wood, "", true, {{{-0.0000001, -1}, {1, -1}, {1, 0}, {-0.0000001, -1}}}}}};
}

std::string refusal(const std::string& text) {
  try {
    parse_vectors(as_bytes(text), "v.geojson");
  } catch (const Error& error) {
    return error.what();
  }
  return "accepted";
}

TEST(VectorLayer, ReadsBackAsItWasWritten) {
  const std::string text = vectors_geojson(sample_layer());
  const VectorLayer layer = parse_vectors(as_bytes(text), "v.geojson");
  EXPECT_EQ(layer.attribution, sample_layer().attribution);
  EXPECT_EQ(layer.licence, "ODbL-1.0");
  ASSERT_EQ(layer.features.size(), 3U);
  EXPECT_EQ(layer.features[0], sample_layer().features[2]) << "in the order in which they are drawn";
  EXPECT_EQ(layer.features[1], sample_layer().features[1]);
  EXPECT_EQ(layer.features[2], sample_layer().features[0]);
  EXPECT_EQ(vectors_geojson(layer), text);
  EXPECT_NE(text.find("[11.5,48.1],[11.5012345,48.1000001]"), std::string::npos) << text;
}

TEST(VectorLayer, TheOrderOfTheFeaturesDoesNotMatterAndEachIsThereOnce) {
  VectorLayer other = sample_layer();
  std::reverse(other.features.begin(), other.features.end());
  other.features.push_back(other.features.front());
  EXPECT_EQ(vectors_geojson(other), vectors_geojson(sample_layer()));
  EXPECT_EQ(parse_vectors(as_bytes(vectors_geojson({"a", "b", {}})), "none").features.size(), 0U);
}

TEST(VectorLayer, WhatIsNoFileOfVectorsIsRefused) {
  const std::string sound = vectors_geojson(sample_layer());
  for (std::size_t cut = 0; cut + 2 < sound.size(); cut += 11)
    EXPECT_NE(refusal(sound.substr(0, cut)), "accepted") << cut;
  const auto broken = [&](const std::string& from, const std::string& to) {
    std::string text = sound;
    text.replace(text.find(from), from.size(), to);
    return refusal(text);
  };
  EXPECT_NE(broken("\"road\"", "\"sea\"").find("/features/2/properties/class"), std::string::npos);
  EXPECT_NE(broken("LineString", "Point"), "accepted");
  EXPECT_NE(broken("[11.5,48.1],", ""), "accepted") << "a line of one point";
  EXPECT_NE(broken("[11.5,48.1]", "[181,48.1]"), "accepted");
  EXPECT_NE(broken("[11.5,48.1]", "[11.5,48.1,3]"), "accepted");
  EXPECT_NE(broken("[11.5,48.1]", "[\"11.5\",48.1]"), "accepted");
  EXPECT_NE(broken("[11.01,48.01],[11,48]]", "[11.01,48.01],[11,48.5]]").find("closed"), std::string::npos);
  EXPECT_NE(broken("\"licence\"", "\"license\""), "accepted");
  EXPECT_NE(broken("\"kind\":\"lake\"", "\"kind\":\"" + std::string(65, 'x') + "\""), "accepted");
  EXPECT_NE(broken("{\"type\":\"Feature\"", "{\"more\":1,\"type\":\"Feature\""), "accepted");
  EXPECT_NE(refusal(std::string(200'000, '[')), "accepted");
  EXPECT_NE(refusal(std::string(kMaxVectors_bytes + 1, ' ')).find("at most"), std::string::npos);
}

}  // namespace
}  // namespace nadir
