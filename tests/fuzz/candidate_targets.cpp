// Sidecars of candidate tiles: from an aircraft that somebody may have had in his hands.
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "ortho/candidate_store.hpp"

namespace nadir::fuzz {

void candidate(std::string_view bytes) {
  refusing([&] {
    const CandidateSidecar sidecar = parse_candidate(bytes, "fuzz");
    require(candidate_json(sidecar) == bytes, "two spellings of one sidecar");
    require(sidecar.key.valid(), "an address outside of the grid");
    require(badness_mm(sidecar) >= 0, "a badness that is none");
  });
}

}  // namespace nadir::fuzz
