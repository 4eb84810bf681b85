// A mission on the map: drawn and edited with the mouse, a finger or keys, by Leaflet.Editable.
//
//   const map = makeMissionMap(element, { onSelect, onPoints, onRadius, onDrawn, onTool });
//   map.show(doc, shape, point);    // what is selected has handles: each point, and halfway between points
//   map.draw("route");              // or "area", "no-fly", "circle", "takeoff": clicks, or Enter for the middle of the map
//
// Every change goes to the page as points, and comes back with the next show(): the document is what is true. A point that
// is dragged snaps to points and lines of other parts, except with Alt. A selected part is dragged as a whole by its line or
// its ground.

const snapPoint_px = 12, snapLine_px = 8, keyStep_px = 2, keyStride_px = 20;
const leastDrag_px = 4;
const dragClick_ms = 200;                        // the click that ends a drag is none
const metresPerPixelAtEquator = 156543.034;  // at zoom 0

const partColours = { route: "#0a58ca", stable: "#067a4f", active: "#8f4700", no_fly: "#b3140c", takeoff: "#0a0f14" };
const colourOf = (doc, shape) => (shape.startsWith("no_fly") ? partColours.no_fly : shape.startsWith("sectors") ? partColours[memberAt(doc, shape).class] ?? partColours.active : partColours[shape]);

L.Editable.VertexIcon.mergeOptions({ iconSize: new L.Point(14, 14) });
L.Editable.TouchVertexIcon.mergeOptions({ iconSize: new L.Point(24, 24) });
for (const marker of [L.Editable.VertexMarker, L.Editable.MiddleMarker]) marker.mergeOptions({ keyboard: false });  // the lists are for keys

