#include "likelihood_fit.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/digest.hpp"
#include "base/error.hpp"

namespace nadir::bench {
namespace {

constexpr std::string_view kFormat = "nadir looks 1\n";
constexpr std::size_t kFeatures = LookFeatures::kCount;

// What a stored step of one stands for.
constexpr std::array<double, kFeatures> kSteps = {2e-5, 2e-5, 2e-5, 1, 1e-4, 2e-5, 1e-2, 1e-3, 1e-4, 2e-4, 2e-4};
// +1: more of it speaks for the place; −1: against.
constexpr std::array<int, kFeatures> kSigns = {-1, 1, 1, 1, -1, 1, -1, -1, -1, -1, -1};
// Knots, as quantiles of the candidates, both classes with the same weight.
constexpr std::array<double, MonotoneCurve::kMaxKnots> kQuantiles = {0.02, 0.2, 0.4, 0.6, 0.8, 0.98};
constexpr double kLeastGap = 0.03;  // between knots, of what they span

LookFeatures features_from(const std::array<double, kFeatures>& v) {
  return {v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8], v[9], v[10]};
}

// Shortest decimal text within the digits that a table holds; reading it back gives the number in force.
std::string text_of(double number) { return fmt::format("{:.9g}", number); }
double rounded(double number, int digits) { return std::stod(fmt::format("{:.{}g}", number, digits)); }

// ---- The model as a linear one: a curve's value is the sum of its rises up to x, each passed in part or as a whole.

struct Rise {
  double from, to;
  double share(double x, int sign) const {
    const double part = std::clamp((x - from) / (to - from), 0.0, 1.0);
    return sign > 0 ? part : 1 - part;  // a falling curve is passed from the right
  }
};

struct CurveBasis {
  int sign = 1;
  std::vector<double> knots;
  std::size_t first = 0;  // its first rise among all coefficients

  std::size_t rises() const { return knots.empty() ? 0 : knots.size() - 1; }
  Rise rise(std::size_t k) const { return {knots[k], knots[k + 1]}; }

