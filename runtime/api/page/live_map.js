// The map of a flight in the air, on the map of our pages (base_map.js): the planned route, the flown track in the
// colours of its sources, the ellipse that holds the aircraft with 95 %, and the aircraft.

const sourceColours = { satellite_anchored: "#067a4f", vo_extrapolated: "#0a58ca", dead_reckoned: "#ff8a00", no_fix: "#5b6570" };
const trackKept = 4000, trackDropped = 1000;  // points: beyond the first number the oldest ones go

const makeLiveMap = () => {
  const container = document.getElementById("map-view"), followButton = document.getElementById("follow");
  const { map, renderer } = makeBaseMap(container);
  map.setView([20, 0], 2);
  const layer = () => L.layerGroup().addTo(map);
  const route = layer(), casings = layer(), lines = layer(), uncertainty = layer();
  const vectors = makeVectorOverlay(map);
  let tiles = null, known = "", closest = 17, state = null, track = [], following = true, placed = false, planned = false;

  // A line for each run of one source; a run begins where the one before it ended.
  let last = null;
  const draw = (point) => {
    const at = [point.lat, point.lon];
    if (last?.source !== point.source) {
      const from = last ? [last.at] : [], style = { renderer, interactive: false, lineJoin: "round" };
      last = { source: point.source, casing: L.polyline(from, { ...style, color: "#ffffff", weight: 8 }).addTo(casings),
               line: L.polyline(from, { ...style, color: sourceColours[point.source], weight: 4.5 }).addTo(lines) };
    }
    last.casing.addLatLng(at);
    last.line.addLatLng(at);
    last.at = at;
  };
  const redraw = () => {
    casings.clearLayers();
    lines.clearLayers();
    last = null;
    track.forEach(draw);
  };

  const arrow = svgElement("path", { "stroke-width": 1.6, stroke: "#0a0f14", "stroke-linejoin": "round" });
  const halo = svgElement("path", { "stroke-width": 5, stroke: "#ffffff", fill: "none", "stroke-linejoin": "round" });
  const drawing = svgElement("svg", { viewBox: "-24 -24 48 48", width: 48, height: 48, "aria-hidden": "true" });
  drawing.append(halo, arrow);
  const aircraft = L.marker([0, 0], { icon: L.divIcon({ html: drawing, className: "aircraft", iconSize: [48, 48] }), interactive: false, keyboard: false });
  const drawAircraft = () => {
    uncertainty.clearLayers();
    if (!state?.position) return aircraft.remove();
    const { lat, lon } = state.position, colour = sourceColours[state.source], ring = ellipsePoints(state.position);
    L.polygon(ring, { renderer, interactive: false, color: "#ffffff", weight: 5, fill: false }).addTo(uncertainty);
    L.polygon(ring, { renderer, interactive: false, color: colour, weight: 2.5, fillOpacity: .22 }).addTo(uncertainty);
    const shape = state.heading_deg === null ? "M-9 0a9 9 0 1 0 18 0a9 9 0 1 0 -18 0z" : "M0-19L13 14L0 7L-13 14z";
    for (const part of [halo, arrow]) {
      part.setAttribute("d", shape);
      part.setAttribute("transform", `rotate(${state.heading_deg ?? 0})`);
    }
    arrow.setAttribute("fill", colour);
    aircraft.setLatLng([lat, lon]).addTo(map);
  };

  const follow = (wanted) => {
    following = wanted;
    followButton.setAttribute("aria-pressed", wanted);
    map.options.scrollWheelZoom = map.options.touchZoom = map.options.doubleClickZoom = wanted ? "center" : true;
    if (wanted && state?.position) map.panTo([state.position.lat, state.position.lon], { animate: false });
  };
  map.on("dragstart", () => follow(false));
  container.addEventListener("keydown", (event) => { if (event.key.startsWith("Arrow")) follow(false); });
  followButton.addEventListener("click", () => follow(!following));
  follow(true);

  return {
    setPackage: (pack) => {
      const now = JSON.stringify([pack.accepted, pack.mission, pack.series, pack.sequence, pack.tiles, pack.route]);
      if (now === known) return;
      known = now;
      tiles?.remove();
      tiles = null;
      route.clearLayers();
      vectors.show(null);
      if (!pack.accepted) return;
      vectors.load("/v1/vectors");
      closest = pack.max_zoom;
      if (pack.tiles > 0) {
        const shown = { zooms: { min: pack.min_zoom, max: pack.max_zoom }, bounds: pack.bounds ?? [-180, -85, 180, 85] };
        tiles = makePackageTiles(shown, (z, x, y) => `/v1/tiles/${z}/${x}/${y}`).addTo(map);
      }
      const points = (pack.route ?? []).map(([lon, lat]) => [lat, lon]);
      if (points.length > 1) {
        L.polyline(points, { renderer, interactive: false, color: "#0a0f14", weight: 4, opacity: .75 }).addTo(route);
        L.polyline(points, { renderer, interactive: false, color: "#ffffff", weight: 2, dashArray: "7 7" }).addTo(route);
      }
      if (!pack.bounds || planned || placed) return;
      planned = true;
      const [west, south, east, north] = pack.bounds;
      map.fitBounds([[south, west], [north, east]], { animate: false });
    },
    setTrack: (points) => {
      track = [...points];
      redraw();
    },
    setState: (next) => {
      const before = state;
      state = next;
      if (state.position) {
        const { lat, lon } = state.position;
        if (state.time_s !== before?.time_s) {
          track.push({ lat, lon, source: state.source });
          draw(track.at(-1));
        }
        if (track.length > trackKept) {
          track.splice(0, trackDropped);
          redraw();
        }
        if (!placed) {
          placed = true;
          map.setView([lat, lon], Math.min(17, closest - .5), { animate: false });
        } else if (following) {
          map.panTo([lat, lon], { animate: false });
        }
      }
      drawAircraft();
    },
  };
};
