// Every command of nadir-candidates.
#pragma once

#include <memory>

#include "cli/command.hpp"

namespace nadir {

std::unique_ptr<Command> make_serve();
std::unique_ptr<Command> make_work();
std::unique_ptr<Command> make_status();
std::unique_ptr<Command> make_export();
std::unique_ptr<Command> make_installed();
std::unique_ptr<Command> make_token_create();
std::unique_ptr<Command> make_token_list();
std::unique_ptr<Command> make_token_revoke();

}  // namespace nadir
