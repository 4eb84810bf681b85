// The map of the report, on the map of our pages (base_map.js): the package's imagery, track, truth and ellipses, in the
// local plane: metres east are Leaflet's longitude, metres north its latitude.

const drawMap = (host) => {
  const placed = data.frames.map((frame, index) => ({ frame, index })).filter(({ frame }) => frame.east != null);
  const at = (east, north) => [north, east];
  const truth = data.truth.filter((point) => point).map(([east, north]) => at(east, north));
  const refined = data.refined.filter((point) => point).map(([east, north]) => at(east, north));
  const points = placed.map(({ frame }) => at(frame.east, frame.north)), every = points.concat(truth, refined);
  if (every.length === 0) {
    host.append(element("p", { class: "note" }, "No frame has a position."));
    return;
  }
  const style = getComputedStyle(document.documentElement);
  const resolved = (colour) => (colour.startsWith("var(") ? style.getPropertyValue(colour.slice(4, -1)).trim() : colour);

  const { map, renderer } = makeBaseMap(host, { crs: L.CRS.Simple, minZoom: -6, maxZoom: 6, attributionControl: false });
  const home = L.latLngBounds(every).pad(0.08);
  const least = 80 / Math.max(1, home.getNorth() - home.getSouth(), home.getEast() - home.getWest());  // 80 m at least
  const fit = () => map.fitBounds(least > 1 ? home.pad(least / 2) : home, { animate: false });
  map.setView(home.getCenter(), 0);
  host.tabIndex = 0;
  host.setAttribute("role", "application");
  host.setAttribute("aria-label", "Map of the flight. Arrow keys move it, plus and minus zoom.");

  const names = ["imagery", "ellipses", "truth", "refined", "track", "cursor"], layer = {};
  for (const name of names) layer[name] = L.layerGroup().addTo(map);
  if (data.map) {
    const { image, west, north, width, height } = data.map;
    L.imageOverlay(image, [at(west, north - height), at(west + width, north)], { pane: "tilePane" }).addTo(layer.imagery);
  }
  if (data.vectors) makeVectorOverlay(map, { place: ([east, north]) => at(east, north) }).show(data.vectors);
  const shown = { renderer, interactive: false, lineJoin: "round" };
  const line = (group, list, colour, width) => {
    L.polyline(list, { ...shown, color: "#ffffff", opacity: .85, weight: width + 2.5 }).addTo(group);
    L.polyline(list, { ...shown, color: resolved(colour), weight: width }).addTo(group);
  };
  const dot = (group, place, radius, colour, rim = "#ffffff") =>
    L.circleMarker(place, { renderer, interactive: false, radius, color: rim, weight: 1.25, fillColor: resolved(colour), fillOpacity: 1 }).addTo(group);
  if (truth.length > 1) line(layer.truth, truth, "var(--truth)", 2);
  if (refined.length > 1) line(layer.refined, refined, "var(--refined)", 1.6);

  // The 95 % ellipse of a covariance, in the plane.
  const ring = ({ east, north, covariance: [ee, en, nn] }) => {
    const middle = (ee + nn) / 2, spread = Math.hypot((ee - nn) / 2, en), turn = Math.atan2(2 * en, ee - nn) / 2;
    const major = sigmasOf95 * Math.sqrt(Math.max(0, middle + spread)), minor = sigmasOf95 * Math.sqrt(Math.max(0, middle - spread));
    return Array.from({ length: 48 }, (_, i) => {
      const along = major * Math.cos(i * Math.PI / 24), across = minor * Math.sin(i * Math.PI / 24);
      return at(east + along * Math.cos(turn) - across * Math.sin(turn), north + along * Math.sin(turn) + across * Math.cos(turn));
    });
  };
  if (points.length > 1) L.polyline(points, { ...shown, color: "#ffffff", opacity: .75, weight: 1.4, dashArray: "4 4" }).addTo(layer.track);
  const tint = Math.min(0.24, 8 / placed.length);  // many ellipses over each other must not hide the map
  for (const { frame } of placed) {
    const colour = resolved(sources[frame.source].colour);
    if (frame.covariance[0] + frame.covariance[2] > 0) L.polygon(ring(frame), { ...shown, color: colour, weight: 1, opacity: .6, fillOpacity: tint }).addTo(layer.ellipses);
    dot(layer.track, at(frame.east, frame.north), 4, colour);
  }

  const all = L.control({ position: "topleft" });
  all.onAdd = () => {
    const bar = element("div", { class: "leaflet-bar" }), button = element("button", { type: "button", title: "show all", "aria-label": "show all" }, "⤢");
    button.addEventListener("click", fit);
    L.DomEvent.disableClickPropagation(bar);
    bar.append(button);
    return bar;
  };
  all.addTo(map);

  const selectNearest = ({ containerPoint }) => {
    let best = -1, distance = 24;
    for (const { frame, index } of placed) {
      const d = map.latLngToContainerPoint(at(frame.east, frame.north)).distanceTo(containerPoint);
      if (d < distance) { distance = d; best = index; }
    }
    select(best);
  };
  map.on("mousemove click", selectNearest);

  onSelect((index) => {
    layer.cursor.clearLayers();
    const frame = data.frames[index], real = data.truth[index];
    if (frame.east == null) return;
    const here = at(frame.east, frame.north);
    if (frame.covariance[0] + frame.covariance[2] > 0) L.polygon(ring(frame), { ...shown, color: "#ffffff", weight: 2, fillOpacity: .12 }).addTo(layer.cursor);
    if (real) {
      L.polyline([here, at(...real)], { ...shown, color: "#ffffff", weight: 2 }).addTo(layer.cursor);
      dot(layer.cursor, at(...real), 5.5, "var(--truth)");
    }
    L.circleMarker(here, { renderer, interactive: false, radius: 7.5, color: "#10181f", weight: 2, fillColor: resolved(sources[frame.source].colour), fillOpacity: 1 }).addTo(layer.cursor);
  });

  const chips = [["imagery", "imagery", "var(--soft)", data.map], ["track", "estimates", "var(--anchored)", true],
                 ["ellipses", "95 % ellipses", "var(--vo)", true], ["refined", "smoothed", "var(--refined)", refined.length > 1],
                 ["truth", "truth", "var(--truth)", truth.length > 1]];
  for (const [name, label, colour, there] of chips) {
    if (!there) continue;
    const box = element("input", { type: "checkbox" });
    box.checked = true;
    // All of them again, so that they lie over each other in their order.
    box.addEventListener("change", () => {
      layer[name].hidden = !box.checked;
      for (const each of names) layer[each].remove();
      for (const each of names) if (!layer[each].hidden) layer[each].addTo(map);
    });
    document.getElementById("layers").append(element("label", {}, box, element("i", { style: `background:${colour}` }), label));
  }
  let fitted = false;  // once the map has its size
  new ResizeObserver(() => {
    if (fitted || host.clientWidth === 0) return;
    fitted = true;
    map.invalidateSize({ animate: false });
    fit();
  }).observe(host);
};
