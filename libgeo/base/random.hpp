// Seeded randomness with the same numbers on every standard library: the engine is std::mt19937_64, whose output the
// standard fixes; the distributions are our own, because those of the standard are not fixed.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <string_view>

namespace nadir {

class Random {
 public:
  explicit Random(std::uint64_t seed) : seed_(seed), engine_(seed) {}

  // An independent stream for a named purpose: adding draws in one place does not change those in another.
  Random fork(std::string_view purpose, std::uint64_t index = 0) const {
    std::uint64_t hash = 1469598103934665603ULL ^ (seed_ * 0x9E3779B97F4A7C15ULL) ^ (index * 0xD6E8FEB86659FD93ULL);
    for (const char c : purpose) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211ULL;
    hash ^= hash >> 29;
    return Random(hash * 0xBF58476D1CE4E5B9ULL);
  }

  // In [0, 1).
  double uniform() { return static_cast<double>(engine_() >> 11) * 0x1.0p-53; }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }

  // In [low, high].
  int integer(int low, int high) {
    return low + static_cast<int>(uniform() * (static_cast<double>(high) - static_cast<double>(low) + 1.0));
  }

  bool chance(double probability) { return uniform() < probability; }

  // Mean 0, standard deviation 1 (Box-Muller, one of the pair).
  double normal() {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
    return radius * std::cos(2.0 * std::numbers::pi * uniform());
  }
  double normal(double mean, double sigma) { return mean + sigma * normal(); }

 private:
  std::uint64_t seed_;
  std::mt19937_64 engine_;
};

}  // namespace nadir
