#include "catalogue/qgis_project.hpp"

#include <cpl_conv.h>
#include <cpl_minixml.h>
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "base/error.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr const char* kVersion = "3.22.0";  // of QGIS, whose XML this is
constexpr const char* kStyleName = "nadir";

enum class Shape { area, line };

// Features that meet the filter are drawn with one symbol; colours are "red,green,blue,opacity".
struct Rule {
  const char* filter;  // QGIS's expression; empty: all
  const char* label;   // in the legend
  const char* fill;    // of areas
  const char* fill_style;
  const char* outline;
  double width_mm;
  const char* outline_style;
};

struct LayerDesign {
  QgisStyles of;
  const char* group;
  const char* name;
  const char* view;
  const char* filter;  // SQL
  Shape shape;
  bool shown;
  const char* label;         // QGIS's expression
  double label_below_scale;  // 1 : so much and closer; 0: at any scale
  std::vector<Rule> rules;
};

constexpr const char* kCurrent = R"("current" = 1)";
constexpr const char* kSeriesSequence = R"("series" || ' ' || "sequence")";

// Colours differ in lightness as well, so that they are distinguishable without seeing red or green.
std::vector<Rule> age_rules() {
  const char* const age = R"(day(age(now(), to_datetime("captured_at"))))";
  static const std::string recent = fmt::format("{} <= 90", age), year = fmt::format("{0} > 90 AND {0} <= 365", age),
                           years = fmt::format("{0} > 365 AND {0} <= 1095", age), old = fmt::format("{} > 1095", age);
  return {{recent.c_str(), "up to 90 days", "0,104,55,110", "solid", "0,104,55,255", 0.2, "solid"},
          {year.c_str(), "up to a year", "120,198,121,110", "solid", "65,140,70,255", 0.2, "solid"},
          {years.c_str(), "up to three years", "254,217,118,110", "solid", "190,150,50,255", 0.2, "solid"},
          {old.c_str(), "older", "189,0,38,90", "solid", "189,0,38,255", 0.2, "solid"}};
}

