// The map, on the map of our pages (base_map.js): tiles coloured by age, what is missing, sectors, corridor and route. In
// metres of the map's plane from its north-west: east is Leaflet's longitude, south its latitude, negative.

const data = JSON.parse(document.getElementById("data").textContent);
const map = data.map;

const groundArea = (m2) => m2 >= 1e6 ? (m2 / 1e6).toFixed(2) + " km²" : Math.round(m2).toLocaleString("en") + " m²";

const stateWords = {
  good: "present and fresh enough", stale: "older than its sector allows", gap: "missing",
  partial: "partly missing", spare: "present, but not required",
};

// Of the page's theme: a canvas knows no variables.
const themeColours = () => {
  const style = getComputedStyle(document.documentElement);
  return (name) => style.getPropertyValue("--" + name).trim();
};

const mixed = (one, other, share) => {
  const parts = (colour) => [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16));
  const [a, b] = [parts(one), parts(other)];
  return "#" + a.map((v, i) => Math.round(v + share * (b[i] - v)).toString(16).padStart(2, "0")).join("");
};

// Colour by the share of the allowed age that is used up; without dates all that is there looks alike.
const colourOf = (cell, colour) => {
  if (cell.state === "spare") return colour("spare");
  if (cell.state === "gap") return colour("card");
  if (cell.state === "stale") return colour("stale");
  if (cell.age == null) return colour("new");
  const used = Math.min(1, Math.max(0, cell.age / cell.limit));
  return used < .5 ? mixed(colour("new"), colour("mid"), 2 * used) : mixed(colour("mid"), colour("old"), 2 * used - 1);
};

const hatchOfGaps = `<pattern id="hatch" width="8" height="8" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">
  <rect width="8" height="8" fill="var(--gap)" fill-opacity=".18"/><rect width="3" height="8" fill="var(--gap)" fill-opacity=".8"/></pattern>`;

const drawMap = (host, onHover) => {
  const colour = themeColours(), metres = map.metres_per_pixel;
  const at = ([x, y]) => [-y * metres, x * metres], line = (points) => points.map(at);
  const square = (x, y, size) => [at([x, y]), at([x + size, y + size])];
  const { map: shown, renderer } = makeBaseMap(host, { crs: L.CRS.Simple, minZoom: -12, maxZoom: 4, attributionControl: false });
  const places = map.cells.flatMap((cell) => square(cell.x, cell.y, map.cell_size)).concat(line(map.route), ...map.sectors.map((s) => line(s.points)));
  const home = L.latLngBounds(places).pad(.04);
  const fit = () => shown.fitBounds(home, { animate: false });
  shown.setView(home.getCenter(), 0);
  host.tabIndex = 0;
  host.setAttribute("role", "application");
  host.setAttribute("aria-label", "Map of coverage and freshness. Arrow keys move it, plus and minus zoom.");

  // Above the tiles, which are drawn as shapes here, and beneath sectors and route.
  if (map.vectors) makeVectorOverlay(shown, { place: at, zIndex: 420 }).show(map.vectors);
  const over = shown.createPane("over");  // lines and hatches: drawn by the style sheet, in both themes
  over.style.zIndex = 450;
  over.style.pointerEvents = "none";
  const drawing = L.svg({ pane: "over", padding: .3 });
  const layer = {};
  for (const name of ["tiles", "matchability", "corridor", "gaps", "sectors", "route", "cursor"]) layer[name] = L.layerGroup().addTo(shown);
  const draw = (group, shape, className) => shape(className).addTo(group);
  const polygon = (points) => (className) => L.polygon(points, { renderer: drawing, interactive: false, className });
  const polyline = (points) => (className) => L.polyline(points, { renderer: drawing, interactive: false, className, fill: false });
  const cased = (group, shape, className) => { draw(group, shape, "casing"); draw(group, shape, className); };

  for (const cell of map.cells) {
    L.rectangle(square(cell.x, cell.y, map.cell_size), { renderer, interactive: false, color: colour("card"), weight: 1, fillColor: colourOf(cell, colour), fillOpacity: 1 }).addTo(layer.tiles);
    if (cell.state === "gap" && map.gaps.length === 0) L.rectangle(square(cell.x, cell.y, map.cell_size), { renderer: drawing, interactive: false, className: "gap-area" }).addTo(layer.gaps);
  }
  for (const rings of map.gaps) draw(layer.gaps, polygon(rings.map(line)), "gap-area");
  drawMatchability(layer, { square, renderer, colour, draw: (points, name) => draw(layer.route, polyline(line(points)), name) });
  const corridor = draw(layer.corridor, polyline(line(map.route)), "corridor");
  for (const sector of map.sectors) {
    cased(layer.sectors, polygon(line(sector.points)), "sector " + sector.class);
    const corner = L.latLngBounds(line(sector.points)).getNorthWest();
    L.marker(corner, { interactive: false, keyboard: false, icon: L.divIcon({ className: "sector-name", html: element("span", {}, sector.id), iconSize: null }) }).addTo(layer.sectors);
  }
  cased(layer.route, polyline(line(map.route)), "route");
  L.circleMarker(at(map.takeoff), { renderer: drawing, interactive: false, radius: 6, className: "takeoff" }).addTo(layer.route);
  drawing.addTo(shown);
  drawing._container.insertAdjacentHTML("afterbegin", `<defs>${hatchOfGaps}</defs>`);
  // The corridor is as wide as it is on the ground.
  const widen = () => corridor.setStyle({ weight: Math.max(1, 2 * map.half_width * metres * shown.getZoomScale(shown.getZoom(), 0)) });
  shown.on("zoomend", widen);

  const all = L.control({ position: "topleft" });
  all.onAdd = () => {
    const bar = element("div", { class: "leaflet-bar" }), button = element("button", { type: "button", title: "show all", "aria-label": "show all" }, "⤢");
    button.addEventListener("click", fit);
    L.DomEvent.disableClickPropagation(bar);
    bar.append(button);
    return bar;
  };
  all.addTo(shown);

  // What lies under the pointer: a place of the matchability while that is shown, a tile otherwise.
  const inside = (x, y, size) => (east, south) => east >= x && east < x + size && south >= y && south < y + size;
  const under = ({ lat, lng }) => {
    const [east, south] = [lng / metres, -lat / metres], grid = map.matchability;
    const place = grid && shown.hasLayer(layer.matchability) && grid.cells.find(([x, y]) => inside(x, y, grid.cell_size)(east, south));
    if (place) return [place, square(place[0], place[1], grid.cell_size)];
    const cell = map.cells.find(({ x, y }) => inside(x, y, map.cell_size)(east, south));
    return [cell, cell && square(cell.x, cell.y, map.cell_size)];
  };
  let last = null;
  shown.on("mousemove click", ({ latlng }) => {
    const [found, box] = under(latlng);
    if (!found || found === last) return;
    last = found;
    layer.cursor.clearLayers();
    L.rectangle(box, { renderer, interactive: false, fill: false, color: colour("ink"), weight: 2.5 }).addTo(layer.cursor);
    onHover(found);
  });

  const names = [["tiles", "mid"], ...(map.matchability ? [["matchability", "match-poor"]] : []), ["gaps", "gap"], ["sectors", "sector"], ["corridor", "route"], ["route", "route"]];
  for (const [name, tint] of names) {
    const box = element("input", { type: "checkbox", checked: "" });
    box.addEventListener("change", () => { if (box.checked) layer[name].addTo(shown); else layer[name].remove(); });
    document.getElementById("layers").append(element("label", {}, box, element("i", { style: `background:var(--${tint})` }), name));
  }
  fit();
  widen();
};
