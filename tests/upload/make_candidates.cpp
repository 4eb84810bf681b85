// make_candidates FOLDER KEY.pem COUNT MEAN_BYTES SEED [unclean]: a store of candidate tiles as a flight leaves it, but
// for the images: distinct bytes stand in for them.
#include <cstdlib>
#include <iostream>

#include "base/error.hpp"
#include "base/random.hpp"
#include "ortho/sample_candidates.hpp"

namespace nadir {
namespace {

Candidate made(const PrivateKey& key, std::uint32_t number, std::size_t mean_size, const Random& random) {
  Random own = random.fork("tile", number);
  Candidate candidate;
  candidate.tile = {0xFF, 0xD8, 0xFF};
  const auto size = static_cast<std::size_t>(own.uniform(0.5, 1.5) * static_cast<double>(mean_size)) + 16;
  while (candidate.tile.size() < size) candidate.tile.push_back(static_cast<std::uint8_t>(own.integer(0, 255)));
  candidate.sidecar = test::sample_sidecar({19, 278'000 + number % 200, 182'000 + number / 200});
  candidate.sidecar.sha256 = sha256(candidate.tile);
  candidate.sidecar.size = candidate.tile.size();
  candidate.sidecar_bytes = candidate_json(candidate.sidecar);
  candidate.signature = sign_candidate(key, candidate.sidecar_bytes);
  return candidate;
}

void make(char** args, bool clean) {
  const PrivateKey key = PrivateKey::read(args[1]);
  const auto count = static_cast<std::uint32_t>(std::atoi(args[2]));
  const Random random(static_cast<std::uint64_t>(std::atoll(args[4])));
  CandidateStore store(args[0]);
  std::vector<Candidate> some;
  for (std::uint32_t i = 0; i < count; ++i) {
    some.push_back(made(key, i, static_cast<std::size_t>(std::atoi(args[3])), random));
    if (some.size() == 500 || i + 1 == count) {
      store.put(some);
      some.clear();
    }
  }
  if (clean) store.close();
}

}  // namespace
}  // namespace nadir

int main(int argc, char** argv) {
  if (argc < 6) {
    std::cerr << "usage: make_candidates FOLDER KEY.pem COUNT MEAN_BYTES SEED [unclean]\n";
    return 2;
  }
  try {
    nadir::make(argv + 1, argc == 6);
    return 0;
  } catch (const nadir::Error& error) {
    std::cerr << error.what() << '\n';
    return 2;
  }
}
