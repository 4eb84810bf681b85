// nadir-candidates token create, list, revoke: the file of tokens that `serve --tokens` reads.
#pragma once

#include <memory>

#include "cli/command.hpp"

namespace nadir {

std::unique_ptr<Command> make_token_create();
std::unique_ptr<Command> make_token_list();
std::unique_ptr<Command> make_token_revoke();

}  // namespace nadir
