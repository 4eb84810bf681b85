// The map: tiles coloured by age, what is missing, sectors, corridor and route; pan and zoom.

const data = JSON.parse(document.getElementById("data").textContent);
const map = data.map;

const groundArea = (m2) => m2 >= 1e6 ? (m2 / 1e6).toFixed(2) + " km²" : Math.round(m2).toLocaleString("en") + " m²";

// Colour by the share of the allowed age that is used up; without dates all that is there looks alike.
const colourOf = (cell) => {
  if (cell.state === "spare") return "var(--spare)";
  if (cell.state === "gap") return "var(--card)";
  if (cell.state === "stale") return "var(--stale)";
  if (cell.age == null) return "var(--new)";
  const used = Math.min(1, Math.max(0, cell.age / cell.limit));
  return used < .5 ? `color-mix(in srgb, var(--mid) ${200 * used}%, var(--new))`
                   : `color-mix(in srgb, var(--old) ${200 * used - 100}%, var(--mid))`;
};
const stateWords = {
  good: "present and fresh enough", stale: "older than its sector allows", gap: "missing",
  partial: "partly missing", spare: "present, but not required",
};

const drawMap = (host, onHover) => {
  const size = map.cell_size;
  const points = map.cells.flatMap((cell) => [[cell.x, cell.y], [cell.x + size, cell.y + size]]).concat(map.route, ...map.sectors.map((s) => s.points));
  const xs = points.map((p) => p[0]), ys = points.map((p) => p[1]);
  const low = (list) => list.reduce((a, b) => Math.min(a, b), Infinity), high = (list) => list.reduce((a, b) => Math.max(a, b), -Infinity);
  const pad = 0.04 * Math.max(high(xs) - low(xs), high(ys) - low(ys));
  const home = { x: low(xs) - pad, y: low(ys) - pad, w: high(xs) - low(xs) + 2 * pad, h: high(ys) - low(ys) + 2 * pad };
  let view = { ...home };

  const svg = svgElement("svg", { role: "img", "aria-label": "Map of coverage and freshness" });
  const defs = svgElement("defs");
  const hatch = svgElement("pattern", { id: "hatch", width: 8, height: 8, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" });
  hatch.append(svgElement("rect", { width: 8, height: 8, fill: "var(--gap)", "fill-opacity": .18 }), svgElement("rect", { width: 3, height: 8, fill: "var(--gap)", "fill-opacity": .8 }));
  defs.append(hatch);
  svg.append(defs);
  const layer = {};
  for (const name of ["tiles", "matchability", "corridor", "gaps", "sectors", "route"]) svg.append(layer[name] = svgElement("g"));

  const path = (list, closed) => list.map((p, i) => (i ? "L" : "M") + p[0] + " " + p[1]).join("") + (closed ? "Z" : "");
  for (const cell of map.cells) {
    const rect = svgElement("rect", { x: cell.x, y: cell.y, width: size, height: size, class: "cell", fill: colourOf(cell) });
    rect.addEventListener("pointerenter", () => {
      layer.tiles.querySelector(".selected")?.classList.remove("selected");
      rect.classList.add("selected");
      layer.tiles.append(rect);
      onHover(cell);
    });
    layer.tiles.append(rect);
    if (cell.state === "gap" && map.gaps.length === 0) layer.gaps.append(svgElement("path", { d: `M${cell.x} ${cell.y}h${size}v${size}h${-size}Z`, class: "gap-area" }));
  }
  for (const rings of map.gaps) layer.gaps.append(svgElement("path", { d: rings.map((ring) => path(ring, true)).join(""), class: "gap-area" }));
  drawMatchability(layer, path, onHover);
  layer.corridor.append(svgElement("path", { d: path(map.route), class: "corridor", "stroke-width": 2 * map.half_width }));
  for (const sector of map.sectors) {
    layer.sectors.append(svgElement("path", { d: path(sector.points, true), class: "casing" }), svgElement("path", { d: path(sector.points, true), class: "sector " + sector.class }));
  }
  const names = map.sectors.map((sector) => {
    const west = low(sector.points.map((p) => p[0])), north = low(sector.points.map((p) => p[1]));
    const label = svgElement("text", { class: "name", x: west, y: north }, sector.id);
    layer.sectors.append(label);
    return label;
  });
  layer.route.append(svgElement("path", { d: path(map.route), class: "casing" }), svgElement("path", { d: path(map.route), class: "route" }));
  const start = svgElement("path", { d: `M${map.takeoff[0]} ${map.takeoff[1]}h0`, class: "line", stroke: "var(--route)", "stroke-width": 11 });
  layer.route.append(svgElement("path", { d: `M${map.takeoff[0]} ${map.takeoff[1]}h0`, class: "line", stroke: "var(--card)", "stroke-width": 15 }), start);

  const scale = element("div", { class: "scale" }, element("span"), element("i"));
  const north = element("div", { class: "north", title: "north is up" });
  north.innerHTML = '<svg viewBox="0 0 30 30"><path d="M15 4l5 12h-10zM12.2 25v-7h1.5l2.7 4.3v-4.3h1.4v7h-1.5l-2.7-4.3v4.3z"/></svg>';
  const buttons = element("div", { class: "buttons" });
  host.append(svg, scale, north, buttons);

  const unitsPerPixel = () => view.w / host.clientWidth;
  const apply = () => {
    svg.setAttribute("viewBox", `${view.x} ${view.y} ${view.w} ${view.h}`);
    const unit = unitsPerPixel(), wanted = unit * map.metres_per_pixel * 110;
    const power = 10 ** Math.floor(Math.log10(wanted));
    const nice = [5, 2, 1].find((n) => n * power <= wanted) * power;
    scale.firstChild.textContent = nice >= 1000 ? nice / 1000 + " km" : nice + " m";
    scale.lastChild.style.width = nice / (unit * map.metres_per_pixel) + "px";
    hatch.setAttribute("patternTransform", `rotate(45) scale(${unit})`);
    for (const name of names) { name.setAttribute("font-size", 14 * unit); name.setAttribute("dy", -6 * unit); }
  };
  const fit = () => {
    const shape = host.clientWidth / host.clientHeight;
    const w = Math.max(home.w, home.h * shape), h = w / shape;
    view = { x: home.x + (home.w - w) / 2, y: home.y + (home.h - h) / 2, w, h };
    apply();
  };
  const zoom = (factor, x = view.x + view.w / 2, y = view.y + view.h / 2) => {
    const limited = Math.min(Math.max(view.w * factor, home.w / 200), home.w * 4) / view.w;
    view = { x: x - (x - view.x) * limited, y: y - (y - view.y) * limited, w: view.w * limited, h: view.h * limited };
    apply();
  };
  for (const [sign, title, act] of [["+", "zoom in", () => zoom(.7)], ["−", "zoom out", () => zoom(1 / .7)], ["⤢", "show all", fit]]) {
    const button = element("button", { title, type: "button", "aria-label": title }, sign);
    button.addEventListener("click", act);
    buttons.append(button);
  }
  svg.addEventListener("wheel", (event) => {
    event.preventDefault();
    const box = svg.getBoundingClientRect();
    zoom(event.deltaY > 0 ? 1.15 : 1 / 1.15, view.x + (event.clientX - box.left) * unitsPerPixel(), view.y + (event.clientY - box.top) * unitsPerPixel());
  }, { passive: false });
  svg.addEventListener("pointermove", (event) => {
    if (event.buttons !== 1) return;
    view.x -= event.movementX * unitsPerPixel();
    view.y -= event.movementY * unitsPerPixel();
    apply();
  });
  addEventListener("resize", fit);

  const shown = [["tiles", "tiles", "var(--mid)"], ...(map.matchability ? [["matchability", "matchability", "var(--match-poor)"]] : []), ["gaps", "gaps", "var(--gap)"], ["sectors", "sectors", "var(--sector)"],
                 ["corridor", "corridor", "var(--route)"], ["route", "route", "var(--route)"]];
  for (const [name, label, colour] of shown) {
    const box = element("input", { type: "checkbox", checked: "" });
    box.addEventListener("change", () => { layer[name].style.display = box.checked ? "" : "none"; });
    document.getElementById("layers").append(element("label", {}, box, element("i", { style: "background:" + colour }), label));
  }
  fit();
};

