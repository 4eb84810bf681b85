// nadir cache inspect: what is in a package, an MBTiles file or a COG, without judging it.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <ostream>
#include <string>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "package/manifest.hpp"
#include "package/tile_container.hpp"
#include "trust/signed_document.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

using nlohmann::json;

// As JSON writes it, without the quotes: what comes from a file must not send escape sequences to the terminal.
std::string text_of(const json& value) {
  const std::string text = value.dump(-1, ' ', false, json::error_handler_t::replace);
  return value.is_string() ? text.substr(1, text.size() - 2) : text;
}

json describe_tile_set(const fs::path& path) {
  const auto container = open_tile_container(path);
  json zooms = json::array();
  std::int64_t count = 0, bytes = 0;
  for (const ZoomSummary& zoom : container->summary()) {
    count += zoom.tiles;
    bytes += zoom.bytes;
    zooms.push_back({{"zoom", zoom.zoom},
                     {"tiles", zoom.tiles},
                     {"bytes", zoom.bytes},
                     {"columns", {zoom.first_column, zoom.last_column}},
                     {"tms_rows", {zoom.first_tms_row, zoom.last_tms_row}}});
  }
  json metadata = json::object();
  for (const auto& [name, value] : container->metadata()) metadata[text_of(name)] = value;
  return {{"kind", container->kind()},
          {"tiles", count},
          {"tile_bytes", bytes},
          {"file_bytes", fs::file_size(path)},
          {"zooms", zooms},
          {"metadata", metadata},
          {"sidecars", container->sidecars() != nullptr}};
}

json describe_package(const fs::path& path) {
  const ManifestReading reading = parse_manifest(read_file(path / kManifestFile, kMaxManifestSize));
  if (!reading.manifest) {
    const Finding& first = reading.findings.items().front();
    throw Error(
        {.what = "cannot read the manifest", .where = first.where, .expected = first.expected, .found = first.found});
  }
  const Manifest& manifest = *reading.manifest;
  json document{{"kind", "package"}, {"verified", false}};
  // The manifest's own bytes are its best description.
  document["manifest"] = json::parse(manifest_json(manifest));
  json signers = json::array();
  if (fs::exists(path / kSignatureFile)) {
    const Envelope envelope =
        parse_envelope(read_text_file(path / kSignatureFile, kMaxEnvelopeSize), (path / kSignatureFile).string());
    for (const EnvelopeSignature& signature : envelope.signatures) signers.push_back(signature.keyid);
  }
  document["signatures"] = signers;
  if (const Artifact* imagery = manifest.artifact(kRoleImagery); imagery != nullptr) {
    document["imagery"] = describe_tile_set(path / imagery->path);
  }
  return document;
}

// One line per leaf: "manifest.mission.id  fengyuan-a".
void flatten(const json& value, const std::string& key, Figures& figures) {
  if (value.is_object() && !value.empty()) {
    for (const auto& [name, item] : value.items()) flatten(item, key.empty() ? name : key + "." + name, figures);
  } else if (value.is_array() && !value.empty() && value[0].is_structured()) {
    for (std::size_t i = 0; i < value.size(); ++i) flatten(value[i], fmt::format("{}.{}", key, i), figures);
  } else {
    figures.emplace_back(key, text_of(value));
  }
}

const json& pick(const json& document, const std::string& key) {
  std::string pointer = "/" + key;
  for (char& c : pointer) {
    if (c == '.') c = '/';
  }
  const json::json_pointer at(pointer);
  if (!document.contains(at)) {
    throw UsageError({.what = "no such entry",
                      .where = "--get " + key,
                      .expected = "one of the entries that `nadir cache inspect` lists"});
  }
  return document.at(at);
}

class CacheInspectCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "inspect"; }
  std::string_view summary() const override { return "show the contents of a package, an MBTiles file or a COG"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path subject_;
  std::optional<std::string> get_;
};

std::string_view CacheInspectCommand::details() const {
  return R"(Shows, but does not check: run `nadir cache verify` before you fly. --get prints a single entry.)";
}

std::string_view CacheInspectCommand::examples() const {
  return R"(nadir cache inspect package
nadir cache inspect package --get manifest.mission.sequence
nadir cache inspect base.mbtiles --json)";
}

void CacheInspectCommand::setup(Options& options) {
  options.positional("PACKAGE|FILE", subject_, "package, MBTiles, COG or PMTiles file").required();
  options.value("--get", get_, "KEY", "print only this entry");
}

int CacheInspectCommand::run(Context& context) {
  if (!fs::exists(subject_)) throw UsageError({.what = "no such file or folder", .where = subject_});
  const json document = fs::is_directory(subject_) ? describe_package(subject_) : describe_tile_set(subject_);
  if (get_) {
    const json& value = pick(document, *get_);
    if (context.json) {
      print_json(context.out, value);
    } else {
      context.out << printable(text_of(value)) << '\n';
    }
    return kAccepted;
  }
  if (context.json) {
    print_json(context.out, document);
  } else {
    Figures figures;
    flatten(document, "", figures);
    print_figures(context.out, figures);
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_cache_inspect() { return std::make_unique<CacheInspectCommand>(); }

}  // namespace nadir
