// The map: the package's tiles, the planned route, the flown track, the ellipse that holds the aircraft with 95 %, and the
// aircraft. Web Mercator; the world is 1 wide, y grows south.

const sourceColours = { satellite_anchored: "#067a4f", vo_extrapolated: "#0a58ca", dead_reckoned: "#ff8a00", no_fix: "#5b6570" };
const sigmasOf95 = 2.448;
const tileSize = 256;

const worldOf = (lon, lat) => ({ x: (lon + 180) / 360, y: .5 - Math.asinh(Math.tan(lat * Math.PI / 180)) / (2 * Math.PI) });

const makeTiles = (onChange) => {
  const held = new Map(), limit = 300, atOnce = 6;
  const wanted = [];
  let loading = 0;
  const next = async () => {
    if (loading >= atOnce || wanted.length === 0) return;
    const key = wanted.pop();
    ++loading;
    try {
      const response = await call("/v1/tiles/" + key);
      if (response.ok) {
        held.set(key, await createImageBitmap(await response.blob()));
        onChange();
      } else if (response.status !== 404) {
        held.delete(key);  // asked again when it is next looked for
      }
    } catch { held.delete(key); }
    --loading;
    next();
  };
  return {
    get: (key) => {
      if (held.has(key)) {
        const image = held.get(key);
        held.delete(key);
        held.set(key, image);  // the last one used is the last one to go
        return image;
      }
      held.set(key, null);
      for (const old of held.keys()) {
        if (held.size <= limit) break;
        held.get(old)?.close();
        held.delete(old);
      }
      wanted.push(key);
      if (wanted.length > 60) held.delete(wanted.shift());
      next();
      return null;
    },
    peek: (key) => held.get(key) ?? null,
  };
};

