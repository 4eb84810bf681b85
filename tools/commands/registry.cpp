#include "commands/registry.hpp"

#include "commands/cache/build.hpp"
#include "commands/cache/diff.hpp"
#include "commands/cache/gaps.hpp"
#include "commands/cache/index.hpp"
#include "commands/cache/inspect.hpp"
#include "commands/cache/matchability.hpp"
#include "commands/cache/sign.hpp"
#include "commands/cache/update.hpp"
#include "commands/cache/validate.hpp"
#include "commands/cache/verify.hpp"
#include "commands/catalogue/add.hpp"
#include "commands/catalogue/gaps.hpp"
#include "commands/catalogue/list.hpp"
#include "commands/catalogue/remove.hpp"
#include "commands/keys/create.hpp"
#include "commands/keys/permit_rollback.hpp"
#include "commands/keys/revoke.hpp"
#include "commands/keys/root.hpp"
#include "commands/keys/sign.hpp"
#include "commands/mission/check.hpp"
#include "commands/mission/import.hpp"
#include "commands/mission/plan.hpp"
#include "commands/ortho.hpp"
#include "commands/provision/autopilot.hpp"
#include "commands/provision/boresight.hpp"
#include "commands/provision/camera.hpp"
#include "commands/recorder/export.hpp"
#include "commands/recorder/info.hpp"
#include "commands/recorder/recover.hpp"
#include "commands/recorder/verify.hpp"
#include "commands/replay.hpp"
#include "commands/simulate/camera.hpp"
#include "commands/simulate/flight.hpp"
#include "commands/simulate/world.hpp"
#include "commands/sync/prune.hpp"
#include "commands/sync/push.hpp"
#include "commands/sync/retry.hpp"
#include "commands/sync/stage.hpp"
#include "commands/sync/status.hpp"
#include "commands/watch.hpp"

namespace nadir {

ProgramText nadir_text() {
  return {.name = "nadir",
          .summary = "builds, signs and checks offline map packages, and replays flights against them",
          .footer = "Exit codes: 0 done, 1 a check refused, 2 wrong usage or could not be done, 130 interrupted."};
}

std::vector<std::unique_ptr<Command>> all_commands() {
  std::vector<std::unique_ptr<Command>> commands;
  commands.push_back(std::make_unique<KeysCreateCommand>());
  commands.push_back(std::make_unique<KeysRootCommand>());
  commands.push_back(std::make_unique<KeysRevokeCommand>());
  commands.push_back(std::make_unique<KeysSignCommand>());
  commands.push_back(std::make_unique<KeysPermitRollbackCommand>());
  commands.push_back(std::make_unique<MissionCheckCommand>());
  commands.push_back(std::make_unique<MissionImportCommand>());
  commands.push_back(std::make_unique<MissionPlanCommand>());
  commands.push_back(std::make_unique<CacheBuildCommand>());
  commands.push_back(std::make_unique<CacheUpdateCommand>());
  commands.push_back(std::make_unique<CacheSignCommand>());
  commands.push_back(std::make_unique<CacheIndexCommand>());
  commands.push_back(std::make_unique<CacheVerifyCommand>());
  commands.push_back(std::make_unique<CacheInspectCommand>());
  commands.push_back(std::make_unique<CacheValidateCommand>());
  commands.push_back(std::make_unique<CacheGapsCommand>());
  commands.push_back(std::make_unique<CacheMatchabilityCommand>());
  commands.push_back(std::make_unique<CacheDiffCommand>());
  commands.push_back(std::make_unique<CatalogueAddCommand>());
  commands.push_back(std::make_unique<CatalogueListCommand>());
  commands.push_back(std::make_unique<CatalogueGapsCommand>());
  commands.push_back(std::make_unique<CatalogueRemoveCommand>());
  commands.push_back(std::make_unique<ProvisionBoresightCommand>());
  commands.push_back(std::make_unique<ProvisionCameraCommand>());
  commands.push_back(std::make_unique<ProvisionAutopilotCommand>());
  commands.push_back(std::make_unique<SimulateWorldCommand>());
  commands.push_back(std::make_unique<SimulateFlightCommand>());
  commands.push_back(std::make_unique<SimulateCameraCommand>());
  commands.push_back(std::make_unique<ReplayCommand>());
  commands.push_back(std::make_unique<OrthoCommand>());
  commands.push_back(std::make_unique<WatchCommand>());
  commands.push_back(std::make_unique<RecorderInfoCommand>());
  commands.push_back(std::make_unique<RecorderVerifyCommand>());
  commands.push_back(std::make_unique<RecorderRecoverCommand>());
  commands.push_back(std::make_unique<RecorderExportCommand>());
  commands.push_back(std::make_unique<SyncStageCommand>());
  commands.push_back(std::make_unique<SyncPushCommand>());
  commands.push_back(std::make_unique<SyncStatusCommand>());
  commands.push_back(std::make_unique<SyncRetryCommand>());
  commands.push_back(std::make_unique<SyncPruneCommand>());
  return commands;
}

}  // namespace nadir
