// Roads, water, woods and buildings of a package: vectors/vectors.geojson (docs/formats/vectors.md).
//
// For people, who find their way on the pages by them, and for the planner's matchability map; nothing in flight needs
// them, so that aboard they are verified by their digest and never parsed. Places are whole 1e-7 degrees. The same
// layer gives the same bytes, in whatever order its features are.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "geodesy/lon_lat.hpp"

namespace nadir {

// In the order in which they are drawn: later ones lie on top.
enum class VectorClass : std::uint8_t { wood, water, building, road };
std::string_view name_of(VectorClass cls);

struct MapVector {
  VectorClass cls = VectorClass::road;
  std::string kind;  // what the source calls it: "residential", "river", "forest"
  bool is_area = false;
  // A line; or the rings of an area, each closed by its first point: the outer one, then its holes.
  std::vector<std::vector<LonLat>> parts;

  bool operator==(const MapVector&) const = default;
};

struct VectorLayer {
  std::string attribution;  // what the licence asks to be shown
  std::string licence;      // an SPDX identifier
  std::vector<MapVector> features;
};

inline constexpr std::uint64_t kMaxVectors_bytes = 64'000'000;  // of the file
inline constexpr std::size_t kMaxVectorFeatures = 1'000'000;
inline constexpr std::size_t kMaxVectorKind = 64;  // bytes

// RFC 7946, one feature a line, sorted, each once.
std::string vectors_geojson(const VectorLayer& layer);

// Strict: reads what vectors_geojson() writes. name: for messages. Throws Error.
VectorLayer parse_vectors(ByteView file, std::string_view name);

}  // namespace nadir
