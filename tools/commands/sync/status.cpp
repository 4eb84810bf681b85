// nadir sync status: what is in the outbox and what keeps it.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <ostream>

#include "base/printable.hpp"
#include "base/time.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "upload/outbox_upkeep.hpp"

namespace nadir {
namespace {

std::string time_text(std::int64_t at_ms) { return at_ms == 0 ? std::string() : to_rfc3339(UtcTime{at_ms / 1'000}); }

nlohmann::json json_from(const OutboxReport& report, const std::vector<FailedTile>& failed) {
  nlohmann::json states = nlohmann::json::object(), batches = nlohmann::json::array(), tiles = nlohmann::json::array();
  for (const auto& [state, sum] : report.states) {
    states[std::string(name_of(state))] = {{"tiles", sum.tiles}, {"bytes", sum.bytes}};
  }
  for (const BatchReport& batch : report.batches) {
    batches.push_back({{"batch", batch.uuid},
                       {"airframe", batch.airframe},
                       {"flight", batch.flight},
                       {"stage", batch.stage},
                       {"tiles", batch.tiles},
                       {"open", batch.open},
                       {"attempts", batch.attempts},
                       {"not_before", time_text(batch.not_before_ms)},
                       {"trouble", batch.trouble}});
  }
  for (const FailedTile& tile : failed) {
    tiles.push_back({{"sha256", tile.sha256},
                     {"flight", tile.flight},
                     {"state", tile.state},
                     {"code", tile.code},
                     {"detail", tile.detail}});
  }
  return {{"states", states},
          {"reasons", report.reasons},
          {"kept_bytes", report.kept_bytes},
          {"batches", batches},
          {"failed", tiles}};
}

void print(std::ostream& out, const OutboxReport& report, const std::vector<FailedTile>& failed) {
  Figures figures;
  for (const auto& [state, sum] : report.states) {
    if (sum.tiles == 0) continue;
    figures.emplace_back(name_of(state),
                         fmt::format("{}, {:.1f} MB", count(static_cast<std::uint64_t>(sum.tiles), "tile"),
                                     static_cast<double>(sum.bytes) / 1e6));
  }
  if (figures.empty()) out << "the outbox is empty\n";
  for (const auto& [code, tiles] : report.reasons) figures.emplace_back("  " + code, fmt::format("{}", tiles));
  figures.emplace_back("images kept", fmt::format("{:.1f} MB", static_cast<double>(report.kept_bytes) / 1e6));
  print_figures(out, figures);
  for (const BatchReport& batch : report.batches) {
    out << printable(fmt::format("batch {} of flight {}: {}, {} of {} tiles open", batch.uuid, batch.flight,
                                 batch.stage, batch.open, batch.tiles));
    if (!batch.trouble.empty()) out << printable(fmt::format("; {}", batch.trouble));
    if (batch.not_before_ms > 0) out << fmt::format("; next attempt {}", time_text(batch.not_before_ms));
    out << '\n';
  }
  for (const FailedTile& tile : failed) {
    out << printable(fmt::format("{} {} {} {}", tile.sha256, tile.state, tile.code, tile.detail)) << '\n';
  }
}

class SyncStatusCommand final : public Command {
 public:
  std::string_view group() const override { return "sync"; }
  std::string_view name() const override { return "status"; }
  std::string_view summary() const override { return "show the state of the outbox"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path outbox_;
  int failed_ = 0;
};

std::string_view SyncStatusCommand::details() const {
  return R"(Counts the tiles by state, lists the reasons of those that were rejected, refused or found damaged,
and the incomplete batches with what blocks them. Works while a push is running.

Exit codes: 0 every tile has a final verdict or was set aside as damaged, 1 some have not, 2 the
outbox cannot be read.)";
}

std::string_view SyncStatusCommand::examples() const {
  return R"(nadir sync status outbox
nadir sync status outbox --failed 100 --json | jq '.reasons')";
}

void SyncStatusCommand::setup(Options& options) {
  options.positional("OUTBOX", outbox_, "outbox folder").required();
  options.value("--failed", failed_, "N", "list this number of tiles that were rejected, refused or damaged")
      .between(0, 1e6);
}

int SyncStatusCommand::run(Context& context) {
  const OutboxDatabase outbox(outbox_, OutboxDatabase::Access::read);
  const OutboxReport report = report_outbox(outbox);
  const std::vector<FailedTile> failed = failed_tiles(outbox, failed_);
  if (context.json) {
    print_json(context.out, json_from(report, failed));
  } else {
    print(context.out, report, failed);
  }
  const bool open = std::any_of(report.states.begin(), report.states.end(),
                                [](const auto& entry) { return !is_final(entry.first) && entry.second.tiles > 0; });
  return open ? kRefused : kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_sync_status() { return std::make_unique<SyncStatusCommand>(); }

}  // namespace nadir
