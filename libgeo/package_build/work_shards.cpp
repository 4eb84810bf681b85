#include "package_build/work_shards.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "package_build/build_journal.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

struct TaskSpan {
  std::size_t first = 0, last = 0;

  std::size_t count() const { return last - first; }
};

TaskSpan span_of(std::size_t tasks, ShardNumber number) {
  const auto before = [&](int shard) {
    return static_cast<std::size_t>(std::uint64_t{tasks} * static_cast<std::uint64_t>(shard) /
                                    static_cast<std::uint64_t>(number.shards));
  };
  return {before(number.shard - 1), before(number.shard)};
}

std::string configuration_of(const SharedWork& work, const std::string& inputs, ShardNumber number) {
  const TaskSpan span = span_of(work.tasks(), number);
  return inputs + work.description() +
         fmt::format("shard: {} of {}, tasks {} to {} of {}\n", number.shard, number.shards, span.first, span.last,
                     work.tasks());
}

// A finished shard.
class ShardResults {
 public:
  ShardResults(const SharedWork& work, const std::string& inputs, ShardNumber number, const fs::path& folder)
      : span_(span_of(work.tasks(), number)), file_(folder / kJournalFile), journal_(file_) {
    const std::string expected = configuration_of(work, inputs, number);
    if (journal_.configuration() == expected) return;
    const ConfigurationDifference difference = difference_of(expected, journal_.configuration());
    throw UsageError({.what = "this shard is of other inputs or options",
                      .where = folder.string(),
                      .expected = difference.expected,
                      .found = difference.found,
                      .fix = "remove it and make it again, with the same package and options as the others"});
  }

  // take: false for bytes that are no result of this task.
  void read(const std::function<bool(std::size_t task, ByteView result)>& take) {
    std::size_t task = span_.first;
    while (const auto record = journal_.next()) {
      if (task == span_.last || !take(task, *record)) fail(fmt::format("what is no result of task {}", task));
      ++task;
    }
    if (task != span_.last) fail(std::to_string(task - span_.first));
  }

 private:
  [[noreturn]] void fail(std::string found) const {
    throw Error({.what = "this shard is damaged",
                 .where = file_.string(),
                 .expected = fmt::format("results of {} tasks", span_.count()),
                 .found = std::move(found),
                 .fix = "remove its folder and make it again"});
  }

  TaskSpan span_;
  fs::path file_;
  JournalReader journal_;
};

// Appends to the journal what it lacks. Returns how many results it held.
std::size_t complete(BuildJournal& journal, const SharedWork& work, const WorkShardRequest& request, TaskSpan span,
                     Progress& progress) {
  std::size_t resumed = 0;
  while (journal.next()) {
    if (++resumed <= span.count()) continue;
    throw Error({.what = "the journal of an interrupted shard holds too much",
                 .where = journal.path().string(),
                 .fix = "remove its folder and make it again"});
  }
  progress.begin(work.what(), span.count(), "tasks");
  progress.advance(resumed);
  work_in_order<Bytes>(
      span.count() - resumed, request.threads,
      [&]() -> SharedWork::Worker {
        return [worker = work.make_worker(), first = span.first + resumed](std::size_t item) {
          return worker(first + item);
        };
      },
      [&](std::size_t, const Bytes& result) {
        request.check_inputs();
        journal.add(result);
        progress.advance();
        return true;
      });
  return resumed;
}

}  // namespace

WorkShardReport do_shard(const SharedWork& work, const WorkShardRequest& request, Progress& progress) {
  const auto [shard, shards] = request.number;
  const TaskSpan span = span_of(work.tasks(), request.number);
  WorkShardReport report{.tasks = span.count(),
                         .folder = request.folder / shard_folder_name(request.work, shard, shards)};
  if (fs::exists(fs::symlink_status(report.folder))) {
    report.was_there = true;
    ShardResults(work, request.inputs, request.number, report.folder).read([](auto, auto) { return true; });
    return report;
  }
  StagingDirectory staging(report.folder, StagingDirectory::Leftovers::keep);
  staging.keep(true);  // whatever ends this run, the next one continues it
  if (staging.found_leftovers()) request.on_remark("continuing a shard that was interrupted");
  try {
    const auto journal = open_shard_journal(staging.path(), configuration_of(work, request.inputs, request.number));
    report.resumed = complete(*journal, work, request, span, progress);
  } catch (const OutOfSpace& error) {
    ErrorText text = error.text();
    text.fix = "free space on this disk, then run the same command again: finished work is kept";
    throw OutOfSpace(text);
  }
  progress.advance(0);  // the last point of interruption
  staging.commit();
  progress.end();
  return report;
}

void take_shards(SharedWork& work, std::string_view name, const std::string& inputs,
                 const std::vector<fs::path>& folders, std::string_view build, Progress& progress) {
  const int shards = count_shards(name, folders, build);
  const std::vector<fs::path> found = find_shards(name, shards, folders, build);
  const auto results = [&](int shard) {
    return ShardResults(work, inputs, {shard, shards}, found[static_cast<std::size_t>(shard - 1)]);
  };
  for (int shard = 1; shard <= shards; ++shard) results(shard);  // before the work: is each of these inputs?
  progress.begin("taking shards", work.tasks(), "tasks");
  for (int shard = 1; shard <= shards; ++shard) {
    results(shard).read([&](std::size_t task, ByteView result) {
      progress.advance();
      return work.add(task, result);
    });
  }
  progress.end();
}

}  // namespace nadir
