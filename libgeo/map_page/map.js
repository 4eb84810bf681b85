// FlightMap: the map of our pages, on Leaflet (L). A package's tiles, tracks in the colours of their segments, the ellipse
// that holds the aircraft with 95 %, the protection level around it, and places that people gave.
//
//   const map = makeFlightMap(element, { onFrame: (frame) => …, onPlace: (lat, lon) => … });
//   map.setPackage({ name, zooms: { min, max }, bounds: [west, south, east, north] });
//   map.setEstimates(estimates);   // as GET …/estimates lists them; addEstimate() for one more
//   map.select(frame);             // draws its ellipse and its protection level
//   map.askForPlace(true);         // the next click, or Enter for the middle of the map, is a place
//
// Tiles are fetched by call(), because an <img> cannot send a token.

// They differ in brightness as well; the first is the one that most flights have alone.
const segmentColours = ["#0a58ca", "#d9480f", "#067a4f", "#862e9c", "#b08900", "#c2255c", "#0b7285", "#5c3d1e"];
const segmentColour = (segment) => segmentColours[segment % segmentColours.length];
const sigmasOf95 = 2.448;
const metresPerDegree = 111320;

// The ellipse as a polygon. bearing_deg: of the major axis, clockwise from north.
const ellipsePoints = ({ lat, lon, ellipse }) => {
  const bearing = ellipse.bearing_deg * Math.PI / 180, points = [];
  const east = metresPerDegree * Math.cos(lat * Math.PI / 180);
  for (let i = 0; i < 48; ++i) {
    const along = sigmasOf95 * ellipse.major_m * Math.cos(i * Math.PI / 24), across = sigmasOf95 * ellipse.minor_m * Math.sin(i * Math.PI / 24);
    const dNorth = along * Math.cos(bearing) - across * Math.sin(bearing), dEast = along * Math.sin(bearing) + across * Math.cos(bearing);
    points.push([lat + dNorth / metresPerDegree, lon + dEast / east]);
  }
  return points;
};

const makePackageTiles = (pack) => {
  const Tiles = L.GridLayer.extend({
    createTile(coords, done) {
      const tile = document.createElement("img");
      tile.alt = "";
      tile.setAttribute("role", "presentation");
      const abort = new AbortController();
      tile.stop = () => abort.abort();
      const path = `/v1/packages/${encodeURIComponent(pack.name)}/tiles/${coords.z}/${coords.x}/${coords.y}`;
      call(path, {}, abort.signal).then(async (response) => {
        if (!response.ok) return done(null, tile);  // beyond the edge of the map
        const address = URL.createObjectURL(await response.blob());
        tile.onload = tile.onerror = () => { URL.revokeObjectURL(address); done(null, tile); };
        tile.src = address;
      }).catch((error) => done(error, tile));
      return tile;
    },
  });
  const [west, south, east, north] = pack.bounds;
  // Farther out, Leaflet would go through the tiles of all that the window shows, at the least zoom that there is.
  const farthest = Math.max(0, pack.zooms.min - 3);
  const tiles = new Tiles({ minNativeZoom: pack.zooms.min, maxNativeZoom: pack.zooms.max, minZoom: farthest, maxZoom: 22, keepBuffer: 1,
                            bounds: [[south, west], [north, east]] });
  tiles.on("tileunload", ({ tile }) => tile.stop());
  return tiles;
};

