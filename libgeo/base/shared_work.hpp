// Work that several machines may share: numbered tasks that do not depend on each other, and whoever puts their results
// together in order. A result is bytes, so that it is the same whether a thread hands it on or a file does.
//
// do_alone() does all of it here. package_build/work_shards.hpp lets each machine do a part.
#pragma once

#include <cstddef>
#include <functional>
#include <string>

#include "base/bytes.hpp"
#include "base/ordered_work.hpp"
#include "base/progress.hpp"

namespace nadir {

class SharedWork {
 public:
  virtual ~SharedWork() = default;

  virtual std::string what() const = 0;         // "describing places", for people
  virtual std::string description() const = 0;  // lines "name: value" of all that the results depend on
  virtual std::size_t tasks() const = 0;

  // For one thread: the result of a task.
  using Worker = std::function<Bytes(std::size_t task)>;
  virtual Worker make_worker() const = 0;

  // All results, in the order of the tasks. False for bytes that are no result of this task.
  virtual bool add(std::size_t task, ByteView result) = 0;
};

inline void do_alone(SharedWork& work, int threads, Progress& progress) {
  progress.begin(work.what(), work.tasks(), "tasks");
  work_in_order<Bytes>(
      work.tasks(), threads, [&] { return work.make_worker(); },
      [&](std::size_t task, const Bytes& result) {
        work.add(task, result);
        progress.advance();
        return true;
      });
  progress.end();
}

}  // namespace nadir
