#include "commands/commands.hpp"

namespace nadir {

ProgramText nadir_text() {
  return {.name = "nadir",
          .summary = "builds, signs and checks offline map packages, and replays flights against them",
          .footer =
              "Exit codes: 0 success, 1 a check failed, 2 wrong usage or the job could not be done, 130 interrupted."};
}

std::vector<std::unique_ptr<Command>> all_commands() {
  std::vector<std::unique_ptr<Command>> commands;
  for (const auto make : {make_keys_create,
                          make_keys_public,
                          make_keys_root,
                          make_keys_revoke,
                          make_keys_sign,
                          make_keys_permit_rollback,
                          make_keys_permit_time,
                          make_mission_check,
                          make_mission_import,
                          make_mission_export,
                          make_mission_plan,
                          make_mission_predict,
                          make_cache_build,
                          make_cache_pin,
                          make_cache_plan_shards,
                          make_cache_merge,
                          make_cache_update,
                          make_cache_sign,
                          make_cache_index,
                          make_cache_verify,
                          make_cache_inspect,
                          make_cache_validate,
                          make_cache_gaps,
                          make_cache_matchability,
                          make_cache_diff,
                          make_cache_apply,
                          make_cache_export,
                          make_catalogue_add,
                          make_catalogue_list,
                          make_catalogue_gaps,
                          make_catalogue_project,
                          make_catalogue_export,
                          make_catalogue_remove,
                          make_provision_boresight,
                          make_provision_camera,
                          make_provision_autopilot,
                          make_simulate_world,
                          make_simulate_flight,
                          make_simulate_camera,
                          make_simulate_loop,
                          make_flight_import,
                          make_flight_geotag,
                          make_replay,
                          make_evaluate,
                          make_ortho,
                          make_desk_serve,
                          make_watch,
                          make_recorder_info,
                          make_recorder_verify,
                          make_recorder_recover,
                          make_recorder_export,
                          make_sync_stage,
                          make_sync_push,
                          make_sync_status,
                          make_sync_retry,
                          make_sync_prune}) {
    commands.push_back(make());
  }
  return commands;
}

}  // namespace nadir