// From top to bottom, as in QGIS's list of layers.
std::vector<LayerDesign> layer_designs() {
  using enum QgisStyles;
  constexpr const char* kNone = "0,0,0,0";
  return {
      {candidates,
       "Candidates",
       "Promoted tiles",
       "promotion_states",
       kCurrent,
       Shape::area,
       true,
       R"("flights" || ' flights')",
       20'000,
       {{"", "promoted", "49,130,189,90", "solid", "8,81,156,255", 0.5, "solid"}}},
      {candidates,
       "Candidates",
       "Candidate tiles",
       "tile_states",
       "",
       Shape::area,
       true,
       R"(coalesce("code", "state"))",
       10'000,
       {{R"("state" = 'accepted')", "accepted", "158,202,225,80", "solid", "66,146,198,255", 0.3, "solid"},
        {R"("state" = 'announced')", "announced", kNone, "no", "66,146,198,255", 0.3, "dash"},
        {R"("state" = 'duplicate')", "duplicate", kNone, "no", "115,115,115,255", 0.3, "dot"},
        {R"("state" = 'rejected')", "rejected", "203,24,29,160", "b_diagonal", "203,24,29,255", 0.3, "solid"}}},
      {packages,
       "Gaps",
       "Gaps",
       "gap_states",
       kCurrent,
       Shape::area,
       true,
       R"(coalesce("series" || ' ' || "sequence", "mission") || ': ' || "reason")",
       25'000,
       {{R"("reason" IN ('no imagery', 'no tile'))", "no imagery", "165,15,21,150", "solid", "165,15,21,255", 0.3,
         "solid"},
        {R"("reason" = 'empty pixels')", "empty pixels", "239,59,44,150", "solid", "165,15,21,255", 0.3, "solid"},
        {R"("reason" = 'coarse imagery')", "coarse imagery", "106,81,163,255", "b_diagonal", "106,81,163,255", 0.3,
         "solid"},
        {R"("reason" = 'stale imagery')", "stale imagery", "153,52,4,255", "f_diagonal", "153,52,4,255", 0.3,
         "solid"}}},
      {packages,
       "Missions",
       "Routes",
       "route_states",
       kCurrent,
       Shape::line,
       true,
       "",
       0,
       {{"", "route", "", "", "35,35,35,255", 0.6, "solid"}}},
      {packages,
       "Missions",
       "Sectors",
       "sector_states",
       kCurrent,
       Shape::area,
       true,
       R"("sector" || ' (' || "class" || ')')",
       50'000,
       {{R"("class" = 'active')", "active", kNone, "no", "217,95,14,255", 0.5, "dash"},
        {R"("class" <> 'active')", "stable", kNone, "no", "84,39,143,255", 0.4, "dash"}}},
      {packages,
       "Missions",
       "Corridors",
       "corridor_states",
       kCurrent,
       Shape::area,
       false,
       "",
       0,
       {{"", "corridor", kNone, "no", "82,82,82,255", 0.3, "dot"}}},
      {packages,
       "Packages",
       "Packages",
       "package_states",
       kCurrent,
       Shape::area,
       true,
       kSeriesSequence,
       0,
       {{R"(to_datetime("expires") >= now())", "valid", kNone, "no", "8,48,107,255", 0.7, "solid"},
        {R"(to_datetime("expires") < now())", "expired", kNone, "no", "203,24,29,255", 0.7, "dash"}}},
      {packages,
       "Packages",
       "Earlier versions",
       "package_states",
       R"("current" = 0)",
       Shape::area,
       false,
       kSeriesSequence,
       0,
       {{"", "superseded", kNone, "no", "115,115,115,255", 0.4, "dot"}}},
      {packages, "Imagery", "Coverage by age", "source_states", kCurrent, Shape::area, true,
       R"("provider" || ', ' || format_date(to_datetime("captured_at"), 'yyyy-MM') || ', ' || "gsd_m" || ' m')",
       100'000, age_rules()},
      {packages, "Imagery", "Tiles by age", "finest_tiles", kCurrent, Shape::area, false,
       R"("z" || '/' || "x" || '/' || "y")", 10'000, age_rules()},
  };
}

// ---- XML

struct DestroyXml {
  void operator()(CPLXMLNode* node) const { CPLDestroyXMLNode(node); }
};
using XmlDocument = std::unique_ptr<CPLXMLNode, DestroyXml>;
using Attributes = std::vector<std::pair<const char*, std::string>>;

CPLXMLNode* add(CPLXMLNode* parent, const char* name, const Attributes& attributes = {}) {
  CPLXMLNode* node = CPLCreateXMLNode(parent, CXT_Element, name);
  for (const auto& [key, value] : attributes) CPLAddXMLAttributeAndValue(node, key, value.c_str());
  return node;
}

void add_text(CPLXMLNode* parent, const char* name, const std::string& text) {
  CPLCreateXMLElementAndValue(parent, name, text.c_str());
}

std::string serialized(const CPLXMLNode* node) {
  const std::unique_ptr<char, decltype(&VSIFree)> text(CPLSerializeXMLTree(node), &VSIFree);
  return text.get();
}

void add_symbol(CPLXMLNode* symbols, const Rule& rule, Shape shape, std::size_t number) {
  const bool area = shape == Shape::area;
  CPLXMLNode* symbol = add(symbols, "symbol",
                           {{"type", area ? "fill" : "line"},
                            {"name", std::to_string(number)},
                            {"alpha", "1"},
                            {"clip_to_extent", "1"},
                            {"force_rhr", "0"}});
  CPLXMLNode* layer =
      add(symbol, "layer",
          {{"class", area ? "SimpleFill" : "SimpleLine"}, {"enabled", "1"}, {"locked", "0"}, {"pass", "0"}});
  const std::string width = fmt::format("{}", rule.width_mm);
  const Attributes options = area ? Attributes{{"color", rule.fill},
                                               {"style", rule.fill_style},
                                               {"outline_color", rule.outline},
                                               {"outline_style", rule.outline_style},
                                               {"outline_width", width},
                                               {"outline_width_unit", "MM"}}
                                  : Attributes{{"line_color", rule.outline},
                                               {"line_style", rule.outline_style},
                                               {"line_width", width},
                                               {"line_width_unit", "MM"}};
  CPLXMLNode* map = add(layer, "Option", {{"type", "Map"}});
  for (const auto& [name, value] : options) add(map, "Option", {{"type", "QString"}, {"name", name}, {"value", value}});
}

void add_renderer(CPLXMLNode* parent, const LayerDesign& design) {
  CPLXMLNode* renderer =
      add(parent, "renderer-v2",
          {{"type", "RuleRenderer"}, {"symbollevels", "0"}, {"forceraster", "0"}, {"enableorderby", "0"}});
  CPLXMLNode* rules = add(renderer, "rules", {{"key", "all"}});
  CPLXMLNode* symbols = add(renderer, "symbols");
  for (std::size_t i = 0; i < design.rules.size(); ++i) {
    const Rule& rule = design.rules[i];
    CPLXMLNode* node =
        add(rules, "rule", {{"key", fmt::format("rule{}", i)}, {"symbol", std::to_string(i)}, {"label", rule.label}});
    if (*rule.filter != '\0') CPLAddXMLAttributeAndValue(node, "filter", rule.filter);
    add_symbol(symbols, rule, design.shape, i);
  }
}

void add_labels(CPLXMLNode* parent, const LayerDesign& design) {
  if (*design.label == '\0') return;
  CPLXMLNode* settings = add(add(parent, "labeling", {{"type", "simple"}}), "settings", {{"calloutType", "simple"}});
  CPLXMLNode* style = add(settings, "text-style",
                          {{"fieldName", design.label},
                           {"isExpression", "1"},
                           {"fontFamily", "Sans"},
                           {"fontSize", "9"},
                           {"fontSizeUnit", "Point"},
                           {"textColor", "20,20,20,255"},
                           {"textOpacity", "1"}});
  add(style, "text-buffer",
      {{"bufferDraw", "1"},
       {"bufferSize", "0.8"},
       {"bufferSizeUnits", "MM"},
       {"bufferColor", "255,255,255,255"},
       {"bufferOpacity", "0.85"}});
  constexpr const char* kHorizontal = "4";  // within the area
  add(settings, "placement", {{"placement", kHorizontal}, {"priority", "5"}});
  const bool limited = design.label_below_scale > 0;
  add(settings, "rendering",
      {{"drawLabels", "1"},
       {"scaleVisibility", limited ? "1" : "0"},
       {"scaleMin", "0"},
       {"scaleMax", fmt::format("{:.0f}", design.label_below_scale)}});
}

const char* labels_enabled(const LayerDesign& design) { return *design.label == '\0' ? "0" : "1"; }

std::string style_qml(const LayerDesign& design) {
  const XmlDocument root(CPLCreateXMLNode(nullptr, CXT_Element, "qgis"));
  CPLAddXMLAttributeAndValue(root.get(), "version", kVersion);
  CPLAddXMLAttributeAndValue(root.get(), "styleCategories", "Symbology|Labeling");
  CPLAddXMLAttributeAndValue(root.get(), "labelsEnabled", labels_enabled(design));
  add_renderer(root.get(), design);
  add_labels(root.get(), design);
  return serialized(root.get());
}

// ---- the project

// "." and a path with / on every system; ' is doubled within quotes.
std::string file_name_for(const CatalogueLocation& location, const fs::path& folder) {
  std::string path = fs::relative(fs::absolute(location.name), fs::absolute(folder)).generic_string();
  if (!path.starts_with("../")) path = "./" + path;
  for (std::size_t at = path.find('\''); at != std::string::npos; at = path.find('\'', at + 2)) path.insert(at, "\\");
  return path;
}

std::string source_of(const LayerDesign& design, const QgisProject& project) {
  const bool candidates = design.of == QgisStyles::candidates;
  const CatalogueLocation& location = candidates ? *project.candidates : project.packages;
  std::string source;
  if (location.kind == CatalogueLocation::Kind::file) {
    source = fmt::format(R"(dbname='{}' table="{}" (geom))", file_name_for(location, project.folder), design.view);
  } else {
    if (!location.name.starts_with("PG:")) {
      throw UsageError({.what = "QGIS takes a database's address as a connection string only",
                        .where = location.shown,
                        .expected = "\"PG:dbname=… host=… user=…\""});
    }
    source = fmt::format(R"({} key='id' srid=4326 type={} table="{}"."{}" (geom))", location.name.substr(3),
                         design.shape == Shape::line ? "LineString" : "Polygon",
                         candidates ? "nadir_candidates" : "nadir", design.view);
  }
  if (*design.filter != '\0') source += fmt::format(" sql={}", design.filter);
  return source;
}

const char* provider_of(const LayerDesign& design, const QgisProject& project) {
  const CatalogueLocation& location = design.of == QgisStyles::candidates ? *project.candidates : project.packages;
  return location.kind == CatalogueLocation::Kind::file ? "spatialite" : "postgres";
}

// srsid: QGIS's own number of it, without which it does not look at the authid.
struct ReferenceSystem {
  int epsg, srsid;
};
constexpr ReferenceSystem kWgs84{4326, 3452}, kWebMercator{3857, 3857};

void add_reference_system(CPLXMLNode* parent, const char* name, const ReferenceSystem& system) {
  CPLXMLNode* node = add(add(parent, name), "spatialrefsys");
  add_text(node, "srsid", std::to_string(system.srsid));
  add_text(node, "srid", std::to_string(system.epsg));
  add_text(node, "authid", fmt::format("EPSG:{}", system.epsg));
}

void add_layer(CPLXMLNode* layers, const LayerDesign& design, const std::string& id, const QgisProject& project) {
  CPLXMLNode* layer = add(layers, "maplayer",
                          {{"type", "vector"},
                           {"geometry", design.shape == Shape::area ? "Polygon" : "Line"},
                           {"labelsEnabled", labels_enabled(design)},
                           {"readOnly", "1"}});
  add_text(layer, "id", id);
  add_text(layer, "datasource", source_of(design, project));
  add_text(layer, "layername", design.name);
  add_reference_system(layer, "srs", kWgs84);
  CPLXMLNode* provider = add(layer, "provider", {{"encoding", "UTF-8"}});
  CPLCreateXMLNode(provider, CXT_Text, provider_of(design, project));
  add_renderer(layer, design);
  add_labels(layer, design);
}

void add_property(CPLXMLNode* properties, const char* group, const char* name, const char* type, const char* value) {
  CPLXMLNode* node = add(add(properties, group), name, {{"type", type}});
  CPLCreateXMLNode(node, CXT_Text, value);
}

// The box with a margin of a tenth, in Web Mercator.
void add_extent(CPLXMLNode* canvas, const std::optional<LonLatBox>& box) {
  MercatorXY low{-kMercatorHalfWorld_m, -kMercatorHalfWorld_m}, high{kMercatorHalfWorld_m, kMercatorHalfWorld_m};
  if (box) {
    low = mercator_from_lonlat({box->west_deg, box->south_deg});
    high = mercator_from_lonlat({box->east_deg, box->north_deg});
    const double margin_m = 0.1 * std::max({high.x_m - low.x_m, high.y_m - low.y_m, 100.0});
    low = {low.x_m - margin_m, low.y_m - margin_m};
    high = {high.x_m + margin_m, high.y_m + margin_m};
  }
  CPLXMLNode* extent = add(canvas, "extent");
  add_text(extent, "xmin", fmt::format("{:.1f}", low.x_m));
  add_text(extent, "ymin", fmt::format("{:.1f}", low.y_m));
  add_text(extent, "xmax", fmt::format("{:.1f}", high.x_m));
  add_text(extent, "ymax", fmt::format("{:.1f}", high.y_m));
}

}  // namespace

std::string qgis_project_xml(const QgisProject& project) {
  const XmlDocument root(CPLCreateXMLNode(nullptr, CXT_Element, "qgis"));
  CPLAddXMLAttributeAndValue(root.get(), "projectname", "Nadir catalogue");
  CPLAddXMLAttributeAndValue(root.get(), "version", kVersion);
  add_text(root.get(), "title", "Nadir catalogue");
  add_reference_system(root.get(), "projectCrs", kWebMercator);
  CPLXMLNode* tree = add(root.get(), "layer-tree-group");
  CPLXMLNode* canvas = add(root.get(), "mapcanvas", {{"name", "theMapCanvas"}});
  add_text(canvas, "units", "meters");
  add_extent(canvas, project.extent);
  add_reference_system(canvas, "destinationsrs", kWebMercator);
  CPLXMLNode* layers = add(root.get(), "projectlayers");
  CPLXMLNode* group = nullptr;
  std::string group_name;
  for (const LayerDesign& design : layer_designs()) {
    if (design.of == QgisStyles::candidates && !project.candidates) continue;
    if (group == nullptr || group_name != design.group) {
      group_name = design.group;
      group = add(tree, "layer-tree-group", {{"name", group_name}, {"checked", "Qt::Checked"}, {"expanded", "1"}});
    }
    std::string id = fmt::format("nadir_layer_{}", design.name);  // QGIS replaces ids of ten letters and fewer
    std::replace(id.begin(), id.end(), ' ', '_');
    add(group, "layer-tree-layer",
        {{"id", id},
         {"name", design.name},
         {"checked", design.shown ? "Qt::Checked" : "Qt::Unchecked"},
         {"expanded", design.shown ? "1" : "0"},
         {"providerKey", provider_of(design, project)},
         {"source", source_of(design, project)}});
    add_layer(layers, design, id, project);
  }
  CPLXMLNode* properties = add(root.get(), "properties");
  add_property(properties, "Paths", "Absolute", "bool", "false");
  add_property(properties, "SpatialRefSys", "ProjectionsEnabled", "int", "1");  // else projectCrs is not read
  return "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n" + serialized(root.get());
}

std::optional<LonLatBox> qgis_extent(CatalogueDatabase& catalogue) {
  std::optional<LonLatBox> box;
  const auto include = [&box](const CatalogueRow& row) {
    for (const GeoPolygon& polygon : row.area()) {
      for (const LonLat& place : polygon.front()) {
        if (!box) box = LonLatBox{place.lon_deg, place.lat_deg, place.lon_deg, place.lat_deg};
        box->west_deg = std::min(box->west_deg, place.lon_deg);
        box->east_deg = std::max(box->east_deg, place.lon_deg);
        box->south_deg = std::min(box->south_deg, place.lat_deg);
        box->north_deg = std::max(box->north_deg, place.lat_deg);
      }
    }
  };
  catalogue.each("packages", include);
  catalogue.select(fmt::format("SELECT * FROM {} WHERE package_id IS NULL", catalogue.of("gaps")), include);
  return box;
}

void store_qgis_styles(CatalogueDatabase& catalogue, const CatalogueLocation& location, QgisStyles styles) {
  const bool postgres = location.kind == CatalogueLocation::Kind::postgres;
  const char* const schema = !postgres ? "" : styles == QgisStyles::candidates ? "nadir_candidates" : "nadir";
  const char* const doing = "storing the styles";
  catalogue.begin();
  // The columns and types that QGIS gives this table.
  catalogue.change(
      fmt::format(
          "CREATE TABLE IF NOT EXISTS layer_styles (id {}, f_table_catalog varchar(256), f_table_schema varchar(256), "
          "f_table_name varchar(256), f_geometry_column varchar(256), styleName text, styleQML {}, styleSLD {}, "
          "useAsDefault boolean, description text, owner varchar(63), ui {}, update_time timestamp DEFAULT "
          "CURRENT_TIMESTAMP)",
          postgres ? "SERIAL PRIMARY KEY" : "INTEGER PRIMARY KEY AUTOINCREMENT", postgres ? "xml" : "text",
          postgres ? "xml" : "text", postgres ? "xml" : "text"),
      doing);
  for (const LayerDesign& design : layer_designs()) {
    // Of a view with two layers the first one, of what is current, is the default.
    if (design.of != styles || std::string_view(design.filter) == R"("current" = 0)") continue;
    std::string qml = style_qml(design);
    for (std::size_t at = qml.find('\''); at != std::string::npos; at = qml.find('\'', at + 2)) qml.insert(at, "'");
    catalogue.change(
        fmt::format("DELETE FROM layer_styles WHERE f_table_schema = '{}' AND f_table_name = '{}' AND styleName = '{}'",
                    schema, design.view, kStyleName),
        doing);
    catalogue.change(
        fmt::format(
            "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, styleName, "
            "styleQML, useAsDefault, description, owner) VALUES ({}, '{}', '{}', 'geom', '{}', {}'{}'{}, {}, '{}', '')",
            postgres ? "current_database()" : "''", schema, design.view, kStyleName,
            postgres ? "XMLPARSE(DOCUMENT " : "", qml, postgres ? ")" : "", postgres ? "true" : "1", design.name),
        doing);
  }
  catalogue.commit();
}

}  // namespace nadir
