// What an import found, assumed and misses, as it goes along.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "base/error.hpp"

namespace nadir {

class ImportReport {
 public:
  // Assumed.
  void note(std::string code, std::string where, std::string expected, std::string found, std::string fix) {
    add(Severity::note, std::move(code), std::move(where), std::move(expected), std::move(found), std::move(fix));
  }
  // Doubtful, or left out.
  void warn(std::string code, std::string where, std::string expected, std::string found, std::string fix) {
    add(Severity::warning, std::move(code), std::move(where), std::move(expected), std::move(found), std::move(fix));
  }
  // Not known from anything: nothing is written.
  void missing(std::string code, std::string expected, std::string found, std::string fix) {
    add(Severity::error, std::move(code), {}, std::move(expected), std::move(found), std::move(fix));
  }
  void add(const Findings& findings) { findings_.add(findings); }
  // For people.
  void figure(std::string name, std::string text) { figures_.emplace_back(std::move(name), std::move(text)); }

  const Findings& findings() const { return findings_; }
  const std::vector<std::pair<std::string, std::string>>& figures() const { return figures_; }

 private:
  void add(Severity severity, std::string code, std::string where, std::string expected, std::string found,
           std::string fix) {
    findings_.add({std::move(code), severity, std::move(where), std::move(expected), std::move(found), std::move(fix)});
  }

  Findings findings_;
  std::vector<std::pair<std::string, std::string>> figures_;
};

}  // namespace nadir
