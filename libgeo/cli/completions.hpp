// Completions for bash, zsh and fish, from what --help says: command words, options, their choices, and files where a
// value may name one.
#pragma once

#include <string>

namespace nadir {

struct ProgramModel;

std::string bash_completion(const ProgramModel& program);
std::string zsh_completion(const ProgramModel& program);
std::string fish_completion(const ProgramModel& program);

}  // namespace nadir
