// A frame's picture, beside the map and on it.
//
//   const view = makePictureView(element, { onPixel: ({ x, y }) => …, onSharper: () => … });
//   view.show(address, { width, height });   // of the full picture; the image at the address may be smaller
//   view.ask(true);                          // the next click, or Enter for the middle, is a pixel
//   const laid = makeLaidPicture(map, { onMove: ({ lat, lon }) => …, onDone: () => … });
//   laid.lay(address, corners, { lat, lon }); // on the map by its footprint, to be dragged to where it belongs
//
// Pixels are those of the full picture; the centre of the top-left one is (0, 0).

const previewSide = 1024;  // pixels, the longer side of a preview

const makePictureView = (container, { onPixel, onSharper }) => {
  const { map, renderer } = makeBaseMap(container, { crs: L.CRS.Simple, minZoom: -7, maxZoom: 4, attributionControl: false });
  container.querySelector(".leaflet-control-scale")?.remove();
  map.setView([0, 0], 0);
  const marks = L.layerGroup().addTo(map);
  let overlay = null, size = null, sharp = false, asking = false;
  const bounds = () => [[-(size.height - .5), -.5], [.5, size.width - .5]];
  const take = ({ lat, lng }) => {
    if (!asking || !size || lng < -.5 || lng > size.width - .5 || -lat < -.5 || -lat > size.height - .5) return;
    onPixel({ x: Math.round(lng * 10) / 10, y: Math.round(-lat * 10) / 10 });
  };
  map.on("click", (event) => take(event.latlng));
  container.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || !asking) return;
    event.preventDefault();
    take(map.getCenter());
  });
  map.on("zoomend", () => {
    if (sharp || !size || map.getZoom() < Math.log2(previewSide / Math.max(size.width, size.height)) + .4) return;
    sharp = true;
    onSharper();
  });
  return {
    show: (address, picture) => {
      const other = !size || picture.width !== size.width || picture.height !== size.height;
      size = picture;
      sharp = false;
      overlay?.remove();
      overlay = L.imageOverlay(address, bounds(), { alt: "The picture" }).addTo(map);
      if (other) map.fitBounds(bounds(), { animate: false });
    },
    sharpen: (address) => overlay?.setUrl(address),
    fit: () => { map.invalidateSize({ animate: false }); if (size) map.fitBounds(bounds(), { animate: false }); },
    setMarks: (list) => {
      marks.clearLayers();
      for (const { x, y, text, chosen } of list) {
        const dot = L.circleMarker([-y, x], { renderer, interactive: false, radius: chosen ? 8 : 6, color: chosen ? "#b3140c" : "#862e9c", weight: 3, fill: false });
        const label = document.createElement("span");
        label.textContent = text ?? "";
        if (text) dot.bindTooltip(label, { permanent: true, direction: "right", offset: [8, 0], className: "object-label" });
        dot.addTo(marks);
        L.circleMarker([-y, x], { renderer, interactive: false, radius: 1, color: chosen ? "#b3140c" : "#862e9c" }).addTo(marks);
      }
    },
    ask: (wanted) => { asking = wanted; container.classList.toggle("asking", wanted); },
    clear: () => { overlay?.remove(); overlay = null; size = null; marks.clearLayers(); },
  };
};

// The projective map of a rectangle of w by h to four points, as CSS writes it: top left, top right, bottom right, bottom
// left (Heckbert 1989).
const matrixOf = (w, h, [p0, p1, p2, p3]) => {
  const dx1 = p1.x - p2.x, dx2 = p3.x - p2.x, dx3 = p0.x - p1.x + p2.x - p3.x;
  const dy1 = p1.y - p2.y, dy2 = p3.y - p2.y, dy3 = p0.y - p1.y + p2.y - p3.y;
  const size = dx1 * dy2 - dx2 * dy1, g = (dx3 * dy2 - dx2 * dy3) / size, k = (dx1 * dy3 - dx3 * dy1) / size;
  const a = p1.x - p0.x + g * p1.x, b = p3.x - p0.x + k * p3.x, d = p1.y - p0.y + g * p1.y, e = p3.y - p0.y + k * p3.y;
  return `matrix3d(${[a / w, d / w, 0, g / w, b / h, e / h, 0, k / h, 0, 0, 1, 0, p0.x, p0.y, 0, 1].join(",")})`;
};
// Where the diagonals of a quadrangle meet: what the middle of the picture shows.
const middleOf = ([[ax, ay], [bx, by], [cx, cy], [dx, dy]]) => {
  const ux = cx - ax, uy = cy - ay, vx = dx - bx, vy = dy - by, t = ((bx - ax) * vy - (by - ay) * vx) / (ux * vy - uy * vx);
  return [ax + t * ux, ay + t * uy];
};

const makeLaidPicture = (map, { onMove, onDone }) => {
  const pane = map.createPane("laid-picture");
  pane.classList.add("leaflet-zoom-hide");
  let image = null, corners = null, at = null, turn = 0, grip = null;
  // Turned clockwise by the person, around the middle.
  const turned = () => {
    const [mx, my] = middleOf(corners), c = Math.cos(turn), s = Math.sin(turn);
    return corners.map(([x, y]) => [mx + (x - mx) * c + (y - my) * s, my - (x - mx) * s + (y - my) * c]);
  };
  const draw = () => {
    if (!image?.naturalWidth) return;
    image.style.transform = matrixOf(image.naturalWidth, image.naturalHeight, turned().map(([east, north]) => map.latLngToLayerPoint(placeAt(at, east, north))));
  };
  const tell = () => {
    const [lat, lon] = placeAt(at, ...middleOf(corners));
    onMove({ lat, lon });
  };
  const moveBy = (dx, dy) => {
    const to = map.layerPointToLatLng(map.latLngToLayerPoint([at.lat, at.lon]).add([dx, dy]));
    at = { lat: to.lat, lon: to.lng };
    draw();
    tell();
  };
  const onKey = (event) => {
    const step = event.shiftKey ? 20 : 2;
    const action = { ArrowLeft: () => moveBy(-step, 0), ArrowRight: () => moveBy(step, 0), ArrowUp: () => moveBy(0, -step), ArrowDown: () => moveBy(0, step),
                     "[": () => { turn -= Math.PI / 180; draw(); }, "]": () => { turn += Math.PI / 180; draw(); }, Enter: onDone }[event.key];
    if (!action) return;
    event.preventDefault();
    event.stopPropagation();  // they would move the map
    action();
  };
  map.on("zoomend viewreset moveend", draw);
  const remove = () => { image?.remove(); image = null; };
  return {
    lay: (address, footprint, place) => {
      remove();
      corners = footprint;
      at = place;
      turn = 0;
      image = L.DomUtil.create("img", "laid-picture", pane);
      image.alt = "The picture on the map. Arrow keys move it, with Shift farther; brackets turn it; Enter takes its place.";
      image.tabIndex = 0;
      image.draggable = false;
      image.setAttribute("role", "application");
      image.onload = draw;
      image.src = address;
      L.DomEvent.disableClickPropagation(image);
      image.addEventListener("pointerdown", (event) => { grip = event; image.setPointerCapture(event.pointerId); });
      image.addEventListener("pointermove", (event) => {
        if (!grip) return;
        moveBy(event.clientX - grip.clientX, event.clientY - grip.clientY);
        grip = event;
      });
      for (const end of ["pointerup", "pointercancel"]) image.addEventListener(end, () => { grip = null; });
      image.addEventListener("keydown", onKey);
      image.focus({ preventScroll: true });
      tell();
    },
    remove,
    there: () => image !== null,
  };
};
