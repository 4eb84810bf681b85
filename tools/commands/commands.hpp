// Every command of `nadir`: one file per command, tools/commands/<group>/<verb>.cpp, with the class in it and the
// factory that is declared here. A command is added by its file, one line here and one in registry.cpp.
#pragma once

#include <memory>
#include <vector>

#include "cli/command.hpp"
#include "cli/program.hpp"

namespace nadir {

ProgramText nadir_text();

// In the order in which `nadir --help` lists them.
std::vector<std::unique_ptr<Command>> all_commands();

std::unique_ptr<Command> make_keys_create();
std::unique_ptr<Command> make_keys_public();
std::unique_ptr<Command> make_keys_root();
std::unique_ptr<Command> make_keys_revoke();
std::unique_ptr<Command> make_keys_sign();
std::unique_ptr<Command> make_keys_permit_rollback();
std::unique_ptr<Command> make_keys_permit_time();
std::unique_ptr<Command> make_mission_check();
std::unique_ptr<Command> make_mission_import();
std::unique_ptr<Command> make_mission_export();
std::unique_ptr<Command> make_mission_plan();
std::unique_ptr<Command> make_mission_predict();
std::unique_ptr<Command> make_cache_build();
std::unique_ptr<Command> make_cache_pin();
std::unique_ptr<Command> make_cache_plan_shards();
std::unique_ptr<Command> make_cache_merge();
std::unique_ptr<Command> make_cache_update();
std::unique_ptr<Command> make_cache_sign();
std::unique_ptr<Command> make_cache_index();
std::unique_ptr<Command> make_cache_verify();
std::unique_ptr<Command> make_cache_inspect();
std::unique_ptr<Command> make_cache_validate();
std::unique_ptr<Command> make_cache_gaps();
std::unique_ptr<Command> make_cache_matchability();
std::unique_ptr<Command> make_cache_diff();
std::unique_ptr<Command> make_cache_apply();
std::unique_ptr<Command> make_cache_export();
std::unique_ptr<Command> make_catalogue_add();
std::unique_ptr<Command> make_catalogue_list();
std::unique_ptr<Command> make_catalogue_gaps();
std::unique_ptr<Command> make_catalogue_project();
std::unique_ptr<Command> make_catalogue_export();
std::unique_ptr<Command> make_catalogue_remove();
std::unique_ptr<Command> make_provision_boresight();
std::unique_ptr<Command> make_provision_camera();
std::unique_ptr<Command> make_provision_autopilot();
std::unique_ptr<Command> make_simulate_world();
std::unique_ptr<Command> make_simulate_flight();
std::unique_ptr<Command> make_simulate_camera();
std::unique_ptr<Command> make_simulate_loop();
std::unique_ptr<Command> make_flight_import();
std::unique_ptr<Command> make_flight_geotag();
std::unique_ptr<Command> make_replay();
std::unique_ptr<Command> make_evaluate();
std::unique_ptr<Command> make_ortho();
std::unique_ptr<Command> make_desk_serve();
std::unique_ptr<Command> make_watch();
std::unique_ptr<Command> make_recorder_info();
std::unique_ptr<Command> make_recorder_verify();
std::unique_ptr<Command> make_recorder_recover();
std::unique_ptr<Command> make_recorder_export();
std::unique_ptr<Command> make_sync_stage();
std::unique_ptr<Command> make_sync_push();
std::unique_ptr<Command> make_sync_status();
std::unique_ptr<Command> make_sync_retry();
std::unique_ptr<Command> make_sync_prune();

}  // namespace nadir