const makeFlightMap = (container, { onFrame, onPlace }) => {
  const map = L.map(container, { preferCanvas: true, zoomControl: true, maxZoom: 22, zoomSnap: 0.25, attributionControl: true });
  map.attributionControl.setPrefix("Leaflet");
  map.setView([20, 0], 2);
  L.control.scale({ imperial: false }).addTo(map);
  const renderer = L.canvas({ padding: 0.3, tolerance: 6 });
  const layer = () => L.layerGroup().addTo(map);
  const uncertainties = layer(), casings = layer(), lines = layer(), dots = layer(), places = layer(), marks = layer();
  let tiles = null, placed = false, asking = false, following = true;
  const estimates = [], strokes = new Map(), dotOf = new Map();
  let selected = null, showAll = false;

  const lineOf = (segment) => {
    if (!strokes.has(segment)) {
      const style = { renderer, interactive: false, lineJoin: "round" };
      strokes.set(segment, { casing: L.polyline([], { ...style, color: "#ffffff", weight: 7, opacity: .9 }).addTo(casings),
                             line: L.polyline([], { ...style, color: segmentColour(segment), weight: 3.5 }).addTo(lines) });
    }
    return strokes.get(segment);
  };
  const drawPoint = (estimate) => {
    if (!estimate.position) return;
    const at = [estimate.position.lat, estimate.position.lon], { casing, line } = lineOf(estimate.segment);
    casing.addLatLng(at);
    line.addLatLng(at);
    const anchored = estimate.source === "satellite_anchored";
    const dot = L.circleMarker(at, { renderer, radius: anchored ? 5 : 4, color: "#ffffff", weight: 1.5, bubblingMouseEvents: false,
                                     fillColor: segmentColour(estimate.segment), fillOpacity: anchored ? 1 : .55 });
    dot.on("click", (event) => (asking ? onPlace(event.latlng.lat, event.latlng.lng) : onFrame(estimate.frame)));
    dot.addTo(dots);
    dotOf.set(estimate.frame, dot);
  };
  const redrawTrack = () => {
    for (const group of [casings, lines, dots]) group.clearLayers();
    strokes.clear();
    dotOf.clear();
    estimates.forEach(drawPoint);
    redrawUncertainties();
  };

  // Of one frame: the 95 % ellipse, filled, and the protection level, dashed.
  const drawUncertainty = ({ position, segment }, strong) => {
    const colour = segmentColour(segment);
    if (position.ellipse?.major_m) {
      L.polygon(ellipsePoints(position), { renderer, interactive: false, color: colour, weight: strong ? 2 : 1, opacity: strong ? 1 : .5, fillOpacity: strong ? .18 : .06 }).addTo(uncertainties);
    }
    if (strong && position.hpl_m) {
      L.circle([position.lat, position.lon], { renderer, interactive: false, radius: position.hpl_m, color: "#b3140c", weight: 2, dashArray: "6 6", fill: false }).addTo(uncertainties);
    }
  };
  const lastPlaced = () => estimates.findLast((estimate) => estimate?.position);
  const redrawUncertainties = () => {
    uncertainties.clearLayers();
    marks.clearLayers();
    if (showAll) {
      const every = Math.ceil(estimates.length / 400);
      estimates.forEach((estimate, i) => { if (i % every === 0 && estimate.position) drawUncertainty(estimate, false); });
    }
    const shown = selected === null ? lastPlaced() : estimates[selected];
    if (!shown?.position) return;
    drawUncertainty(shown, true);
    L.circleMarker([shown.position.lat, shown.position.lon], { renderer, interactive: false, radius: 9, color: "#0a0f14", weight: 3, fill: false }).addTo(marks);
  };
  // Soon, and once for many.
  let due = false;
  const redrawSoon = () => {
    if (due) return;
    due = true;
    requestAnimationFrame(() => { due = false; redrawUncertainties(); });
  };

  const showTrack = () => {
    const at = estimates.filter((estimate) => estimate?.position).map(({ position }) => [position.lat, position.lon]);
    if (at.length === 0) return;
    placed = true;
    map.fitBounds(L.latLngBounds(at).pad(0.2), { animate: false, maxZoom: Math.min(18, tiles?.options.maxNativeZoom ?? 18) });
  };
  const askForPlace = (wanted) => {
    asking = wanted;
    container.classList.toggle("asking", wanted);
  };
  map.on("click", (event) => { if (asking) onPlace(event.latlng.lat, event.latlng.lng); });
  map.on("dragstart", () => { following = false; });
  container.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || !asking) return;
    event.preventDefault();
    onPlace(map.getCenter().lat, map.getCenter().lng);
  });
  new ResizeObserver(() => map.invalidateSize({ animate: false })).observe(container);

  return {
    setPackage: (pack) => {
      tiles?.remove();
      tiles = null;
      if (!pack?.bounds) return;
      tiles = makePackageTiles(pack).addTo(map);
      const [west, south, east, north] = pack.bounds;
      if (!placed) map.fitBounds([[south, west], [north, east]], { animate: false });
    },
    setEstimates: (list) => {
      estimates.length = 0;
      for (const estimate of list) estimates[estimate.frame] = estimate;
      redrawTrack();
      if (!placed) showTrack();
    },
    addEstimate: (estimate) => {
      const known = estimates[estimate.frame] !== undefined;
      estimates[estimate.frame] = estimate;
      if (known) return;
      drawPoint(estimate);
      redrawSoon();
      if (!estimate.position) return;
      if (!placed) showTrack();
      else if (following && !map.getBounds().pad(-0.1).contains([estimate.position.lat, estimate.position.lon])) {
        map.panTo([estimate.position.lat, estimate.position.lon], { animate: false });
      }
    },
    setFixes: (fixes) => {
      places.clearLayers();
      for (const fix of fixes) {
        L.circle([fix.lat, fix.lon], { renderer, interactive: false, radius: fix.radius_m, color: "#0a0f14", weight: 2, dashArray: "2 5", fillOpacity: .05 }).addTo(places);
        L.circleMarker([fix.lat, fix.lon], { renderer, interactive: false, radius: 4, color: "#ffffff", weight: 2, fillColor: "#0a0f14", fillOpacity: 1 }).addTo(places);
      }
    },
    select: (frame) => {
      selected = frame;
      redrawUncertainties();
      const position = frame === null ? null : estimates[frame]?.position;
      if (position && !map.getBounds().contains([position.lat, position.lon])) map.panTo([position.lat, position.lon], { animate: false });
    },
    showAllUncertainties: (wanted) => { showAll = wanted; redrawUncertainties(); },
    askForPlace,
    showTrack: () => { following = true; showTrack(); },
    clear: () => {
      placed = false;
      selected = null;
      following = true;
      estimates.length = 0;
      places.clearLayers();
      askForPlace(false);
      redrawTrack();
    },
  };
};
