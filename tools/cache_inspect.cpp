#include "cache_inspect.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "framework/options.hpp"
#include "framework/output.hpp"
#include "imagery/sqlite_database.hpp"
#include "package/manifest.hpp"
#include "trust/dsse.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

// As JSON writes it, without the quotes: what comes from a file must not send escape sequences to the terminal.
std::string text_of(const json& value) {
  const std::string text = value.dump(-1, ' ', false, json::error_handler_t::replace);
  return value.is_string() ? text.substr(1, text.size() - 2) : text;
}

json describe_mbtiles(const fs::path& path) {
  const SqliteDatabase database = SqliteDatabase::open_immutable(path);
  if (!database.has_table("tiles")) {
    throw Error({.what = "no MBTiles file: the table \"tiles\" is missing", .where = path});
  }
  json zooms = json::array();
  std::int64_t count = 0, bytes = 0;
  auto rows = database.prepare(
      "SELECT zoom_level, count(*), sum(length(tile_data)), min(tile_column), max(tile_column), min(tile_row),"
      " max(tile_row) FROM tiles GROUP BY zoom_level ORDER BY zoom_level");
  while (rows.step()) {
    count += rows.integer(1);
    bytes += rows.integer(2);
    zooms.push_back({{"zoom", rows.integer(0)},
                     {"tiles", rows.integer(1)},
                     {"bytes", rows.integer(2)},
                     {"columns", {rows.integer(3), rows.integer(4)}},
                     {"tms_rows", {rows.integer(5), rows.integer(6)}}});
  }
  json metadata = json::object();
  if (database.has_table("metadata")) {
    auto entries = database.prepare("SELECT name, value FROM metadata");
    while (entries.step()) metadata[text_of(std::string(entries.text(0)))] = std::string(entries.text(1));
  }
  return {{"kind", "mbtiles"},
          {"tiles", count},
          {"tile_bytes", bytes},
          {"file_bytes", fs::file_size(path)},
          {"zooms", zooms},
          {"metadata", metadata},
          {"sidecars", database.has_table("nadir_sidecars")}};
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
    document["imagery"] = describe_mbtiles(path / imagery->path);
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
    throw UsageError({.what = "there is no such entry",
                      .where = "--get " + key,
                      .expected = "one of the entries that `nadir cache inspect` lists"});
  }
  return document.at(at);
}

}  // namespace

std::string_view CacheInspectCommand::details() const {
  return "Shows, but does not judge: use `nadir cache verify` before you fly. --get prints one entry alone.";
}

std::string_view CacheInspectCommand::examples() const {
  return "nadir cache inspect package\n"
         "nadir cache inspect package --get manifest.mission.sequence\n"
         "nadir cache inspect base.mbtiles --json";
}

void CacheInspectCommand::setup(Options& options) {
  options.positional("PACKAGE|FILE.mbtiles", subject_, "what to look at").required();
  options.value("--get", get_, "KEY", "print this entry alone");
}

int CacheInspectCommand::run(Context& context) {
  if (!fs::exists(subject_)) throw UsageError({.what = "nothing of this name", .where = subject_});
  const json document = fs::is_directory(subject_) ? describe_package(subject_) : describe_mbtiles(subject_);
  if (get_) {
    const json& value = pick(document, *get_);
    if (context.json) {
      print_json(context.out, value);
    } else {
      context.out << text_of(value) << '\n';
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

}  // namespace nadir
