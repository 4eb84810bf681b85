// A share that was counted, and the interval of the true one with 95 % confidence (Clopper & Pearson 1934: exact, never
// too narrow).
#pragma once

namespace nadir::bench {

struct CountedShare {
  int count = 0, of = 0;
  double share() const { return of == 0 ? 0 : static_cast<double>(count) / of; }
  double lower() const;
  double upper() const;
};

}  // namespace nadir::bench
