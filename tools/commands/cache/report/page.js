// Puts the page together.

const byId = (id) => document.getElementById(id);
byId("title").textContent = data.title;
byId("subtitle").textContent = data.subtitle;
byId("footer").textContent = data.generator + ". Self-contained: nothing is loaded from a network.";

const count = (severity) => data.findings.filter((finding) => finding.severity === severity).length;
const plural = (n, word) => n + " " + word + (n === 1 ? "" : "s");
const headline = (value, unit, label, mood = "") => byId("headline").append(
  element("div", { class: "tile " + mood }, element("b", {}, value, element("small", {}, unit)), element("span", {}, label)));

headline(data.accepted ? "accepted" : "rejected", "", plural(count("refuse"), "error") + ", " + plural(count("warning"), "warning"), data.accepted ? "good" : "bad");
if (map) {
  const missing = map.needed_m2 > 0 ? map.gap_m2 / map.needed_m2 : 0;
  const share = 100 * (1 - missing);
  headline(missing === 0 ? "100" : (Math.min(99.99, share)).toFixed(share > 99 ? 2 : 1), "%", "of the required area is covered", missing === 0 ? "good" : "bad");
  headline(groundArea(map.needed_m2).split(" ")[0], groundArea(map.needed_m2).split(" ")[1], "required by sectors and corridor");
  const needed = map.cells.filter((cell) => cell.state !== "spare" && cell.age != null);
  if (needed.length) {
    const oldest = needed.reduce((a, b) => (b.age / b.limit > a.age / a.limit ? b : a));
    headline(String(oldest.age), "days", "old, of " + oldest.limit + " allowed: the tile closest to its limit", oldest.age > oldest.limit ? "bad" : "good");
  }
}

const showCell = (cell) => {
  if (Array.isArray(cell)) return showPlace(cell);
  const rows = [["state", stateWords[cell.state]], ["captured", cell.captured], ["age", cell.age == null ? null : plural(cell.age, "day")],
    ["allowed", cell.limit == null ? null : plural(cell.limit, "day")], ["resolution", cell.gsd_mm == null ? null : (cell.gsd_mm / 1000).toFixed(2) + " m"],
    ["accuracy", cell.ce90_mm == null ? null : (cell.ce90_mm / 1000).toFixed(1) + " m (CE90)"], ["source", cell.source],
    ["valid pixels", cell.valid == null ? null : cell.valid + " %"], ["missing", cell.gap_m2 == null ? null : groundArea(cell.gap_m2)],
    ["tiles", cell.tiles]];
  const list = element("dl");
  for (const [name, value] of rows) if (value != null) list.append(element("dt", {}, name), element("dd", {}, String(value)));
  byId("readout").replaceChildren(element("div", { class: "name" }, "Tile " + cell.tile), list,
    element("p", { class: "keys" }, "Point at a tile for details. Drag to pan, scroll to zoom."));
};

if (map) {
  drawMap(byId("map"), showCell);
  const worst = ["gap", "partial", "stale", "good", "spare"].map((state) => map.cells.find((cell) => cell.state === state)).find((cell) => cell);
  if (worst) showCell(worst);
  const entry = (style, text, cls = "") => byId("legend").append(element("span", {}, element("i", { style, class: cls }), text));
  if (map.dated) {
    entry("", "new … as old as allowed", "ramp");
    entry("background:var(--stale)", "too old");
  } else {
    entry("background:var(--new)", "present (capture time unknown)");
  }
  entry("", "missing", "hatch");
  entry("background:var(--spare)", "not required");
  if (map.zoom !== map.finest) byId("legend").append(element("span", {}, "shown at zoom " + map.zoom + ": each square shows its worst tile"));
  byId("sectors").append(element("tr", {}, ...[["sector", ""], ["class", ""], ["area", "n"], ["maximum age", "n"]].map(([text, cls]) => element("th", { class: cls }, text))));
  for (const sector of map.sectors)
    byId("sectors").append(element("tr", {}, element("td", {}, sector.id), element("td", {}, sector.class), element("td", { class: "n" }, sector.km2 + " km²"),
      element("td", { class: "n" }, sector.limit + " days")));
}
tellMatchability(headline);
if (!map || map.sectors.length === 0) byId("sectors-card").remove();
if (!map) byId("map-part").remove();

const order = { refuse: 0, warning: 1, note: 2 };
const severityWords = { refuse: "error" };
for (const finding of [...data.findings].sort((a, b) => order[a.severity] - order[b.severity])) {
  const box = element("div", { class: "finding " + finding.severity }, element("b", {}, finding.code, element("i", {}, severityWords[finding.severity] || finding.severity)));
  for (const field of ["where", "expected", "found", "fix"])
    if (finding[field]) box.append(element("span", {}, field === "fix" ? "what to do" : field), element("p", {}, finding[field]));
  byId("findings").append(box);
}
if (data.findings.length === 0) byId("findings").append(element("p", { class: "note" }, "No findings."));
for (const { name, value } of data.figures)
  byId("figures").append(element("div", {}, element("span", {}, name), element("span", {}, value)));
byId("figures").append(element("div", {}, element("span", {}, "evaluated as of"), element("span", {}, data.judged_at)));
