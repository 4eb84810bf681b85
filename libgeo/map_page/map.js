// FlightMap: a flight on the map. Tracks in the colours of their segments, another one to compare them with, the ellipse
// that holds the aircraft with 95 %, the protection level around it, fixes that people gave, and objects they marked.
//
//   const map = makeFlightMap(element, { onFrame: (frame) => …, onPlace: (lat, lon) => …, onObject: (id) => … });
//   map.setPackage({ name, zooms: { min, max }, bounds: [west, south, east, north] });
//   map.setEstimates(estimates);   // as GET …/estimates lists them; addEstimate() for one more
//   map.setCompared(estimates);    // a second track, dashed, with a line between the two places of each frame
//   map.select(frame);             // draws its ellipse and its protection level
//   map.askForPlace(true);         // the next click, or Enter for the middle of the map, is a place

const makeFlightMap = (container, { onFrame, onPlace, onObject }) => {
  const { map, renderer } = makeBaseMap(container);
  map.setView([20, 0], 2);
  const layer = () => L.layerGroup().addTo(map);
  const uncertainties = layer(), compared = layer(), casings = layer(), lines = layer(), dots = layer(), places = layer(), objects = layer(),
        marks = layer(), chosen = layer();
  const vectors = makeVectorOverlay(map);
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

  // Of the other track: where each frame was there, and how far that is from where it is here.
  let other = null;
  const redrawCompared = () => {
    compared.clearLayers();
    if (!other) return;
    let run = [], segment = null;
    const end = () => {
      if (run.length > 1) L.polyline(run, { renderer, interactive: false, color: "#0a0f14", weight: 2.5, opacity: .85, dashArray: "3 5" }).addTo(compared);
      run = [];
    };
    other.forEach((estimate, i) => {
      if (!estimate?.position) return end();
      if (estimate.segment !== segment) end();
      segment = estimate.segment;
      const at = [estimate.position.lat, estimate.position.lon], here = estimates[i]?.position;
      run.push(at);
      if (here) L.polyline([at, [here.lat, here.lon]], { renderer, interactive: false, color: "#b3140c", weight: 1.5, opacity: .8 }).addTo(compared);
    });
    end();
  };

  return {
    leaflet: map,
    setPackage: (pack) => {
      tiles?.remove();
      tiles = null;
      vectors.show(null);
      if (!pack?.bounds) return;
      vectors.load(`/v1/packages/${encodeURIComponent(pack.name)}/vectors`);
      tiles = makePackageTiles(pack, (z, x, y) => `/v1/packages/${encodeURIComponent(pack.name)}/tiles/${z}/${x}/${y}`).addTo(map);
      const [west, south, east, north] = pack.bounds;
      if (!placed) map.fitBounds([[south, west], [north, east]], { animate: false });
    },
    setEstimates: (list) => {
      estimates.length = 0;
      for (const estimate of list) estimates[estimate.frame] = estimate;
      redrawTrack();
      redrawCompared();
      if (!placed) showTrack();
    },
    setCompared: (list) => { other = list; redrawCompared(); },
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
        if (fix.withdrawn) continue;
        L.circle([fix.lat, fix.lon], { renderer, interactive: false, radius: fix.radius_m, color: "#0a0f14", weight: 2, dashArray: "2 5", fillOpacity: .05 }).addTo(places);
        L.circleMarker([fix.lat, fix.lon], { renderer, interactive: false, radius: 4, color: "#ffffff", weight: 2, fillColor: "#0a0f14", fillOpacity: 1 }).addTo(places);
      }
    },
    setObjects: (list) => {
      objects.clearLayers();
      for (const { id, name, place } of list) {
        if (!place) continue;
        const at = [place.lat, place.lon], colour = place.agrees ? "#862e9c" : "#b3140c";
        L.polygon(ellipsePoints({ lat: place.lat, lon: place.lon, ellipse: place.ellipse_95 }, 1), { renderer, interactive: false, color: colour, weight: 2, fillOpacity: .15 }).addTo(objects);
        const dot = L.circleMarker(at, { renderer, radius: 5, color: "#ffffff", weight: 2, fillColor: colour, fillOpacity: 1, bubblingMouseEvents: false });
        dot.on("click", () => (asking ? onPlace(place.lat, place.lon) : onObject(id)));
        const label = document.createElement("span");
        label.textContent = name || `object ${id}`;
        dot.bindTooltip(label, { permanent: true, direction: "right", offset: [8, 0], className: "object-label" }).addTo(objects);
      }
    },
    // The place that is about to become a fix; null for none.
    setChosen: (place) => {
      chosen.clearLayers();
      if (place) L.circleMarker([place.lat, place.lon], { renderer, interactive: false, radius: 8, color: "#b3140c", weight: 3, fill: false }).addTo(chosen);
    },
    goTo: (lat, lon) => map.panTo([lat, lon], { animate: false }),
    middle: () => ({ lat: map.getCenter().lat, lon: map.getCenter().lng }),
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
      other = null;
      for (const group of [places, objects, chosen, compared]) group.clearLayers();
      askForPlace(false);
      redrawTrack();
    },
  };
};
