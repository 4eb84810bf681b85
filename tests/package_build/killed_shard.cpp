// Builds a shard, or merges the shards of a plan, in a process of its own and kills itself at a given moment: at its
// Nth word about its progress.
//
// Usage: killed_shard PLAN I/N THREADS EVENT
//        killed_shard PLAN merge KEY.pem OUT EVENT
//        killed_shard FOLDER work I/N EVENT           of twenty numbered tasks
// EVENT 0: never; the number of events is printed. Exit codes: 0 built; 1 rejected; 2 error, its text on stderr; else
// the signal.
#include <fmt/format.h>

#include <cstdio>
#include <span>
#include <string>
#include <string_view>

#include "base/error.hpp"
#include "package_build/build_shards.hpp"
#include "package_build/die_at.hpp"
#include "package_build/numbered_work.hpp"
#include "package_build/work_shards.hpp"

namespace {

int work(std::span<char*> args) {
  nadir::test::DieAt progress(std::stoi(args.back()));
  bool rejected = false;
  if (args[2] == std::string_view("merge")) {
    const nadir::PrivateKey key = nadir::PrivateKey::read(args[3]);
    nadir::MergeRequest request;
    request.plan_folder = args[1];
    request.plan = nadir::read_shard_plan(args[1], "test");
    request.key = &key;
    request.out = args[4];
    rejected = nadir::merge_shards(request, progress).findings.has_errors();
  } else if (args[2] == std::string_view("work")) {
    nadir::WorkShardRequest request;
    request.work = "numbers";
    request.inputs = "package: a\n";
    request.number = nadir::parse_shard_number(args[3], {});
    request.folder = args[1];
    nadir::do_shard(nadir::test::NumberedWork(20), request, progress);
  } else {
    nadir::ShardRequest request;
    request.plan = args[1];
    request.shard = args[2];
    request.threads = std::stoi(args[3]);
    request.program = "test";
    rejected = nadir::build_shard(request, progress).findings.has_errors();
  }
  fmt::print("{}\n", progress.seen());
  return rejected ? 1 : 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 5) return 64;
  try {
    return work({argv, static_cast<std::size_t>(argc)});
  } catch (const nadir::Error& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 2;
  }
}
