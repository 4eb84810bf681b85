// Candidates as a flight makes them, with a picture that differs from tile to tile.
#pragma once

#include "ortho/candidate_store.hpp"

namespace nadir::test {

CandidateSidecar sample_sidecar(const TileKey& key);

// number: of the picture; sigma_mm: how good it is.
Candidate sample_candidate(const PrivateKey& key, const TileKey& at, int number = 0, std::int64_t sigma_mm = 2000);

}  // namespace nadir::test