const makeMissionMap = (container, { onSelect, onPoints, onRadius, onDrawn, onTool }) => {
  const { map, renderer } = makeBaseMap(container, { minZoom: 2, editable: true, editOptions: { lineGuideOptions: { color: "#0a0f14", weight: 2 } } });
  map.options.renderer = renderer;  // of all that is drawn: of several canvases, the top one alone would be clicked
  map.setView([20, 0], 2);
  const grounds = L.layerGroup().addTo(map), parts = L.layerGroup().addTo(map), marks = L.layerGroup().addTo(map);
  let doc = null, selected = null, point = null, tool = null, drawn = null, snapping = true, snapped = null, draggedAt = -Infinity, route = null;
  const justDragged = () => performance.now() <= draggedAt + dragClick_ms;

  // ---- Lines as wide as on the ground

  const bands = [];
  const setWidths = () => {
    for (const { line, width_m, lat } of bands) line.setStyle({ weight: Math.max(1, width_m * 2 ** map.getZoom() / metresPerPixelAtEquator / Math.cos(lat * Math.PI / 180)) });
  };
  map.on("zoomend", setWidths);
  const addBand = (line, width_m, lat) => {
    if (!(width_m > 0)) return;
    bands.push({ line: line.addTo(grounds), width_m, lat });
  };

  // ---- What is there

  const latLngs = (shape) => {
    const heights = heightsOf(doc, shape);
    return pointsOf(doc, shape).map((place, i) => (isPlace(place) ? L.latLng(place[1], place[0], heights?.[i]) : null));
  };
  const layerOf = (shape, at) => {
    const colour = colourOf(doc, shape), chosen = shape === selected;
    const style = { renderer, color: colour, weight: chosen ? 4 : 3, fillOpacity: chosen ? .16 : .1, dashArray: shape.startsWith("no_fly") ? "8 5" : null, bubblingMouseEvents: false };
    if (shape === "route") {
      addBand(L.polyline(at, { renderer, interactive: false, color: colour, opacity: .16, lineCap: "round" }), 2 * doc.route.corridor_half_width_m, at[0].lat);
      return L.polyline(at, { ...style, fill: false });
    }
    if (isCircle(doc, shape)) return L.circle(at[0], { ...style, radius: Math.max(1, memberAt(doc, shape).circle.radius_m || 0) });
    addBand(L.polygon(at, { renderer, interactive: false, color: colour, opacity: .16, fill: false, lineJoin: "round" }), 2 * memberAt(doc, shape).buffer_m, at[0].lat);
    return L.polygon(at, style);
  };
  const showTakeoff = (at) => {
    const icon = L.divIcon({ className: "takeoff-mark", html: "", iconSize: [26, 26] });
    const marker = L.marker(at, { icon, draggable: true, keyboard: false, title: "take-off", alt: "take-off" }).addTo(parts);
    marker.getElement().textContent = "T";
    marker.on("click", () => onSelect("takeoff", 0));
    marker.on("drag", (event) => snapTo(marker, event));
    marker.on("dragend", () => finishDrag(marker.getLatLng(), () => onPoints("takeoff", [marker.getLatLng()])));
  };
  const addLabel = (shape, layer) => {
    const label = document.createElement("span");
    label.textContent = memberAt(doc, shape).id ?? nameOf(doc, shape);
    layer.bindTooltip(label, { permanent: true, ...(isCircle(doc, shape) ? { direction: "top", offset: [0, -12] } : { direction: "center" }), className: "object-label" });
  };
  const redraw = () => {
    if (tool) return;
    parts.eachLayer((layer) => layer.disableEdit?.());
    for (const group of [grounds, parts, marks]) group.clearLayers();
    bands.length = 0;
    route = null;
    if (!doc) return;
    for (const shape of shapesOf(doc)) {
      const at = latLngs(shape);
      if (at.length === 0 || at.includes(null)) continue;
      if (shape === "takeoff") { showTakeoff(at[0]); continue; }
      const layer = layerOf(shape, at).addTo(parts);
      layer.part = shape;
      if (shape === "route") route = layer; else addLabel(shape, layer);
      layer.on("click", () => { if (!justDragged()) onSelect(shape, null); });
      layer.on("mousedown", (event) => dragPart(layer, event));
      if (shape === selected) layer.enableEdit(map);
    }
    route?.bringToFront();  // else the areas that it crosses would be clicked
    const chosen = selected && point !== null ? latLngs(selected)[point] : null;
    if (chosen) L.circleMarker(chosen, { interactive: false, radius: 13, color: "#0a0f14", weight: 3, fill: false }).addTo(marks);
    setWidths();
  };

  // ---- Snapping

  const nearestOnLine = (at, a, b) => {
    const along = b.subtract(a), length2 = along.x ** 2 + along.y ** 2;
    const share = length2 === 0 ? 0 : Math.min(1, Math.max(0, ((at.x - a.x) * along.x + (at.y - a.y) * along.y) / length2));
    return a.add(along.multiplyBy(share));
  };
  // The place of another part's point that is nearest, or else on its line; null for none within reach.
  const snapPlace = (latlng, event, own) => {
    if (!snapping || event?.altKey || !doc) return null;
    const project = (place) => map.project(place, map.getZoom()), at = project(latlng);
    let best = null, reach = snapPoint_px;
    const lines = [];
    for (const shape of shapesOf(doc)) {
      if (shape === own) continue;
      const places = latLngs(shape).filter(Boolean);
      for (const place of places) {
        const distance = project(place).distanceTo(at);
        if (distance < reach) { reach = distance; best = L.latLng(place.lat, place.lng); }
      }
      places.forEach((place, i) => {
        const next = places[i + 1] ?? (isRing(doc, shape) ? places[0] : null);
        if (next) lines.push([project(place), project(next)]);
      });
    }
    if (best) return best;
    reach = snapLine_px;
    for (const [a, b] of lines) {
      const on = nearestOnLine(at, a, b), distance = on.distanceTo(at);
      if (distance < reach) { reach = distance; best = map.unproject(on, map.getZoom()); }
    }
    return best;
  };
  // A marker that is being dragged jumps there.
  const snapTo = (marker, event) => {
    snapped = snapPlace(map.layerPointToLatLng(L.DomUtil.getPosition(marker._icon)), event.originalEvent, marker.editor ? selected : "takeoff");
    if (!snapped) return;
    L.DomUtil.setPosition(marker._icon, map.project(snapped).subtract(map.getPixelOrigin()));
    marker._latlng.lat = snapped.lat, marker._latlng.lng = snapped.lng;
  };
  // To a centimetre; exactly to what it snapped to.
  const finishDrag = (latlng, tell) => {
    const [lng, lat] = roundedPlace(snapped ?? latlng);
    latlng.lat = snapped?.lat ?? lat, latlng.lng = snapped?.lng ?? lng;
    snapped = null;
    draggedAt = performance.now();
    setTimeout(tell);  // not while Leaflet still works on the marker that the next show() removes
  };

  // ---- Editing

  const placesOf = (layer) => {
    let list = layer.getLatLngs();
    while (Array.isArray(list[0])) [list] = list;
    return list;
  };
  const tellOf = (layer) => {
    if (layer.getRadius) return onRadius(layer.part, roundedPlace(layer.getLatLng()), Math.round(layer.getRadius() * 10) / 10);
    return onPoints(layer.part, placesOf(layer));
  };
  let added = null;  // a point halfway that is pressed, and will mostly be dragged
  map.on("editable:vertex:new", ({ vertex, layer }) => {
    if (tool) return;
    added = vertex;
    const settle = () => setTimeout(() => { if (added === vertex) { added = null; tellOf(layer); } }, 50);
    addEventListener("pointerup", settle, { once: true });
  });
  map.on("editable:vertex:dragstart", ({ vertex, layer }) => {
    if (added === vertex) added = null;
    if (!tool && !layer.getRadius) point = vertex.getIndex();
  });
  map.on("editable:vertex:drag", (event) => { if (!event.layer.getRadius) snapTo(event.vertex, event); });
  map.on("editable:vertex:dragend", ({ vertex, layer }) => finishDrag(vertex.latlng, () => tellOf(layer)));
  map.on("editable:vertex:rawclick", (event) => {
    event.cancel();  // Leaflet.Editable would delete the point
    if (!tool) onSelect(event.layer.part, event.layer.getRadius ? 0 : event.vertex.getIndex());
  });

  // ---- A whole part: dragged where it has no handle, or moved by Ctrl and arrow keys

  // By pixels of the map; the points keep their heights.
  const shifted = (places, by) => places.map((place) => {
    const [lng, lat] = roundedPlace(map.unproject(map.project(place).add(by)));
    return L.latLng(lat, lng, place.alt);
  });
  const tellPart = (shape, places, key = null) => onPoints(shape, places, key);
  function dragPart(layer, { containerPoint: from, originalEvent }) {
    if (tool || layer.part !== selected || originalEvent.button !== 0) return;
    map.dragging.disable();
    const places = latLngs(layer.part);
    let by = null;
    const move = ({ containerPoint }) => {
      if (!by && containerPoint.distanceTo(from) < leastDrag_px) return;
      by = containerPoint.subtract(from);
      if (layer.editEnabled()) layer.disableEdit();
      const at = shifted(places, by);
      if (layer.getRadius) layer.setLatLng(at[0]); else layer.setLatLngs(at);
    };
    const end = () => {
      map.off("mousemove", move);
      map.dragging.enable();
      if (!by) return;
      draggedAt = performance.now();
      setTimeout(() => tellPart(layer.part, shifted(places, by)));
    };
    map.on("mousemove", move);
    addEventListener("mouseup", end, { once: true });
  }
  // A finger on the selected part does what the mouse does. Leaflet hears no mouse while a finger moves, and leaves events that
  // are marked so to others: the map itself is dragged by its own touch events.
  for (const [pointer, mouse] of Object.entries({ pointerdown: "mousedown", pointermove: "mousemove", pointerup: "mouseup", pointercancel: "mouseup" })) {
    container.addEventListener(pointer, (event) => {
      if (event.pointerType !== "touch" || !event.isPrimary || tool || !selected) return;
      const { clientX, clientY, target } = event;
      target.dispatchEvent(Object.assign(new MouseEvent(mouse, { bubbles: true, clientX, clientY }), { _simulated: true }));
    });
  }
  const movePart = (event) => {
    const step = event.shiftKey ? keyStride_px : keyStep_px, [x, y] = arrows[event.key], places = latLngs(selected);
    if (places.includes(null) || places.length === 0) return;
    const at = shifted(places, L.point(x * step, y * step));
    tellPart(selected, at, "keys of all");
    if (!map.getBounds().intersects(L.latLngBounds(at))) map.panTo(L.latLngBounds(at).getCenter(), { animate: false });
  };

  // ---- Drawing

  const setTool = (name) => {
    tool = name;
    container.classList.toggle("asking", name !== null);
    map.doubleClickZoom[name ? "disable" : "enable"]();
    onTool(name, 0);
  };
  const stop = () => {
    const layer = drawn;
    if (!tool) return;
    drawn = null;
    map.editTools.stopDrawing();
    layer?.disableEdit();
    layer?.remove();
    setTool(null);
    redraw();
  };
  const finish = () => {
    const name = tool, places = drawn ? placesOf(drawn).map(roundedPlace) : [], fewest = name === "route" ? 2 : 3;
    if (!drawn) return stop();
    if (places.length < fewest) return onTool(name, places.length, `${name === "route" ? "a route" : "an area"} has at least ${fewest} points`);
    stop();
    return onDrawn(name, places);
  };
  const draw = (name) => {
    stop();
    setTool(name);
    for (const layer of parts.getLayers()) layer.disableEdit?.();
    const style = { color: { route: partColours.route, area: partColours.active }[name] ?? partColours.no_fly, weight: 4 };
    if (name === "route") drawn = map.editTools.startPolyline(undefined, style);
    if (name === "area" || name === "no-fly") drawn = map.editTools.startPolygon(undefined, style);
    container.focus({ preventScroll: true });
  };
  // One place is all: a circle's radius is dragged or typed.
  const takePlace = (latlng) => {
    const name = tool;
    stop();
    onDrawn(name, [roundedPlace(latlng)]);
  };
  map.on("click", ({ latlng, originalEvent }) => {
    if (tool === "circle" || tool === "takeoff") takePlace(snapPlace(latlng, originalEvent) ?? latlng);
    else if (!tool && !justDragged()) onSelect(null, null);
  });
  map.on("editable:drawing:move editable:drawing:click", (event) => {
    const place = tool && event.latlng ? snapPlace(event.latlng, event.originalEvent) : null;
    if (place) event.latlng.lat = place.lat, event.latlng.lng = place.lng;
  });
  map.on("editable:drawing:clicked", () => onTool(tool, placesOf(drawn).length));
  map.on("editable:drawing:commit", () => setTimeout(finish));
  const addMiddle = () => {
    const middle = map.getCenter();
    if (!drawn) return takePlace(middle);
    if (!map.hasLayer(drawn)) drawn.editor.connect();
    drawn.editor.push(L.latLng(middle.lat, middle.lng));
    return onTool(tool, placesOf(drawn).length);
  };
  const takeBack = () => {
    if (drawn && placesOf(drawn).length > 1) drawn.editor.pop();
    onTool(tool, drawn ? placesOf(drawn).length : 0);
  };

  // ---- Keys

  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const moveSelected = (event) => {
    const step = event.shiftKey ? keyStride_px : keyStep_px, [x, y] = arrows[event.key];
    const at = latLngs(selected), from = at[point];
    if (!from) return;
    const to = map.unproject(map.project(from).add([x * step, y * step])), [lng, lat] = roundedPlace(to);
    from.lat = lat, from.lng = lng;
    onPoints(selected, at, "keys");
    if (!map.getBounds().contains(from)) map.panTo(from, { animate: false });
  };
  // Before Leaflet, which would move the map.
  const onKey = (event) => {
    if (event.metaKey || event.altKey || (event.ctrlKey && (tool || !selected || !arrows[event.key]))) return;
    const action = event.ctrlKey ? () => movePart(event) : tool ? { Enter: addMiddle, Backspace: takeBack }[event.key]
      : selected && point !== null && arrows[event.key] ? () => moveSelected(event) : null;
    if (!action) return;
    event.preventDefault();
    event.stopPropagation();
    action();
  };
  container.addEventListener("keydown", onKey, { capture: true });

  return {
    leaflet: map,
    renderer,
    show: (document_, shape, index) => { doc = document_, selected = shape, point = index; redraw(); },
    draw, finish, stop, moveSelectedBy: moveSelected,
    drawing: () => tool,
    pressRoute: (event) => { if (route) dragPart(route, event); },  // on what is drawn over it
    justDragged,
    setSnapping: (wanted) => { snapping = wanted; },
    goTo: (place) => { if (!map.getBounds().contains([place[1], place[0]])) map.panTo([place[1], place[0]], { animate: false }); },
    fit: ([west, south, east, north]) => map.fitBounds(L.latLngBounds([south, west], [north, east]).pad(.15), { animate: false, maxZoom: 18 }),
    middle: () => roundedPlace(map.getCenter()),
  };
};