const makeMap = () => {
  const canvas = document.getElementById("canvas"), context = canvas.getContext("2d");
  const shown = { package: null, track: [], state: null };
  let view = { x: .5, y: .5, zoom: 2 }, following = true, placed = false, planned = false;

  let due = false;
  const redraw = () => {
    if (due) return;
    due = true;
    requestAnimationFrame(() => { due = false; draw(); });
  };
  const tiles = makeTiles(redraw);

  const scaleOf = () => tileSize * 2 ** view.zoom;
  const screen = (point) => [(point.x - view.x) * scaleOf() + canvas.clientWidth / 2, (point.y - view.y) * scaleOf() + canvas.clientHeight / 2];
  const latitude = () => Math.atan(Math.sinh((.5 - view.y) * 2 * Math.PI));
  const metresPerPixel = () => 40075016.686 * Math.cos(latitude()) / scaleOf();

  const drawTiles = () => {
    const pack = shown.package;
    if (!pack?.accepted || pack.tiles === 0) return;
    const level = Math.min(pack.max_zoom, Math.max(pack.min_zoom, Math.round(view.zoom + Math.log2(devicePixelRatio || 1) - .3)));
    const side = scaleOf() / 2 ** level;
    if (side < 24) return;
    const [left, top] = screen({ x: 0, y: 0 });
    const first = (offset) => Math.max(0, Math.floor(-offset / side));
    const last = (offset, size) => Math.min(2 ** level - 1, Math.floor((size - offset) / side));
    context.imageSmoothingQuality = "high";
    for (let y = first(top); y <= last(top, canvas.clientHeight); ++y) {
      for (let x = first(left); x <= last(left, canvas.clientWidth); ++x) {
        const box = [left + x * side, top + y * side, side + .6, side + .6];
        const image = tiles.get(`${level}/${x}/${y}`);
        if (image) { context.drawImage(image, ...box); continue; }
        for (let up = 1; up <= 4 && level - up >= pack.min_zoom; ++up) {
          const parent = tiles.peek(`${level - up}/${x >> up}/${y >> up}`);
          if (!parent) continue;
          const part = tileSize / 2 ** up;
          context.drawImage(parent, (x % 2 ** up) * part, (y % 2 ** up) * part, part, part, ...box);
          break;
        }
      }
    }
  };

  const stroke = (points, colour, width, dash = []) => {
    context.beginPath();
    points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.setLineDash(dash);
    context.lineJoin = context.lineCap = "round";
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.stroke();
    context.setLineDash([]);
  };

  const drawRoute = () => {
    if (!shown.package?.route?.length) return;
    const points = shown.package.route.map(([lon, lat]) => screen(worldOf(lon, lat)));
    stroke(points, "rgba(10, 15, 20, .75)", 4);
    stroke(points, "#ffffff", 2, [7, 7]);
  };

  const drawTrack = () => {
    const points = shown.track.map((point) => screen(point.world));
    if (points.length < 2) return;
    stroke(points, "#ffffff", 8);
    for (let start = 0; start < points.length - 1;) {  // one stroke for each run of one source
      let end = start + 1;
      while (end < points.length - 1 && shown.track[end + 1].source === shown.track[start + 1].source) ++end;
      stroke(points.slice(start, end + 1), sourceColours[shown.track[start + 1].source], 4.5);
      start = end;
    }
  };

  const drawAircraft = () => {
    const state = shown.state;
    if (!state?.position) return;
    const colour = sourceColours[state.source], [x, y] = screen(worldOf(state.position.lon, state.position.lat));
    const ellipse = state.position.ellipse, radius = (metres) => Math.max(2, sigmasOf95 * metres / metresPerPixel());
    context.beginPath();
    context.ellipse(x, y, radius(ellipse.major_m), radius(ellipse.minor_m), (ellipse.bearing_deg - 90) * Math.PI / 180, 0, 2 * Math.PI);
    context.fillStyle = colour + "38";
    context.fill();
    context.lineWidth = 5;
    context.strokeStyle = "#ffffff";
    context.stroke();
    context.lineWidth = 2.5;
    context.strokeStyle = colour;
    context.stroke();

    context.save();
    context.translate(x, y);
    context.beginPath();
    if (state.heading_deg === null) {
      context.arc(0, 0, 9, 0, 2 * Math.PI);
    } else {
      context.rotate(state.heading_deg * Math.PI / 180);
      for (const [dx, dy] of [[0, -19], [13, 14], [0, 7], [-13, 14]]) context.lineTo(dx, dy);
      context.closePath();
    }
    context.lineJoin = "round";
    context.lineWidth = 5;
    context.strokeStyle = "#ffffff";
    context.stroke();
    context.fillStyle = colour;
    context.fill();
    context.lineWidth = 1.6;
    context.strokeStyle = "#0a0f14";
    context.stroke();
    context.restore();
  };

  const drawScale = () => {
    const wanted = metresPerPixel() * 110, power = 10 ** Math.floor(Math.log10(wanted));
    const metres = [5, 2, 1].find((n) => n * power <= wanted) * power;
    document.getElementById("scale").textContent = metres >= 1000 ? metres / 1000 + " km" : metres + " m";
    document.getElementById("scale-bar").style.width = metres / metresPerPixel() + "px";
  };

  const draw = () => {
    const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    drawTiles();
    drawRoute();
    drawTrack();
    drawAircraft();
    drawScale();
  };

  const follow = (wanted) => {
    following = wanted;
    document.getElementById("follow").setAttribute("aria-pressed", wanted);
    if (wanted && shown.state?.position) centre(shown.state.position.lon, shown.state.position.lat);
    redraw();
  };
  const centre = (lon, lat) => { view = { ...view, ...worldOf(lon, lat) }; };
  // Keeps the place under (x, y) where it is.
  const zoomBy = (steps, x = canvas.clientWidth / 2, y = canvas.clientHeight / 2) => {
    if (following) { x = canvas.clientWidth / 2; y = canvas.clientHeight / 2; }
    const dx = x - canvas.clientWidth / 2, dy = y - canvas.clientHeight / 2, before = scaleOf();
    view.zoom = Math.min(22, Math.max(1, view.zoom + steps));
    view.x += dx / before - dx / scaleOf();
    view.y += dy / before - dy / scaleOf();
    redraw();
  };
  const panBy = (dx, dy) => {
    if (following) follow(false);
    view.x -= dx / scaleOf();
    view.y -= dy / scaleOf();
    redraw();
  };

  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, event);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const other = [...fingers.values()].find((finger) => finger.pointerId !== event.pointerId);
    fingers.set(event.pointerId, event);
    if (!other) return panBy(event.clientX - before.clientX, event.clientY - before.clientY);
    const distance = (finger) => Math.hypot(finger.clientX - other.clientX, finger.clientY - other.clientY) || 1;
    const box = canvas.getBoundingClientRect();
    zoomBy(Math.log2(distance(event) / distance(before)), (event.clientX + other.clientX) / 2 - box.left, (event.clientY + other.clientY) / 2 - box.top);
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoomBy(-event.deltaY / 300, event.offsetX, event.offsetY);
  }, { passive: false });
  document.getElementById("closer").onclick = () => zoomBy(1);
  document.getElementById("farther").onclick = () => zoomBy(-1);
  document.getElementById("follow").onclick = () => follow(!following);
  new ResizeObserver(redraw).observe(canvas);

  return {
    setPackage: (pack) => {
      shown.package = pack;
      if (pack.bounds && !planned && !placed) {
        planned = true;
        const [west, south, east, north] = pack.bounds, a = worldOf(west, north), b = worldOf(east, south);
        view.x = (a.x + b.x) / 2;
        view.y = (a.y + b.y) / 2;
        view.zoom = Math.log2(Math.min(canvas.clientWidth / (b.x - a.x), canvas.clientHeight / (b.y - a.y)) / tileSize);
      }
      redraw();
    },
    setTrack: (track) => {
      shown.track = track.map(({ lon, lat, source }) => ({ world: worldOf(lon, lat), source }));
      redraw();
    },
    setState: (state) => {
      const before = shown.state;
      shown.state = state;
      if (state.position) {
        const { lon, lat } = state.position;
        if (state.version !== before?.version) shown.track.push({ world: worldOf(lon, lat), source: state.source });
        if (shown.track.length > 4000) shown.track.splice(0, 1000);
        if (!placed) { placed = true; view.zoom = Math.min(17, (shown.package?.max_zoom ?? 17) - .4); }
        if (following) centre(lon, lat);
      }
      redraw();
    },
  };
};