  MonotoneCurve curve(const Eigen::VectorXd& coefficients) const {
    MonotoneCurve curve;
    curve.knots = static_cast<int>(knots.size());
    for (std::size_t i = 0; i < knots.size(); ++i) {
      curve.at[i] = knots[i];
      for (std::size_t k = 0; k < rises(); ++k) {
        curve.value[i] += coefficients[static_cast<Eigen::Index>(first + k)] * rise(k).share(knots[i], sign);
      }
    }
    return curve;
  }
};

struct Sample {
  double value, weight;
};

std::vector<double> knots_of(std::vector<Sample> samples) {
  std::sort(samples.begin(), samples.end(), [](const Sample& a, const Sample& b) { return a.value < b.value; });
  const double all = std::accumulate(samples.begin(), samples.end(), 0.0,
                                     [](double sum, const Sample& sample) { return sum + sample.weight; });
  std::vector<double> quantiles;
  double passed = 0;
  auto next = samples.begin();
  for (const double quantile : kQuantiles) {
    while (std::next(next) != samples.end() && passed + next->weight < quantile * all) passed += next++->weight;
    quantiles.push_back(rounded(next->value, 4));
  }
  // Closer ones would make a step of what is one value in truth.
  const double least_gap = kLeastGap * (quantiles.back() - quantiles.front());
  std::vector<double> knots;
  for (const double quantile : quantiles) {
    if (knots.empty() || quantile > knots.back() + least_gap) knots.push_back(quantile);
  }
  if (knots.size() == 1) knots.clear();  // nothing varies: nothing to say
  return knots;
}

struct Problem {
  std::vector<CurveBasis> curves;  // of the features, then ψ
  double reference_ln_places = 0;
  Eigen::MatrixXd rows;   // of the candidates; the last column is 1
  Eigen::VectorXd right;  // 1 or 0
  Eigen::MatrixXd penalty;
};

Problem problem_of(const std::vector<TrainingLook>& candidates, double penalty) {
  const auto rights = std::count_if(candidates.begin(), candidates.end(), [](const auto& c) { return c.right; });
  const auto wrongs = static_cast<std::ptrdiff_t>(candidates.size()) - rights;
  if (rights == 0 || wrongs == 0) throw Error({.what = "looks of both kinds are needed", .found = "one kind only"});
  Problem problem;
  std::size_t count = 0;
  const auto add = [&](std::vector<double> knots, int sign) {
    problem.curves.push_back({sign, std::move(knots), count});
    count += problem.curves.back().rises();
  };
  for (std::size_t i = 0; i < kFeatures; ++i) {
    std::vector<Sample> samples;
    for (const TrainingLook& look : candidates) {
      samples.push_back({look.features.values()[i], 0.5 / static_cast<double>(look.right ? rights : wrongs)});
    }
    add(knots_of(std::move(samples)), kSigns[i]);
  }
  add(problem.curves.front().knots, kSigns.front());
  const std::vector<double>& places = problem.curves.back().knots;
  problem.reference_ln_places =
      problem.curves[kFeatures - 1].knots.empty() || places.empty() ? 0 : problem.curves[kFeatures - 1].knots.front();
  const auto n = static_cast<Eigen::Index>(candidates.size()), m = static_cast<Eigen::Index>(count) + 1;
  problem.rows = Eigen::MatrixXd::Zero(n, m);
  problem.right = Eigen::VectorXd::Zero(n);
  for (Eigen::Index r = 0; r < n; ++r) {
    const TrainingLook& look = candidates[static_cast<std::size_t>(r)];
    const auto values = look.features.values();
    for (std::size_t i = 0; i < problem.curves.size(); ++i) {
      const CurveBasis& curve = problem.curves[i];
      const bool of_places = i == kFeatures;
      const double scale = of_places ? std::max(0.0, look.features.ln_places - problem.reference_ln_places) : 1;
      for (std::size_t k = 0; k < curve.rises(); ++k) {
        problem.rows(r, static_cast<Eigen::Index>(curve.first + k)) =
            scale * curve.rise(k).share(values[of_places ? 0 : i], curve.sign);
      }
    }
    problem.rows(r, m - 1) = 1;
    problem.right[r] = look.right ? 1 : 0;
  }
  problem.penalty = Eigen::MatrixXd::Zero(m, m);
  for (const CurveBasis& curve : problem.curves) {
    for (std::size_t k = 0; k < curve.rises(); ++k) {
      const auto at = static_cast<Eigen::Index>(curve.first + k);
      problem.penalty(at, at) += penalty;
      if (k + 1 == curve.rises()) continue;
      problem.penalty(at, at) += penalty, problem.penalty(at + 1, at + 1) += penalty;
      problem.penalty(at, at + 1) -= penalty, problem.penalty(at + 1, at) -= penalty;
    }
  }
  return problem;
}

double loss(const Problem& problem, const Eigen::VectorXd& x) {
  const Eigen::ArrayXd odds = (problem.rows * x).array();
  // ln(1 + e^z) - y z, without overflow.
  const Eigen::ArrayXd each = odds.max(0) + (-odds.abs()).exp().log1p() - problem.right.array() * odds;
  return each.sum() + 0.5 * x.dot(problem.penalty * x);
}

// All but the last coefficient, the constant, stay at or above 0.
Eigen::VectorXd projected(Eigen::VectorXd x) {
  x.head(x.size() - 1) = x.head(x.size() - 1).cwiseMax(0);
  return x;
}

Eigen::VectorXd minimum(const Problem& problem) {
  constexpr int kMaxSteps = 500;
  constexpr double kSmallGradient = 1e-9;
  const Eigen::Index m = problem.rows.cols();
  Eigen::VectorXd x = Eigen::VectorXd::Zero(m);
  for (int step = 0; step < kMaxSteps; ++step) {
    const Eigen::ArrayXd share = 1 / (1 + (-(problem.rows * x).array()).exp());
    const Eigen::VectorXd gradient = problem.rows.transpose() * (share.matrix() - problem.right) + problem.penalty * x;
    std::vector<Eigen::Index> free;
    double largest = 0;
    for (Eigen::Index i = 0; i < m; ++i) {
      if (i + 1 < m && x[i] <= 0 && gradient[i] >= 0) continue;  // held at its bound
      free.push_back(i);
      largest = std::max(largest, std::abs(gradient[i]));
    }
    if (largest < kSmallGradient * static_cast<double>(problem.rows.rows())) return x;
    const Eigen::MatrixXd weighted = (share * (1 - share)).matrix().asDiagonal() * problem.rows;
    const Eigen::MatrixXd hessian = problem.rows.transpose() * weighted + problem.penalty;
    const auto size = static_cast<Eigen::Index>(free.size());
    Eigen::MatrixXd part(size, size);
    Eigen::VectorXd down(size);
    for (Eigen::Index i = 0; i < size; ++i) {
      down[i] = -gradient[free[static_cast<std::size_t>(i)]];
      for (Eigen::Index j = 0; j < size; ++j) {
        part(i, j) = hessian(free[static_cast<std::size_t>(i)], free[static_cast<std::size_t>(j)]);
      }
    }
    const Eigen::VectorXd moved = part.ldlt().solve(down);
    Eigen::VectorXd direction = Eigen::VectorXd::Zero(m);
    for (Eigen::Index i = 0; i < size; ++i) direction[free[static_cast<std::size_t>(i)]] = moved[i];
    const double before = loss(problem, x);
    double length = 1;
    Eigen::VectorXd next = projected(x + direction);
    while (loss(problem, next) > before && length > 1e-10) next = projected(x + (length /= 2) * direction);
    if (length <= 1e-10) return x;  // no step is better: the minimum, to rounding
    x = next;
  }
  throw Error({.what = "the fit does not converge", .fix = "look for features that are not numbers"});
}

void count_rates(LookLikelihoodTable& table, const std::vector<TrainingLook>& looks) {
  std::array<int, kPictureKinds.size()> right{}, other{};
  int chance = 0;
  for (std::size_t kind = 0; kind < kPictureKinds.size(); ++kind) table.detection[kind].picture = kPictureKinds[kind];
  for (const TrainingLook& look : looks) {
    if (!look.holds_place) {
      ++table.chance.looks;
      chance += look.candidate ? 1 : 0;
      continue;
    }
    const auto kind = static_cast<std::size_t>(look.picture);
    ++table.detection[kind].looks;
    right[kind] += look.right ? 1 : 0;
    other[kind] += look.candidate && !look.right ? 1 : 0;
  }
  const auto share = [](int part, int all) { return all == 0 ? 0 : rounded(static_cast<double>(part) / all, 4); };
  for (std::size_t kind = 0; kind < kPictureKinds.size(); ++kind) {
    table.detection[kind].true_place = share(right[kind], table.detection[kind].looks);
    table.detection[kind].other_place = share(other[kind], table.detection[kind].looks);
  }
  table.chance.candidate = share(chance, table.chance.looks);
}

void round_all(MonotoneCurve& curve) {
  for (double& value : curve.value) value = std::stod(text_of(value));
}

}  // namespace

