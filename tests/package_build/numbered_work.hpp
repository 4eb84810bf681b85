// Work for tests of shards: the result of a task is its number and what a machine that knows the secret makes of it.
#pragma once

#include <fmt/format.h>

#include <string>
#include <vector>

#include "base/digest.hpp"
#include "base/shared_work.hpp"

namespace nadir::test {

class NumberedWork final : public SharedWork {
 public:
  explicit NumberedWork(std::size_t tasks, std::string secret = "one") : tasks_(tasks), secret_(std::move(secret)) {}

  std::string what() const override { return "numbering"; }
  std::string description() const override { return fmt::format("secret: {}\n", secret_); }
  std::size_t tasks() const override { return tasks_; }
  Worker make_worker() const override {
    return [this](std::size_t task) { return result(task); };
  }
  bool add(std::size_t task, ByteView bytes) override {
    if (as_text(bytes) != as_text(result(task))) return false;
    added.push_back(task);
    return true;
  }

  std::vector<std::size_t> added;

 private:
  Bytes result(std::size_t task) const {
    const std::string text = fmt::format("{} {}", task, sha256(as_bytes(fmt::format("{} {}", task, secret_))).hex());
    return {text.begin(), text.end()};
  }
  std::size_t tasks_;
  std::string secret_;
};

}  // namespace nadir::test
