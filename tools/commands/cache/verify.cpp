// nadir cache verify: is this package what its makers signed, is it for us, and does it hold what its mission needs?
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <thread>

#include "base/time.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/cache_report.hpp"
#include "commands/cache/imagery_options.hpp"
#include "commands/cache/matchability_request.hpp"
#include "commands/cache/tile_set_subject.hpp"
#include "commands/commands.hpp"
#include "verify_request/verify_request.hpp"
#include "vision/place_index.hpp"

namespace nadir {
namespace {

class CacheVerifyCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "verify"; }
  std::string_view summary() const override { return "verify a signed package before it flies"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  int report(Context& context, const Verification& verification, UtcTime at) const;

  std::filesystem::path package_;
  VerifyRequest request_;
  std::string depth_ = "quick";
  std::optional<int> threads_;
  std::optional<std::filesystem::path> report_folder_;
  bool matchability_ = false;
  MatchabilityRequest matchability_request_;
};

std::string_view CacheVerifyCommand::details() const {
  return R"(The signature is checked before anything else is read; after that every problem is reported. quick:
signature, sizes, the Merkle root over the stored digests, and the mission's requirements. full:
every byte is hashed as well, once. With --state the package must not be older than what was
accepted before, and an accepted one is recorded; --permit allows a rollback that the signers have
signed. Newer roots of trust in the package are followed if their predecessors have signed them.

--report writes the findings as text, JSON, CSV and Markdown, and report.html: a page with a map of
coverage and age that needs no network.

Exit codes: 0 accepted, 1 rejected, 2 the check could not be done.)";
}

std::string_view CacheVerifyCommand::examples() const {
  return R"(nadir cache verify package --trust root.json
nadir cache verify package --trust root.json --depth full --airframe mini-07 --state state.json
nadir cache verify package --trust root.json --report report && xdg-open report/report.html)";
}

void CacheVerifyCommand::setup(Options& options) {
  options.positional("PACKAGE", package_, "package folder").required();
  request_.setup(options);
  options.value("--depth", depth_, "DEPTH", "depth of the check").one_of({"quick", "full"});
  options.value("--threads", threads_, "N", "with --depth full: threads that hash; default: one per processor")
      .between(1, 256);
  options.value("--report", report_folder_, "DIR", "also write the findings and a page with a map to this folder");
  options.flag("--matchability", matchability_, "with --report: show where frames can be matched to the map")
      .needs("--report");
  options.value("--camera", matchability_request_.camera, "FILE.yaml", "with --matchability: the camera of the flight")
      .needs("--matchability");
  options
      .value("--speed-mps", matchability_request_.cruise_mps, "V",
             "with --matchability: ground speed, to give route segments in seconds")
      .formerly("--cruise-mps")
      .between(1, 300)
      .needs("--matchability");
}

int CacheVerifyCommand::run(Context& context) {
  VerifyOptions options = request_.open(context.clock);
  options.depth = depth_ == "full" ? VerifyDepth::full : VerifyDepth::quick;
  options.threads = threads_.value_or(static_cast<int>(std::max(1U, std::thread::hardware_concurrency())));
  Verification verification = verify_package(package_, options, context.progress);
  verify_place_index(options.depth, context.progress, verification);
  verification.findings.add(request_.findings());
  if (verification.accepted()) {
    request_.record_acceptance(*verification.manifest, verification);
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
    figures.emplace_back("imagery", fmt::format("{}, {:.1f} MB in total", count(verification.tiles.size(), "tile"),
                                                static_cast<double>(verification.bytes) / 1e6));
    figures.emplace_back("trust root", fmt::format("version {}", verification.root_version));
    if (const Artifact* artifact = manifest.artifact(kRoleImagery); artifact != nullptr && artifact->tiles) {
      more["sources"] = json_of(artifact->tiles->sources);
      for (const SourceLicence& source : artifact->tiles->sources) figures.emplace_back("source", text_of(source));
    }
    if (const Artifact* artifact = manifest.artifact(kRoleVectors); artifact != nullptr && artifact->vectors) {
      more["vectors"] = json_of(*artifact->vectors);
      figures.emplace_back("vectors", text_of(*artifact->vectors));
    }
    for (const std::string& signer : verification.signers) figures.emplace_back("signed by", signer);
  }
  std::optional<VectorLayer> vectors;
  if (verification.accepted() && (matchability_ || report_folder_)) {
    vectors = read_package_vectors(package_, *verification.manifest);
  }
  // The tiles of a refused package are not worth the minutes, or not to be read at all.
  std::optional<MatchabilityResult> matchability;
  if (matchability_ && verification.accepted() && verification.mission) {
    const auto [tiles, manifest, mission] = find_tile_set(package_);
    matchability = make_matchability(tiles, *verification.mission, vectors ? &*vectors : nullptr, matchability_request_,
                                     context.progress);
    for (const auto& figure : figures_of(*matchability)) figures.push_back(figure);
    more["matchability"] = json_of(*matchability);
  }
  if (report_folder_) {
    write_cache_report(*report_folder_, {.title = "Package " + package_.lexically_normal().string(),
                                         .subtitle = fmt::format("Verified ({}) as of {}", depth_, to_rfc3339(at)),
                                         .at = at,
                                         .findings = verification.findings,
                                         .figures = figures,
                                         .mission = verification.mission,
                                         .tiles = verification.tiles,
                                         .matchability = std::move(matchability),
                                         .vectors = std::move(vectors)});
  }
  if (!context.json) print_figures(context.out, figures);
  return report_findings(context.out, context.json, verification.findings, more);
}

}  // namespace

std::unique_ptr<Command> make_cache_verify() { return std::make_unique<CacheVerifyCommand>(); }

}  // namespace nadir
