// √(a² + b²) with the same bits on every processor. C libraries round std::hypot differently: glibc's on arm64 and on
// amd64 give other last bits for an eighth of all arguments. Products and roots are rounded alike everywhere; lengths
// here are far from overflow.
#pragma once

#include <cmath>

namespace nadir {

inline double hypotenuse(double a, double b) { return std::sqrt(a * a + b * b); }
inline double hypotenuse(double a, double b, double c) { return std::sqrt(a * a + b * b + c * c); }

}  // namespace nadir
