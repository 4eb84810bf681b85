// The ground and the aircraft along the route, and what its camera sees from there: the profile below the map, with a
// place along it that is chosen by mouse, finger or arrow keys.

const profileHeight_px = 110, profileMargin = { left: 46, right: 10, top: 8, bottom: 18 };

const makeMissionProfile = ({ map, renderer, nearestLook }) => {
  const swath = L.layerGroup().addTo(map), cursor = L.layerGroup().addTo(map), drawing = byId("profile-drawing");
  let profile = null, showSwath = false;
  const bearingAt = (samples, i) => {
    const a = samples[Math.max(0, i - 1)], b = samples[Math.min(samples.length - 1, i + 1)];
    return Math.atan2((b.lon_deg - a.lon_deg) * Math.cos(a.lat_deg * Math.PI / 180), b.lat_deg - a.lat_deg);
  };
  // Corners of a rectangle around the sample: along the flight and across it, in metres.
  const around = (samples, i, along, across) => {
    const angle = bearingAt(samples, i), s = Math.sin(angle), c = Math.cos(angle);
    return placeAt({ lat: samples[i].lat_deg, lon: samples[i].lon_deg }, along * s + across * c, along * c - across * s);
  };
  const footprint = (samples, i) => {
    const along = samples[i].length_m / 2, across = samples[i].width_m / 2;
    return [[along, -across], [along, across], [-along, across], [-along, -across]].map(([a, b]) => around(samples, i, a, b));
  };
  const drawSwath = () => {
    swath.clearLayers();
    if (!showSwath || !profile) return;
    const { samples } = profile, seen = samples.map((_, i) => i).filter((i) => samples[i].width_m > 0);
    L.polygon(seen.map((i) => [footprint(samples, i)]), { renderer, interactive: false, stroke: false, fillColor: "#862e9c", fillOpacity: .3, fillRule: "nonzero" }).addTo(swath);
  };

  // Above sea level; above ground where nothing is known about the ground.
  const flownHeight = ({ height_m, agl_m }) => (profile.samples.some((sample) => sample.height_m !== null) ? height_m : agl_m);
  const scales = () => {
    const { samples } = profile, width = drawing.clientWidth || 600, length = samples.at(-1).at_m || 1;
    const heights = samples.flatMap((sample) => [sample.ground_m, flownHeight(sample)]).filter(Number.isFinite);
    const low = Math.min(...heights, heights.length ? Infinity : 0), high = Math.max(low + 1, ...heights), { left, right, top, bottom } = profileMargin;
    return { width, low, high, x: (at) => left + (width - left - right) * at / length, y: (height) => top + (profileHeight_px - top - bottom) * (1 - (height - low) / (high - low)),
             at: (x) => Math.min(1, Math.max(0, (x - left) / (width - left - right))) * length };
  };
  const draw = () => {
    if (!profile) return;
    const { samples, points } = profile, { width, low, high, x, y } = scales(), known = samples.filter(({ ground_m }) => Number.isFinite(ground_m));
    drawing.setAttribute("viewBox", `0 0 ${width} ${profileHeight_px}`);
    const path = (list, of) => list.map((sample, i) => `${i ? "L" : "M"}${x(sample.at_m).toFixed(1)} ${y(of(sample)).toFixed(1)}`).join("");
    const parts = [];
    if (known.length > 1) parts.push(svgElement("path", { class: "ground", d: `${path(known, ({ ground_m }) => ground_m)}L${x(known.at(-1).at_m)} ${y(low)}L${x(known[0].at_m)} ${y(low)}Z` }));
    const flown = samples.filter((sample) => Number.isFinite(flownHeight(sample)));
    if (flown.length > 1) parts.push(svgElement("path", { class: "flown", d: path(flown, flownHeight) }));
    for (const { at_m } of points) parts.push(svgElement("line", { class: "stop", x1: x(at_m), x2: x(at_m), y1: profileMargin.top, y2: y(low) }));
    for (const [height, dy] of [[high, 9], [low, 0]]) parts.push(svgElement("text", { x: profileMargin.left - 5, y: y(height) + dy, "text-anchor": "end" }, `${Math.round(height)} m`));
    parts.push(svgElement("text", { x: profileMargin.left, y: profileHeight_px - 4 }, "0"),
               svgElement("text", { x: width - profileMargin.right, y: profileHeight_px - 4, "text-anchor": "end" }, metres(samples.at(-1).at_m)),
               svgElement("line", { class: "cursor", id: "profile-cursor", x1: 0, x2: 0, y1: 0, y2: y(low) }));
    drawing.replaceChildren(...parts);
    showCursor();
  };
  const heightText = (value) => `${metres(value)} (${feetText(value)})`;
  const showCursor = () => {
    cursor.clearLayers();
    const { samples } = profile, i = Number(byId("profile-at").value), sample = samples[i], { x } = scales(), look = nearestLook(sample.at_m);
    for (const end of ["x1", "x2"]) byId("profile-cursor").setAttribute(end, x(sample.at_m));
    const parts = [`${metres(sample.at_m)} along the route`, sample.agl_m === null ? "" : `${heightText(sample.agl_m)} above ground`, sample.ground_m === null ? "ground not known" : `ground ${heightText(sample.ground_m)}`,
      sample.width_m > 0 ? `camera sees ${metres(sample.width_m)} × ${metres(sample.length_m)}` : "", look ? `predicted protection level ${look.hpl_m === null ? "unknown" : metres(look.hpl_m)}, ${percent(look.anchored_share)} of the looks anchor` : ""];
    byId("profile-text").textContent = parts.filter(Boolean).join("; ");
    if (sample.width_m > 0) L.polygon(footprint(samples, i), { renderer, interactive: false, color: "#862e9c", weight: 2.5, fillOpacity: .1 }).addTo(cursor);
    if (look && look.hpl_m !== null) L.circle([sample.lat_deg, sample.lon_deg], { renderer, interactive: false, radius: look.hpl_m, color: "#b3140c", weight: 2, dashArray: "6 6", fill: false }).addTo(cursor);
    L.circleMarker([sample.lat_deg, sample.lon_deg], { renderer, interactive: false, radius: 6, color: "#ffffff", weight: 2, fillColor: "#862e9c", fillOpacity: 1 }).addTo(cursor);
  };
  const set = (found) => {
    profile = found && found.samples.length > 1 ? found : null;
    byId("profile-at").disabled = !profile;
    if (!profile) {
      for (const group of [swath, cursor]) group.clearLayers();
      drawing.replaceChildren();
      byId("profile-text").textContent = "The ground below the route, and the heights above it, once there is a route.";
      return;
    }
    byId("profile-at").max = profile.samples.length - 1;
    draw();
    drawSwath();
  };
  byId("profile-at").addEventListener("input", showCursor);
  const pick = (event) => {
    const at = scales().at(event.clientX - drawing.getBoundingClientRect().left);
    byId("profile-at").value = profile.samples.findIndex(({ at_m }) => at_m >= at - 1e-6);
    showCursor();
  };
  drawing.addEventListener("pointerdown", pick);
  drawing.addEventListener("pointermove", (event) => { if (event.buttons) pick(event); });
  byId("layer-footprint").addEventListener("change", () => { showSwath = byId("layer-footprint").checked; drawSwath(); });
  new ResizeObserver(draw).observe(drawing);
  return { set, refresh: () => { if (profile) showCursor(); } };
};
