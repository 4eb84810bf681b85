// A mission's document (the members of mission.yaml) and its parts. A part is named by its path, as findings name it:
// "route", "takeoff", "sectors[0]", "no_fly[2]"; "route.points[3]" is a point of one. A document may be incomplete.

const partsOf = (path) => path.match(/[^.[\]]+/g) ?? [];
const memberAt = (doc, path) => partsOf(path).reduce((at, part) => at?.[part], doc);
// undefined removes it.
const setMember = (doc, path, value) => {
  const parts = partsOf(path), last = parts.pop(), at = parts.reduce((inside, part) => inside[part] ??= {}, doc);
  if (value === undefined) delete at[last]; else at[last] = value;
};

const feetPerMetre = 1 / 0.3048;
const roundedPlace = ({ lat, lng }) => [Math.round(lng * 1e7) / 1e7, Math.round(lat * 1e7) / 1e7];  // a centimetre

const isPlace = (point) => Array.isArray(point) && point.length === 2 && point.every(Number.isFinite) && Math.abs(point[1]) <= 85;
const isClosed = (ring) => ring.length > 1 && String(ring[0]) === String(ring.at(-1));
const openRing = (ring) => (Array.isArray(ring) ? (isClosed(ring) ? ring.slice(0, -1) : ring) : []);
const closedRing = (points) => (points.length > 0 ? [...points, points[0]] : []);

const sectorsOf = (doc) => (Array.isArray(doc.sectors) ? doc.sectors : []);
const noFlyOf = (doc) => (Array.isArray(doc.no_fly) ? doc.no_fly : []);
// The parts that are on the map, as paths.
const shapesOf = (doc) => ["route", ...sectorsOf(doc).map((_, i) => `sectors[${i}]`), ...noFlyOf(doc).map((_, i) => `no_fly[${i}]`), "takeoff"];
const isCircle = (doc, shape) => shape.startsWith("no_fly") && Boolean(memberAt(doc, shape)?.circle);
const isRing = (doc, shape) => (shape.startsWith("sectors") || shape.startsWith("no_fly")) && !isCircle(doc, shape);
const fewestPoints = (doc, shape) => (shape === "route" ? 2 : isRing(doc, shape) ? 3 : 1);
const nameOf = (doc, shape) => (shape === "route" ? "route" : shape === "takeoff" ? "take-off" : `${shape.startsWith("sectors") ? "area" : "no-fly area"} ${memberAt(doc, shape)?.id ?? ""}`.trim());

// [longitude, latitude] of each point; of a ring without the last one, which is the first again.
const pointsOf = (doc, shape) => {
  const part = memberAt(doc, shape);
  const place = shape === "takeoff" ? part : part?.circle;
  if (place) return [[place.lon_deg, place.lat_deg]];
  return shape === "route" ? part?.points ?? [] : openRing(part?.polygon);
};
const setPoints = (doc, shape, points) => {
  const part = memberAt(doc, shape);
  if (shape === "takeoff" || part?.circle) {
    const place = { lon_deg: points[0][0], lat_deg: points[0][1] };
    if (shape === "takeoff") doc.takeoff = place; else Object.assign(part.circle, place);
  } else if (shape === "route") {
    part.points = points;
  } else {
    part.polygon = closedRing(points);
  }
};
const heightsOf = (doc, shape) => (shape === "route" ? doc.route?.heights?.m ?? null : null);
// What each height of the route is counted from, where that differs from point to point; otherwise null.
const framesOf = (doc, shape) => (shape === "route" ? doc.route?.heights?.frames ?? null : null);
const eachItsOwn = "each";  // the height frame of such a route, for people

// What a new point of the route gets: halfway between its neighbours.
const heightBetween = (before, after, otherwise) => {
  const known = [before, after].filter(Number.isFinite);
  return known.length > 0 ? Math.round(known.reduce((a, b) => a + b) / known.length * 10) / 10 : otherwise;
};
const insertPoint = (doc, shape, index, point) => {
  const heights = heightsOf(doc, shape);
  const frames = framesOf(doc, shape), frame = frames?.[index - 1] ?? frames?.[index];
  const same = !frames || frames[index - 1] === frames[index];  // heights of two frames have no middle
  heights?.splice(index, 0, heightBetween(heights[index - 1], same ? heights[index] : undefined, doc.route.agl_m));
  frames?.splice(index, 0, frame ?? "above_ground");
  setPoints(doc, shape, pointsOf(doc, shape).toSpliced(index, 0, point));
};
const removePoint = (doc, shape, index) => {
  heightsOf(doc, shape)?.splice(index, 1);
  framesOf(doc, shape)?.splice(index, 1);
  setPoints(doc, shape, pointsOf(doc, shape).toSpliced(index, 1));
};
const movePoint = (doc, shape, index, point) => setPoints(doc, shape, pointsOf(doc, shape).with(index, point));

// Heights of the points in this frame; "" for none: the route is flown at agl_m.
const heightFrameOf = (doc) => (framesOf(doc, "route") ? eachItsOwn : doc.route?.heights?.frame ?? "");
const setHeightFrame = (doc, frame) => {
  if (frame === heightFrameOf(doc)) return undefined;
  if (frame === "") return setMember(doc, "route.heights", undefined);
  const before = doc.route.heights, points = pointsOf(doc, "route"), m = points.map((_, i) => before?.m[i] ?? doc.route.agl_m);
  doc.route.heights = frame === eachItsOwn ? { frames: points.map(() => before?.frame ?? "above_ground"), m } : { frame, m };
  return undefined;
};

const freeId = (list, prefix) => {
  for (let number = 1; ; ++number) {
    if (!list.some(({ id }) => id === `${prefix}-${number}`)) return `${prefix}-${number}`;
  }
};
const addSector = (doc, points) => { doc.sectors = [...sectorsOf(doc), { id: freeId(sectorsOf(doc), "area"), class: "active", polygon: closedRing(points) }]; };
const addNoFly = (doc, part) => { doc.no_fly = [...noFlyOf(doc), { id: freeId(noFlyOf(doc), "no-fly"), ...part }]; };
const removeShape = (doc, shape) => {
  const [list, index] = partsOf(shape);
  if (shape === "takeoff") return setMember(doc, "takeoff", undefined);
  if (shape === "route") {
    doc.route.points = [];
    return setMember(doc, "route.heights", undefined);
  }
  doc[list] = doc[list].toSpliced(Number(index), 1);
  if (list === "no_fly" && doc.no_fly.length === 0) delete doc.no_fly;
  return undefined;
};

// [west, south, east, north] of all that is drawn, or null.
const boundsOf = (doc) => {
  const all = shapesOf(doc).flatMap((shape) => pointsOf(doc, shape)).filter(isPlace);
  if (all.length === 0) return null;
  const longitudes = all.map(([lon]) => lon), latitudes = all.map(([, lat]) => lat);
  return [Math.min(...longitudes), Math.min(...latitudes), Math.max(...longitudes), Math.max(...latitudes)];
};
