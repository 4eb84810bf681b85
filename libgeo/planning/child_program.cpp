#include "planning/child_program.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <optional>

#include "base/error.hpp"
#include "base/input_file.hpp"

extern char** environ;  // NOLINT: POSIX

namespace nadir {
namespace {

constexpr int kPollInterval_ms = 100;
constexpr auto kPatience = std::chrono::seconds(10);  // between asking a program to end and ending it
constexpr std::size_t kMaxLine = 64 * 1024;
constexpr int kNotStarted = 127;

[[noreturn]] void cannot_start(const ProgramCall& call, int error_number) {
  throw Error(
      {.what = "cannot start a program", .where = call.words.front(), .found = system_error_text(error_number)});
}

struct Pipe {
  FileDescriptor read, write;
};

Pipe make_pipe(const ProgramCall& call) {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) cannot_start(call, errno);
  return {FileDescriptor(ends[0]), FileDescriptor(ends[1])};
}

std::vector<std::string> environment_of(const ProgramCall& call) {
  std::vector<std::string> all;
  for (char** entry = environ; *entry != nullptr; ++entry) {
    const std::string_view text(*entry);
    const bool replaced = std::any_of(call.environment.begin(), call.environment.end(),
                                      [&](const auto& added) { return text.substr(0, text.find('=')) == added.first; });
    if (!replaced) all.emplace_back(text);
  }
  for (const auto& [name, value] : call.environment) all.push_back(name + "=" + value);
  return all;
}

std::vector<char*> pointers_to(std::vector<std::string>& words) {
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  return pointers;
}

// Between fork and exec: nothing but system calls.
[[noreturn]] void become(const char* folder, char* const* words, char* const* variables, int out, int err,
                         pid_t parent) {
  ::setpgid(0, 0);  // Ctrl-C is ours to pass on: nadird would take the terminal's and ours for two, and end at once
  ::prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (::getppid() != parent) ::_exit(kNotStarted);  // it ended before that
  const int nothing = ::open("/dev/null", O_RDONLY);
  ::dup2(nothing, STDIN_FILENO);
  ::dup2(out, STDOUT_FILENO);
  ::dup2(err, STDERR_FILENO);
  for (const int signal : {SIGINT, SIGTERM, SIGPIPE}) ::signal(signal, SIG_DFL);
  sigset_t none;
  ::sigemptyset(&none);
  ::sigprocmask(SIG_SETMASK, &none, nullptr);
  if (::chdir(folder) == 0) ::execve(words[0], words, variables);
  ::_exit(kNotStarted);
}

// What is there now; false at the end of the stream.
bool read_some(int from, std::string& into, std::size_t most) {
  std::array<char, 16'384> block{};
  const ssize_t bytes = ::read(from, block.data(), block.size());
  if (bytes < 0) return errno == EINTR || errno == EAGAIN;
  const std::size_t room = most - std::min(most, into.size());
  into.append(block.data(), std::min(room, static_cast<std::size_t>(bytes)));
  return bytes > 0;
}

void take_lines(std::string& text, bool all, const std::function<void(std::string_view)>& on_line) {
  std::size_t from = 0;
  for (std::size_t end = text.find('\n'); end != std::string::npos; end = text.find('\n', from)) {
    on_line(std::string_view(text).substr(from, end - from));
    from = end + 1;
  }
  text.erase(0, from);
  if (text.empty() || (!all && text.size() < kMaxLine)) return;
  on_line(text);
  text.clear();
}

}  // namespace

ProgramResult run_program_call(const ProgramCall& call, const std::function<void(std::string_view)>& on_error_line,
                               const std::function<bool()>& stopped) {
  Pipe out = make_pipe(call), err = make_pipe(call);
  std::vector<std::string> words = call.words, variables = environment_of(call);
  const std::vector<char*> word_pointers = pointers_to(words), variable_pointers = pointers_to(variables);
  const std::string folder = call.folder.string();
  const pid_t parent = ::getpid();
  const pid_t child = ::fork();
  if (child < 0) cannot_start(call, errno);
  if (child == 0) {
    become(folder.c_str(), word_pointers.data(), variable_pointers.data(), out.write.get(), err.write.get(), parent);
  }
  out.write = FileDescriptor();
  err.write = FileDescriptor();

  ProgramResult result;
  std::string error_text;
  std::array<pollfd, 2> streams{{{out.read.get(), POLLIN, 0}, {err.read.get(), POLLIN, 0}}};
  std::optional<std::chrono::steady_clock::time_point> asked;
  bool killed = false;
  while (streams[0].fd >= 0 || streams[1].fd >= 0) {
    const auto now = std::chrono::steady_clock::now();
    if (!asked && stopped()) {
      ::kill(child, SIGTERM);
      asked = now;
    }
    if (asked && !killed && now - *asked > kPatience) {
      ::kill(child, SIGKILL);
      killed = true;
    }
    if (::poll(streams.data(), streams.size(), kPollInterval_ms) <= 0) continue;
    if (streams[0].revents != 0 && !read_some(streams[0].fd, result.out, kMaxProgramOutput)) streams[0].fd = -1;
    if (streams[1].revents != 0) {
      const bool more = read_some(streams[1].fd, error_text, 2 * kMaxLine);
      take_lines(error_text, !more, on_error_line);
      if (!more) streams[1].fd = -1;
    }
  }
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) continue;
  result.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return result;
}

}  // namespace nadir
