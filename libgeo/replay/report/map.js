// The map: the package's imagery in local metres (x east, y south), track, truth and ellipses on it; pan and zoom.

const drawMap = (host) => {
  const placed = data.frames.map((frame, index) => ({ frame, index })).filter(({ frame }) => frame.east != null);
  const points = placed.map(({ frame }) => [frame.east, -frame.north]);
  const truth = data.truth.filter((point) => point).map(([east, north]) => [east, -north]);
  const every = points.concat(truth);
  if (every.length === 0) {
    host.append(element("p", { class: "note", style: "padding:20px" }, "No frame has a position."));
    return;
  }
  const xs = every.map((p) => p[0]), ys = every.map((p) => p[1]);
  const pad = Math.max(40, 0.08 * Math.max(Math.max(...xs) - Math.min(...xs), Math.max(...ys) - Math.min(...ys)));
  const home = { x: Math.min(...xs) - pad, y: Math.min(...ys) - pad,
                 w: Math.max(...xs) - Math.min(...xs) + 2 * pad, h: Math.max(...ys) - Math.min(...ys) + 2 * pad };
  let view = { ...home };

  const svg = svgElement("svg", { preserveAspectRatio: "xMidYMid slice", role: "img", "aria-label": "Map of the flight" });
  const layer = {};
  for (const name of ["imagery", "ellipses", "truth", "refined", "track", "cursor"]) {
    layer[name] = svgElement("g");
    svg.append(layer[name]);
  }
  if (data.map) {
    const { image, west, north, width, height } = data.map;
    layer.imagery.append(svgElement("image", { href: image, x: west, y: -north, width, height, preserveAspectRatio: "none" }));
  }
  const path = (list) => list.map((p, i) => (i ? "L" : "M") + p[0].toFixed(2) + " " + p[1].toFixed(2)).join("");
  const line = (group, list, colour, width, extra = {}) => {
    group.append(svgElement("path", { d: path(list), class: "line halo", "stroke-width": width + 2.5, ...extra }));
    group.append(svgElement("path", { d: path(list), class: "line", stroke: colour, "stroke-width": width, ...extra }));
  };
  if (truth.length > 1) line(layer.truth, truth, "var(--truth)", 2);
  const refined = data.refined.filter((point) => point).map(([east, north]) => [east, -north]);
  if (refined.length > 1) line(layer.refined, refined, "var(--refined)", 1.6);

  if (points.length > 1) layer.track.append(svgElement("path", { d: path(points), class: "line", stroke: "#fff", "stroke-opacity": ".75", "stroke-width": 1.4, "stroke-dasharray": "4 4" }));
  const tint = Math.min(0.24, 8 / placed.length);  // many ellipses over each other must not hide the map
  for (const { frame } of placed) {
    const colour = sources[frame.source].colour;
    const [ee, en, nn] = frame.covariance;
    const middle = (ee + nn) / 2, spread = Math.hypot((ee - nn) / 2, en);
    const major = 2.448 * Math.sqrt(Math.max(0, middle + spread)), minor = 2.448 * Math.sqrt(Math.max(0, middle - spread));
    const turn = -Math.atan2(2 * en, ee - nn) / 2 * 180 / Math.PI;
    if (major > 0) layer.ellipses.append(svgElement("ellipse", { rx: major, ry: minor, class: "ellipse", fill: colour, stroke: colour, "fill-opacity": tint,
      transform: `translate(${frame.east} ${-frame.north}) rotate(${turn})` }));
    const at = `M${frame.east} ${-frame.north}h0`;
    layer.track.append(svgElement("path", { d: at, class: "line halo", "stroke-width": 9.5 }));
    layer.track.append(svgElement("path", { d: at, class: "line", stroke: colour, "stroke-width": 7 }));
  }

  const scale = element("div", { class: "scale" }, element("span"), element("i"));
  const north = element("div", { class: "north", title: "north is up" });
  north.innerHTML = '<svg viewBox="0 0 30 30"><path d="M15 4l5 12h-10zM12.2 25v-7h1.5l2.7 4.3v-4.3h1.4v7h-1.5l-2.7-4.3v4.3z"/></svg>';
  const buttons = element("div", { class: "buttons" });
  host.append(svg, scale, north, buttons);

  const metresPerPixel = () => Math.min(view.w / host.clientWidth, view.h / host.clientHeight);
  const apply = () => {
    svg.setAttribute("viewBox", `${view.x} ${view.y} ${view.w} ${view.h}`);
    const wanted = metresPerPixel() * 110;
    const power = 10 ** Math.floor(Math.log10(wanted));
    const nice = [5, 2, 1].find((n) => n * power <= wanted) * power;
    scale.firstChild.textContent = nice >= 1000 ? nice / 1000 + " km" : nice + " m";
    scale.lastChild.style.width = nice / metresPerPixel() + "px";
  };
  // "slice" crops the longer side, so the view takes the host's shape first.
  const fit = () => {
    if (!host.clientWidth || !host.clientHeight) return;  // not laid out yet: the observer below calls again
    const shape = host.clientWidth / host.clientHeight;
    const w = Math.max(home.w, home.h * shape), h = w / shape;
    view = { x: home.x + (home.w - w) / 2, y: home.y + (home.h - h) / 2, w, h };
    apply();
  };
  const place = (event) => {
    const box = svg.getBoundingClientRect();
    return [view.x + (event.clientX - box.left) / box.width * view.w, view.y + (event.clientY - box.top) / box.height * view.h];
  };
  const zoom = (factor, x = view.x + view.w / 2, y = view.y + view.h / 2) => {
    const limited = Math.min(Math.max(view.w * factor, home.w / 60), home.w * 4) / view.w;
    view = { x: x - (x - view.x) * limited, y: y - (y - view.y) * limited, w: view.w * limited, h: view.h * limited };
    apply();
  };
  for (const [sign, title, act] of [["+", "zoom in", () => zoom(0.7)], ["−", "zoom out", () => zoom(1 / 0.7)], ["⤢", "show all", fit]]) {
    const button = element("button", { title, type: "button", "aria-label": title }, sign);
    button.addEventListener("click", act);
    buttons.append(button);
  }
  svg.addEventListener("wheel", (event) => { event.preventDefault(); zoom(event.deltaY > 0 ? 1.15 : 1 / 1.15, ...place(event)); }, { passive: false });
  const fingers = new Map();
  svg.addEventListener("pointerdown", (event) => { fingers.set(event.pointerId, event); svg.setPointerCapture(event.pointerId); svg.classList.add("dragging"); });
  for (const name of ["pointerup", "pointercancel"]) svg.addEventListener(name, (event) => { fingers.delete(event.pointerId); svg.classList.remove("dragging"); });
  svg.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return selectNearest(place(event));
    const step = metresPerPixel();
    if (fingers.size === 2) {
      const other = [...fingers.values()].find((finger) => finger.pointerId !== event.pointerId);
      const gap = (finger) => Math.hypot(finger.clientX - other.clientX, finger.clientY - other.clientY);
      zoom(gap(before) / Math.max(1, gap(event)), ...place(other));
    } else {
      view.x -= (event.clientX - before.clientX) * step;
      view.y -= (event.clientY - before.clientY) * step;
      apply();
    }
    fingers.set(event.pointerId, event);
  });
  const selectNearest = ([x, y]) => {
    let best = -1, distance = 24 * metresPerPixel();
    for (const { frame, index } of placed) {
      const d = Math.hypot(frame.east - x, -frame.north - y);
      if (d < distance) { distance = d; best = index; }
    }
    select(best);
  };
  svg.addEventListener("click", (event) => selectNearest(place(event)));

  onSelect((index) => {
    layer.cursor.replaceChildren();
    const frame = data.frames[index], real = data.truth[index];
    if (frame.east == null) return;
    const [ee, en, nn] = frame.covariance;
    if (ee + nn > 0) {
      const middle = (ee + nn) / 2, spread = Math.hypot((ee - nn) / 2, en);
      layer.cursor.append(svgElement("ellipse", { rx: 2.448 * Math.sqrt(middle + spread), ry: 2.448 * Math.sqrt(Math.max(0, middle - spread)),
        class: "ellipse", fill: "#fff", "fill-opacity": ".12", stroke: "#fff", "stroke-width": 2,
        transform: `translate(${frame.east} ${-frame.north}) rotate(${-Math.atan2(2 * en, ee - nn) / 2 * 180 / Math.PI})` }));
    }
    if (real) {
      layer.cursor.append(svgElement("path", { d: `M${frame.east} ${-frame.north}L${real[0]} ${-real[1]}`, class: "line", stroke: "#fff", "stroke-width": 2 }));
      layer.cursor.append(svgElement("path", { d: `M${real[0]} ${-real[1]}h0`, class: "line", stroke: "#fff", "stroke-width": 13 }));
      layer.cursor.append(svgElement("path", { d: `M${real[0]} ${-real[1]}h0`, class: "line", stroke: "var(--truth)", "stroke-width": 9 }));
    }
    layer.cursor.append(svgElement("path", { d: `M${frame.east} ${-frame.north}h0`, class: "line", stroke: "#10181f", "stroke-width": 17 }));
    layer.cursor.append(svgElement("path", { d: `M${frame.east} ${-frame.north}h0`, class: "line", stroke: "#fff", "stroke-width": 14 }));
    layer.cursor.append(svgElement("path", { d: `M${frame.east} ${-frame.north}h0`, class: "line", stroke: sources[frame.source].colour, "stroke-width": 9 }));
  });

  const chips = [["imagery", "imagery", "var(--soft)", data.map], ["track", "estimates", "var(--anchored)", true],
                 ["ellipses", "95 % ellipses", "var(--vo)", true], ["refined", "smoothed", "var(--refined)", refined.length > 1],
                 ["truth", "truth", "var(--truth)", truth.length > 1]];
  const host2 = document.getElementById("layers");
  for (const [name, label, colour, there] of chips) {
    if (!there) continue;
    const box = element("input", { type: "checkbox" });
    box.checked = true;
    box.addEventListener("change", () => { layer[name].style.display = box.checked ? "" : "none"; });
    host2.append(element("label", {}, box, element("i", { style: `background:${colour}` }), label));
  }
  new ResizeObserver(fit).observe(host);
  fit();
};
