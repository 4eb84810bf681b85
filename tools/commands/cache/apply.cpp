// nadir cache apply: the next package, from the one that is there and a patch.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "package_delta/package_patch.hpp"
#include "trust/root.hpp"

namespace nadir {
namespace {

class CacheApplyCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "apply"; }
  std::string_view summary() const override { return "make the next package from an existing one and a patch"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path old_, patch_, trust_, out_;
  std::optional<UtcTime> at_;
};

std::string_view CacheApplyCommand::details() const {
  return R"(The patch is one of `nadir cache diff OLD NEW --patch`. Its signature is checked before anything else
of it is read; then it must be for this very package. The result has the bytes of the new package,
its manifest and signatures included, and is verified (quick) before it appears under its name. The
old package is not changed: whenever the command is killed, it is whole, and the next run starts
anew.

Exit codes: 0 applied; 1 rejected, with findings and nothing written; 2 the patch is for another
package or damaged; 130 interrupted.)";
}

std::string_view CacheApplyCommand::examples() const {
  return R"(nadir cache apply package 1-to-2.patch --trust root.json --out package2)";
}

void CacheApplyCommand::setup(Options& options) {
  options.positional("OLD", old_, "package that the patch was made for").required();
  options.positional("PATCH", patch_, "patch").required();
  options.value("--trust", trust_, "ROOT.json", "root of trust that patch and package are verified with").required();
  options.value("--at", at_, "TIME", "evaluate validity as of this time instead of now");
  options.value("--out", out_, "NEW", "package folder to create; must not exist").required();
}

int CacheApplyCommand::run(Context& context) {
  const TrustRoot root = read_trusted_root(trust_);
  const AppliedPatch applied = apply_patch(
      {.old_package = old_, .patch = patch_, .out = out_, .root = &root, .at = at_ ? *at_ : context.clock.now()},
      context.progress);
  if (applied.findings.has_errors()) {
    if (!context.quiet) context.err << "rejected: nothing was written\n";
    return report_findings(context.out, context.json, applied.findings);
  }
  const PatchHeader& header = applied.header;
  const auto patch_bytes = std::filesystem::file_size(patch_);
  if (context.json) {
    return report_findings(context.out, true, applied.findings,
                           {{"package", out_.string()},
                            {"series", header.to.series},
                            {"from_sequence", header.from.sequence},
                            {"sequence", header.to.sequence},
                            {"patch_bytes", patch_bytes},
                            {"bytes", applied.package_bytes}});
  }
  if (!applied.findings.empty()) print_findings(context.out, applied.findings);
  print_figures(context.out, {{"package", out_.string()},
                              {"series", header.to.series},
                              {"sequence", fmt::format("{} -> {}", header.from.sequence, header.to.sequence)},
                              {"patch", fmt::format("{:.2f} MB", static_cast<double>(patch_bytes) / 1e6)},
                              {"size", fmt::format("{:.1f} MB", static_cast<double>(applied.package_bytes) / 1e6)}});
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_cache_apply() { return std::make_unique<CacheApplyCommand>(); }

}  // namespace nadir
