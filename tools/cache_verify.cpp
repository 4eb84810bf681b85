#include "cache_verify.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cache_report/cache_report.hpp"
#include "framework/options.hpp"
#include "framework/output.hpp"

namespace nadir {

std::string_view CacheVerifyCommand::details() const {
  return "The signature is checked before anything else is read; after that everything that is wrong is reported.\n"
         "quick: signature, sizes, the Merkle root over the stored digests, and the mission's demands. full: every\n"
         "byte is hashed as well. With --state the package must not be older than what was accepted before, and an\n"
         "accepted one is remembered; --permit allows a step back that the signers have signed. Newer roots of trust\n"
         "that the package carries are followed when the older ones have signed them.\n\n"
         "--report writes the findings as text, JSON, CSV and Markdown, and report.html: a page with a map of "
         "coverage\n"
         "and freshness that needs no network. Exit code 0: accepted; 1: refused; 2: could not be checked.";
}

std::string_view CacheVerifyCommand::examples() const {
  return "nadir cache verify package --trust root.json\n"
         "nadir cache verify package --trust root.json --depth full --airframe mini-07 --state state.json\n"
         "nadir cache verify package --trust root.json --report report && xdg-open report/report.html";
}

void CacheVerifyCommand::setup(Options& options) {
  options.positional("PACKAGE", package_, "the package's folder").required();
  options.value("--trust", trust_, "ROOT.json", "the trust root").required();
  options.value("--depth", depth_, "DEPTH", "quick or full").one_of({"quick", "full"});
  options.value("--airframe", airframe_, "ID", "refuse packages that are not for this airframe");
  options.value("--state", state_, "STATE.json", "what this aircraft has accepted before; updated on acceptance");
  options.value("--report", report_folder_, "DIR", "write the findings and a page with a map into this folder as well");
  options.value("--permit", permit_, "PERMIT.json", "signed permit to go back to this older package").needs("--state");
  options.value("--at", at_, "TIME", "judge as if it were this time");
}

// A damaged memory refuses; it is neither taken for an empty one nor overwritten.
std::optional<AircraftState> CacheVerifyCommand::open_state(Findings& findings) const {
  if (!state_) return std::nullopt;
  StateReading reading = check_state(*state_);
  findings.add(reading.findings);
  return std::move(reading.state);
}

std::optional<SignedPermit> CacheVerifyCommand::open_permit(Findings& findings) const {
  if (!permit_) return std::nullopt;
  const std::string text = read_text_file(*permit_, kMaxPermitSize);
  try {
    return parse_permit(text, permit_->string());
  } catch (const Error& error) {
    findings.add({.code = "permit.invalid",
                  .where = permit_->string(),
                  .expected = error.text().expected.empty() ? "a rollback permit" : error.text().expected,
                  .found = error.text().found.empty() ? error.text().what : error.text().found,
                  .fix = "get the permit again from the signers"});
  }
  return std::nullopt;
}

int CacheVerifyCommand::run(Context& context) {
  const TrustRoot root = read_trusted_root(trust_);
  VerifyOptions options;
  options.root = &root;
  options.depth = depth_ == "full" ? VerifyDepth::full : VerifyDepth::quick;
  options.at = judging_time(at_, context.clock);
  options.airframe = airframe_;
  Findings findings;
  std::optional<AircraftState> state = open_state(findings);
  if (state) options.state = &*state;
  const std::optional<SignedPermit> permit = open_permit(findings);
  if (permit) options.permit = &*permit;

  Verification verification = verify_package(package_, options, context.progress);
  verification.findings.add(findings);
  if (state && verification.accepted()) {
    remember(*state, verification, options.at);
    write_state(*state_, *state);
  }
  return report(context, verification, options.at);
}

int CacheVerifyCommand::report(Context& context, const Verification& verification, UtcTime at) const {
  nlohmann::json more{{"package", package_.string()},
                      {"depth", depth_},
                      {"signers", verification.signers},
                      {"root_version", verification.root_version}};
  Figures figures{{"package", package_.string()}};
  if (verification.manifest) {
    const Manifest& manifest = *verification.manifest;
    more["mission"] = manifest.mission_id;
    more["series"] = manifest.series;
    more["sequence"] = manifest.sequence;
    more["expires"] = to_rfc3339(manifest.expires);
    more["tiles"] = verification.tiles.size();
    more["bytes"] = verification.bytes;
    figures.emplace_back(
        "mission", fmt::format("{} (series {}, sequence {})", manifest.mission_id, manifest.series, manifest.sequence));
    figures.emplace_back("expires", to_rfc3339(manifest.expires));
    figures.emplace_back("imagery", fmt::format("{} tiles, {:.1f} MB in all", verification.tiles.size(),
                                                static_cast<double>(verification.bytes) / 1e6));
    figures.emplace_back("trust root", fmt::format("version {}", verification.root_version));
    for (const std::string& signer : verification.signers) figures.emplace_back("signed by", signer);
  }
  if (report_folder_) {
    write_cache_report(*report_folder_, {.title = "Package " + package_.lexically_normal().string(),
                                         .subtitle = fmt::format("Verified ({}) as of {}", depth_, to_rfc3339(at)),
                                         .at = at,
                                         .findings = verification.findings,
                                         .figures = figures,
                                         .mission = verification.mission,
                                         .tiles = verification.tiles});
  }
  if (!context.json) print_figures(context.out, figures);
  return report_findings(context.out, context.json, verification.findings, more);
}

}  // namespace nadir
