// Fits the likelihood ratio of a look (estimation/look_likelihood.hpp) to labelled looks, and writes it as a table.
//
// Minimised over the curves' rises r >= 0 and the constant: the logistic loss of "true place or chance peak" over all
// candidates, with equal weights, plus a penalty λ/2 (Σ r² + Σ (r_k - r_{k+1})²) that keeps curves without evidence
// flat and others smooth. Convex, so the minimum is one; found by projected Newton steps with an active set (Bertsekas
// 1982), which need no randomness: the same looks give the same table.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "estimation/look_likelihood.hpp"

namespace nadir::bench {

enum class PictureKind : std::uint8_t { clear, old, clouds, blur, night };
inline constexpr std::array<std::string_view, 5> kPictureKinds = {"clear", "old", "clouds", "blur", "night"};

// A look as the fit needs it. Features are rounded as the file stores them.
struct TrainingLook {
  bool candidate = false, holds_place = false, right = false;
  PictureKind picture = PictureKind::clear;
  LookFeatures features;  // of a candidate
};

struct TrainingSet {
  std::string origin;  // sets, seeds, worlds, in one line
  std::vector<TrainingLook> looks;
};

// A file of a few hundred kilobytes: a line that names the format, one with the origin, then for each look a byte of
// flags (candidate 1, holds the place 2, right 4, picture 8 · kind) and, for a candidate, its features as unsigned
// 16 bit numbers, little endian. Throw Error for anything else.
std::string packed(const TrainingSet& set);
TrainingSet unpacked(std::string_view bytes, std::string_view name);

struct FitOptions {
  double penalty = 1;  // λ
};

// The table and the text that it points to.
struct FittedLikelihood {
  LookLikelihoodTable table;  // its texts point into the strings below; copy neither
  std::string training, training_sha256, numbers_sha256;
};

// training_sha256: of the stored looks. Throws Error where either class has no candidates.
std::unique_ptr<FittedLikelihood> fit(const TrainingSet& set, const std::string& training_sha256,
                                      const FitOptions& options = {});

// All numbers of a table as text, in a fixed order, as its header holds them; their digest.
std::vector<std::string> numbers_of(const LookLikelihoodTable& table);
std::string numbers_digest(const LookLikelihoodTable& table);

// A table as an initializer in C++, and libgeo/estimation/look_likelihood_table.hpp.
std::string table_initializer(const LookLikelihoodTable& table);
std::string table_source(const LookLikelihoodTable& table);

}  // namespace nadir::bench