std::string packed(const TrainingSet& set) {
  std::string bytes(kFormat);
  bytes += set.origin + "\n";
  for (const TrainingLook& look : set.looks) {
    bytes.push_back(static_cast<char>((look.candidate ? 1 : 0) + (look.holds_place ? 2 : 0) + (look.right ? 4 : 0) +
                                      8 * static_cast<int>(look.picture)));
    if (!look.candidate) continue;
    const auto values = look.features.values();
    for (std::size_t i = 0; i < kFeatures; ++i) {
      const auto stored = static_cast<std::uint16_t>(std::clamp(std::lround(values[i] / kSteps[i]), 0L, 65535L));
      bytes.push_back(static_cast<char>(stored & 255));
      bytes.push_back(static_cast<char>(stored >> 8));
    }
  }
  return bytes;
}

TrainingSet unpacked(std::string_view bytes, std::string_view name) {
  const auto damaged = [&](const char* found) {
    return Error({.what = "not a file of looks", .where = std::string(name), .found = found});
  };
  if (!bytes.starts_with(kFormat)) throw damaged("another first line");
  bytes.remove_prefix(kFormat.size());
  const std::size_t end = bytes.find('\n');
  if (end == std::string_view::npos) throw damaged("no line with the origin");
  TrainingSet set{std::string(bytes.substr(0, end)), {}};
  const auto byte = [&](std::size_t at) { return static_cast<unsigned>(static_cast<unsigned char>(bytes[at])); };
  for (std::size_t at = end + 1; at < bytes.size();) {
    const unsigned flags = byte(at++);
    if (flags >= 8 * kPictureKinds.size() || ((flags & 4) != 0 && (flags & 3) != 3)) throw damaged("impossible flags");
    TrainingLook& look = set.looks.emplace_back();
    look.candidate = (flags & 1) != 0, look.holds_place = (flags & 2) != 0, look.right = (flags & 4) != 0;
    look.picture = static_cast<PictureKind>(flags / 8);
    if (!look.candidate) continue;
    if (bytes.size() - at < 2 * kFeatures) throw damaged("an incomplete look at the end");
    std::array<double, kFeatures> values{};
    for (std::size_t i = 0; i < kFeatures; ++i, at += 2) values[i] = kSteps[i] * (byte(at) + 256 * byte(at + 1));
    look.features = features_from(values);
  }
  return set;
}

