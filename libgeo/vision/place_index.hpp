// Where on the whole map could this picture have been taken? The place index of a package answers within a fraction of
// a second, for a cold start or after tracking was lost; the correlator (place_search.hpp) then decides.
//
// One vector per chunk of the map. A picture is described at nine small shifts (chunks lie a quarter or a half of a
// side apart, and the descriptor forgives a sixth) for every heading that is possible; a chunk's score is the best of
// them.
//
// Everything is deterministic. Memory: the file's 512 bytes per chunk, the table's 32, and per query some megabytes.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "package/manifest.hpp"
#include "vision/place_memory.hpp"
#include "vision/place_table.hpp"
#include "vision/place_vectors.hpp"

namespace nadir {

class PlaceIndex final : public PlaceRetrieval {
 public:
  PlaceIndex(PlaceTable table, PlaceVectors vectors);

  // Nothing when the manifest names no index. Both files must have the digests of the manifest and belong to its
  // imagery; else throws Error, before FAISS sees a byte.
  static std::optional<PlaceIndex> open(const std::filesystem::path& package, const Manifest& manifest);

  // The `count` best chunks, best first; none when the picture shows too little. The layer whose chunks are nearest in
  // size to what the mask shows is searched.
  std::vector<PlaceCandidate> query(const PlaceQuery& query, std::size_t count) const override;

  const PlaceTable& table() const { return table_; }
  const PlaceVectors& vectors() const { return vectors_; }

 private:
  const PlaceLayer* layer_for(double side_m) const;  // null: no layer has chunks

  PlaceTable table_;
  PlaceVectors vectors_;
};

}  // namespace nadir
