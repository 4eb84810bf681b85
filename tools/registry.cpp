#include "registry.hpp"

#include "cache_build.hpp"
#include "cache_diff.hpp"
#include "cache_gaps.hpp"
#include "cache_index.hpp"
#include "cache_inspect.hpp"
#include "cache_matchability.hpp"
#include "cache_sign.hpp"
#include "cache_update.hpp"
#include "cache_validate.hpp"
#include "cache_verify.hpp"
#include "catalogue_add.hpp"
#include "catalogue_gaps.hpp"
#include "catalogue_list.hpp"
#include "catalogue_remove.hpp"
#include "keys_create.hpp"
#include "keys_permit_rollback.hpp"
#include "keys_revoke.hpp"
#include "keys_root.hpp"
#include "keys_sign.hpp"
#include "mission_check.hpp"
#include "mission_import.hpp"
#include "mission_plan.hpp"
#include "ortho.hpp"
#include "provision_autopilot.hpp"
#include "provision_boresight.hpp"
#include "provision_camera.hpp"
#include "recorder_export.hpp"
#include "recorder_info.hpp"
#include "recorder_recover.hpp"
#include "recorder_verify.hpp"
#include "replay.hpp"
#include "simulate_camera.hpp"
#include "simulate_flight.hpp"
#include "simulate_world.hpp"
#include "sync_prune.hpp"
#include "sync_push.hpp"
#include "sync_retry.hpp"
#include "sync_stage.hpp"
#include "sync_status.hpp"
#include "watch.hpp"

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