std::unique_ptr<FittedLikelihood> fit(const TrainingSet& set, const std::string& training_sha256,
                                      const FitOptions& options) {
  std::vector<TrainingLook> candidates;
  std::copy_if(set.looks.begin(), set.looks.end(), std::back_inserter(candidates),
               [](const TrainingLook& look) { return look.candidate; });
  const Problem problem = problem_of(candidates, options.penalty);
  const Eigen::VectorXd x = minimum(problem);
  auto result = std::make_unique<FittedLikelihood>();
  result->training = set.origin;
  result->training_sha256 = training_sha256;
  LookLikelihoodTable& table = result->table;
  table.training = result->training;
  table.training_sha256 = result->training_sha256;
  table.true_looks = static_cast<int>(problem.right.sum());
  table.chance_looks = static_cast<int>(candidates.size()) - table.true_looks;
  table.limit = rounded(std::log(std::max(3.0, table.chance_looks / 3.0)), 6);
  // Log odds of the training set, which the ratio of densities does not contain.
  const double prior = std::log(static_cast<double>(table.true_looks) / table.chance_looks);
  table.constant = std::stod(text_of(x[x.size() - 1] - prior));
  table.reference_ln_places = problem.reference_ln_places;
  for (std::size_t i = 0; i < kFeatures; ++i) table.curves[i] = problem.curves[i].curve(x);
  table.ratio_by_places = problem.curves[kFeatures].curve(x);
  for (MonotoneCurve& curve : table.curves) round_all(curve);
  round_all(table.ratio_by_places);
  count_rates(table, set.looks);
  result->numbers_sha256 = numbers_digest(table);
  table.numbers_sha256 = result->numbers_sha256;
  return result;
}

std::vector<std::string> numbers_of(const LookLikelihoodTable& table) {
  std::vector<std::string> numbers = {std::to_string(table.true_looks), std::to_string(table.chance_looks),
                                      text_of(table.limit), text_of(table.constant),
                                      text_of(table.reference_ln_places)};
  const auto add_curve = [&](const MonotoneCurve& curve) {
    numbers.push_back(std::to_string(curve.knots));
    for (const double at : curve.at) numbers.push_back(text_of(at));
    for (const double value : curve.value) numbers.push_back(text_of(value));
  };
  for (const MonotoneCurve& curve : table.curves) add_curve(curve);
  add_curve(table.ratio_by_places);
  for (const DetectionRate& rate : table.detection) {
    numbers.insert(numbers.end(), {std::to_string(rate.looks), text_of(rate.true_place), text_of(rate.other_place)});
  }
  numbers.insert(numbers.end(), {std::to_string(table.chance.looks), text_of(table.chance.candidate)});
  return numbers;
}

std::string numbers_digest(const LookLikelihoodTable& table) {
  const std::string text = fmt::format("{} {}", table.training_sha256, fmt::join(numbers_of(table), " "));
  return sha256(as_bytes(text)).hex();
}

std::string table_initializer(const LookLikelihoodTable& table) {
  const auto curve_text = [](const MonotoneCurve& curve) {
    const auto used = static_cast<std::ptrdiff_t>(curve.knots);
    const auto list = [&](const auto& values) {
      std::vector<std::string> texts;
      std::transform(values.begin(), values.begin() + used, std::back_inserter(texts), text_of);
      return fmt::format("{{{}}}", fmt::join(texts, ", "));
    };
    return fmt::format("{{{}, {}, {}}}", curve.knots, list(curve.at), list(curve.value));
  };
  std::string curves, detection;
  for (std::size_t i = 0; i < kFeatures; ++i) {
    curves += fmt::format("        // {}\n        {},\n", LookFeatures::names[i], curve_text(table.curves[i]));
  }
  for (const DetectionRate& rate : table.detection) {
    detection += fmt::format("        {{\"{}\", {}, {}, {}}},\n", rate.picture, rate.looks, text_of(rate.true_place),
                             text_of(rate.other_place));
  }
  return fmt::format(
      R"({{
    .training = "{}",
    .training_sha256 = "{}",
    .true_looks = {},
    .chance_looks = {},
    .limit = {},
    .constant = {},
    .reference_ln_places = {},
    .curves = {{{{
{}    }}}},
    .ratio_by_places = {},
    .detection = {{{{
{}    }}}},
    .chance = {{{}, {}}},
    .numbers_sha256 = "{}",
}})",
      table.training, table.training_sha256, table.true_looks, table.chance_looks, text_of(table.limit),
      text_of(table.constant), text_of(table.reference_ln_places), curves, curve_text(table.ratio_by_places), detection,
      table.chance.looks, text_of(table.chance.candidate), table.numbers_sha256);
}

std::string table_source(const LookLikelihoodTable& table) {
  return fmt::format(
      R"(// Made by `./run bench fit-likelihood` from tests/estimation/data/looks.bin; never edited by hand: a test fits the same
// looks again and rejects a table that differs. look_likelihood.hpp says what the numbers mean.
// clang-format off
#pragma once

#include "estimation/look_likelihood.hpp"

namespace nadir {{

inline constexpr LookLikelihoodTable kLookLikelihoodTable{};

}}  // namespace nadir
)",
      table_initializer(table));
}

}  // namespace nadir::bench
