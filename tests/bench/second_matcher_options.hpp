// The options of benches that fly: with a second matcher, or without.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>

#include "base/error.hpp"
#include "base/platform.hpp"
#include "estimation/second_opinion.hpp"
#include "vision/descriptor_matcher.hpp"

namespace nadir::bench {

struct SecondMatcherOptions {
  std::filesystem::path model;
  std::string use = "auto";

  void add_to(CLI::App& app) {
    app.add_option("--matcher-model", model, "ONNX file of a descriptor network: a second matcher");
    app.add_option("--second-matcher", use, "when it looks: auto or always")
        ->check(CLI::IsMember({"auto", "always"}))
        ->capture_default_str();
  }

  // Channels alone where no model is named. Throws Error where the second cannot be used.
  MapMatcherFactory matcher() {
    if (model.empty()) return make_channel_matcher;
    const SecondMatcherCheck check = check_second_matcher({model, std::nullopt}, plugin_folders(), thread_processor_s);
    if (!check.network) throw Error({.what = check.found, .where = model.string()});
    name_ = fmt::format(", second matcher {} {}", use, check.network->name());
    return make_second_opinion(
        {.second =
             [file = model](const MatcherMap& map) {
               // A network answers one call at a time: each thread has its own.
               thread_local const OpenedNetwork own = open_network({file, std::nullopt}, plugin_folders());
               return make_descriptor_matcher(map, own.network);
             },
         .use = second_matcher_use(use).value_or(SecondMatcherUse::automatic)});
  }
  // For the header of results, once matcher() was called: empty without one.
  const std::string& name() const { return name_; }

 private:
  std::string name_;
};

}  // namespace nadir::bench
