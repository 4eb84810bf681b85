// Findings where they are: in the list, at their member's input, and on the map. A finding of the document names a path
// ("route.points[2]"); one of a command names tiles or a place in words.

const severityWords = { refuse: "error", warning: "warning", note: "note" };
const severityColours = { refuse: "#b3140c", warning: "#8f4700", note: "#0a58ca" };
const findingText = ({ expected, found, fix }) => [expected && `expected ${expected}`, found && `found ${found}`, fix].filter(Boolean).join("; ");

const tileBounds = (zoom, column, row) => {
  const count = 2 ** zoom, lat = (y) => Math.atan(Math.sinh(Math.PI * (1 - 2 * y / count))) * 180 / Math.PI;
  return [[lat(row + 1), column / count * 360 - 180], [lat(row), (column + 1) / count * 360 - 180]];
};
// "tile 17/70000/45000", "near 14.02,48.79"
const placesInText = (where) => ({
  tile: /(?:^|[^\d/])(\d{1,2})\/(\d+)\/(\d+)(?!\/?\d)/.exec(where)?.slice(1).map(Number) ?? null,
  place: /(?:near|at) (-?\d+\.\d+),(-?\d+\.\d+)/.exec(where)?.slice(1).map(Number) ?? null,
});

const makeFindings = ({ map, renderer, select }) => {
  const layer = L.layerGroup().addTo(map), root = byId("mission");
  // The input, row or part whose path is the longest beginning of the finding's.
  const elementOf = (where) => {
    let best = null;
    for (const candidate of root.querySelectorAll("[data-path], [data-part]")) {
      const path = candidate.dataset.path ?? candidate.dataset.part;
      const fits = where === path || where.startsWith(path + ".") || where.startsWith(path + "[");
      if (fits && (!best || path.length >= (best.dataset.path ?? best.dataset.part).length)) best = candidate;
      if (!best && path.startsWith(where + ".")) best = candidate;
    }
    return best;
  };
  // The point or part of the map: [shape, index of its point or null].
  const shapeOf = (doc, where) => {
    const shape = shapesOf(doc).find((path) => where === path || where.startsWith(path + ".") || where.startsWith(path + "["));
    const index = shape ? /(?:points|polygon|\.m)\[(\d+)\]/.exec(where)?.[1] : undefined;
    return shape ? [shape, index === undefined ? null : Number(index)] : null;
  };
  const mark = (doc, finding) => {
    const colour = severityColours[finding.severity], style = { renderer, interactive: false, color: colour, weight: 4, fill: false };
    const label = element("span", {}, findingText(finding)), { tile, place } = placesInText(finding.where);
    if (tile) L.rectangle(tileBounds(...tile), { ...style, weight: 2, fill: true, fillOpacity: .25, interactive: true }).bindTooltip(label).addTo(layer);
    if (place) L.circleMarker([place[1], place[0]], { ...style, radius: 10, interactive: true }).bindTooltip(label).addTo(layer);
    const at = shapeOf(doc, finding.where);
    if (!at) return;
    const points = pointsOf(doc, at[0]).filter(isPlace), point = at[1] === null ? null : pointsOf(doc, at[0])[at[1]];
    if (isPlace(point)) L.circleMarker([point[1], point[0]], { ...style, radius: 15, dashArray: "4 4" }).addTo(layer);
    else if (points.length > 1) L[at[0] === "route" ? "polyline" : "polygon"](points.map(([lon, lat]) => [lat, lon]), { ...style, weight: 9, opacity: .4 }).addTo(layer);
  };
  const go = (doc, finding, target) => {
    const at = shapeOf(doc, finding.where), { tile, place } = placesInText(finding.where);
    if (at) select(at[0], at[1]);
    if (tile) map.fitBounds(tileBounds(...tile), { animate: false, maxZoom: 17 });
    if (place) map.panTo([place[1], place[0]], { animate: false });
    if (!target) return;
    for (let part = target.closest("details"); part; part = part.parentElement.closest("details")) part.open = true;
    const input = target.matches("input, select") ? target : target.querySelector("input, select, button");
    input?.focus();
    target.scrollIntoView({ block: "center" });
  };
  // ofDocument: by path. ofCommands: of the latest job.
  const show = (doc, ofDocument, ofCommands) => {
    layer.clearLayers();
    for (const message of root.querySelectorAll(".at-member")) message.remove();
    for (const field of root.querySelectorAll("[data-path][aria-invalid]")) { field.removeAttribute("aria-invalid"); field.removeAttribute("aria-describedby"); }
    byId("findings").replaceChildren(...[...ofDocument, ...ofCommands].map((finding, i) => {
      const target = i < ofDocument.length ? elementOf(finding.where) : null;
      mark(doc, finding);
      const line = element("li", { class: finding.severity }), button = element("button", { type: "button", class: "plain" });
      button.append(element("b", {}, `${severityWords[finding.severity]}${finding.where ? `, ${finding.where}` : ""}: `), findingText(finding));
      button.addEventListener("click", () => go(doc, finding, target));
      line.append(button);
      if (target && finding.where) {
        const message = element("span", { class: `at-member ${finding.severity}`, id: `at-member-${i}` }, findingText(finding)), label = target.closest("label");
        if (label) label.append(message);
        else if (target.matches("details")) target.firstElementChild.after(message);
        else target.append(message);
        const input = target.matches("input, select") ? target : target.matches("li.point") ? target.querySelector(`[data-axis=${where0(finding.where)}]`) : null;
        if (input && finding.severity === "refuse") input.setAttribute("aria-invalid", true);
        input?.setAttribute("aria-describedby", message.id);
      }
      return line;
    }));
  };
  const where0 = (where) => (where.endsWith("[1]") ? "lat" : "lon");
  return { show };
};
