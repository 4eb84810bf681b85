// Joins the parts. What is shown is live or marked as stale.

const eventsBefore = 300;  // that are read again when a flight is opened: its log, and whether it needs help
const pageOfEstimates = 5000;

const kinds = ["online", "refined", "adjusted"];

let shown = null;  // the open flight: id, head, online estimates, tracks by kind, verdicts
const sign = makeContact(() => shown !== null);

const map = makeFlightMap(byId("map"), { onFrame: (frame) => selectFrame(frame), onPlace: (lat, lon) => fixTools.onPlace(lat, lon),
                                         onObject: (id) => byId("objects").querySelector(`[data-sighting="${id}"]`)?.focus() });

// ---- The list

let packages = [];
const refreshList = async () => {
  const [flights, packs] = await Promise.all([getJson("/v1/flights"), packages.length ? null : getJson("/v1/packages")]);
  sign();
  showFlights(flights.flights);
  if (packs) { packages = packs.packages; showPackages(packages); }
};
const keepList = async () => {
  for (;;) {
    if (!shown) await refreshList().catch((error) => console.info("list:", error.message));
    await pause(2000);
  }
};

// ---- One flight

const estimatesOf = async (id, kind) => {
  const all = [];
  for (;;) {
    const { estimates } = await getJson(`/v1/flights/${id}/estimates?kind=${kind}&first=${all.length}&limit=${pageOfEstimates}`);
    all.push(...estimates);
    if (estimates.length < pageOfEstimates) return all;
  }
};

// What a kind does not have yet is drawn as it came.
const drawnEstimates = () => {
  const better = shown.tracks[shown.kind];
  return better && shown.kind !== "online" ? shown.online.map((estimate, i) => better[i] ?? estimate) : shown.online;
};
const bestKind = (flight) => kinds.findLast((kind) => flight.tracks[kind]);

const refreshHead = async (flight) => {
  const head = await getJson(`/v1/flights/${flight.id}`);
  if (flight !== shown) return head;
  flight.head = head;
  showFlightHead(head);
  for (const kind of kinds) byId("kind-" + kind).disabled = !head.kinds.includes(kind);
  byId("compare").disabled = head.kinds.length < 2;
  byId("export-colmap").hidden = !head.kinds.includes("adjusted");
  return head;
};
const refreshSegments = async (flight) => {
  const { segments } = await getJson(`/v1/flights/${flight.id}/segments`);
  if (flight === shown) showSegments(segments);
};
const refreshFixes = async (flight) => {
  const { fixes } = await getJson(`/v1/flights/${flight.id}/fixes`);
  if (flight !== shown) return;
  map.setFixes(fixes);
  fixTools.list(fixes);
};
const refreshObjects = (flight) => (flight === shown ? objects.refresh() : Promise.resolve());
// Refined and adjusted estimates, again as they come.
const refreshTracks = async (flight) => {
  const head = await refreshHead(flight), before = bestKind(flight);
  for (const kind of kinds.slice(1)) {
    if (head.kinds.includes(kind)) flight.tracks[kind] = await estimatesOf(flight.id, kind);
  }
  if (flight !== shown) return;
  const best = bestKind(flight);
  imagesOf = null;  // frames that were placed are compared with the map where they are now
  showKind(best !== before && flight.kind === before ? best : flight.kind);
  if (flight.moved) map.showTrack();
  flight.moved = false;
};
// Many events ask for the same: once, soon.
const soon = (work) => {
  let due = null;
  return (flight) => {
    clearTimeout(due);
    due = setTimeout(() => work(flight).catch((error) => console.info(error.message)), 300);
  };
};
const headSoon = soon(refreshHead), segmentsSoon = soon(refreshSegments), fixesSoon = soon(refreshFixes), objectsSoon = soon(refreshObjects),
      tracksSoon = soon(refreshTracks);

// An estimate from the event that its frame causes: variances as the ellipse of GET …/estimates.
const estimateOf = (event) => {
  const estimate = { frame: event.frame, name: event.name, time_s: event.time_s, source: event.source, segment: event.segment, position: null };
  if (event.lat_deg === undefined || event.lat_deg === null) return estimate;
  const { cov_ee_m2: ee, cov_en_m2: en, cov_nn_m2: nn } = event, mean = (ee + nn) / 2, radius = Math.hypot((ee - nn) / 2, en);
  const bearing = 90 - Math.atan2(en, (ee - nn) / 2) * 90 / Math.PI;
  estimate.position = { lat: event.lat_deg, lon: event.lon_deg, sigma_m: event.sigma_m, hpl_m: event.hpl_m ?? null,
                        ellipse: { major_m: Math.sqrt(Math.max(0, mean + radius)), minor_m: Math.sqrt(Math.max(0, mean - radius)), bearing_deg: bearing } };
  return estimate;
};

const showHelp = (text) => {
  byId("help").hidden = !text;
  byId("help-text").textContent = text ?? "";
};

const onEvent = (flight, kind, event) => {
  if (flight !== shown) return;
  showEvent(kind, event);
  if (kind === "frame_processed") {
    const estimate = estimateOf(event);
    flight.verdicts.set(event.frame, event.verdict);
    const known = flight.online[event.frame] !== undefined;
    if (!known) flight.online[event.frame] = estimate;
    if (!known) map.addEstimate(estimate);
    if (event.verdict === "accepted") helped();
    if (!known) {
      flight.head.pictures.processed = Math.max(flight.head.pictures.processed, event.frame + 1);
      showFlightHead(flight.head);
    }
    showFrames();
    segmentsSoon(flight);
    headSoon(flight);
  }
  if (kind === "pictures_accepted" || kind === "processing_blocked" || kind === "diagnosis_changed") headSoon(flight);
  if (kind === "segment_anchored") { helped(); segmentsSoon(flight); }
  if (kind === "segments_merged" || kind === "merge_withdrawn") {
    if (kind === "segments_merged") helped();
    flight.moved = true;  // perhaps by kilometres
    flight.verdicts.clear();  // of looks at other places
    segmentsSoon(flight); tracksSoon(flight); objectsSoon(flight);
  }
  if (kind === "user_fix" || kind === "fix_withdrawn") fixesSoon(flight);
  if (kind === "objects_changed") objectsSoon(flight);
  if (kind === "user_input_needed") {
    candidates.show(event);
    showHelp(`Lost at frame ${event.frame}: ${lostBecause(event)}. Compare the picture with the map, and say where the aircraft was.`);
  }
  if (kind === "frame_refined" || kind === "flight_completed") { tracksSoon(flight); objectsSoon(flight); }
};
const helped = () => { showHelp(null); candidates.hide(); };

const showKind = (kind) => {
  shown.kind = kind;
  for (const name of kinds) byId("kind-" + name).setAttribute("aria-pressed", name === kind);
  map.setEstimates(drawnEstimates());
  showComparison();
  showFrames();
};

// The track as it came beside the best one, or beside the one that is shown.
const distance = (one, other) => Math.hypot(one.lat - other.lat, (one.lon - other.lon) * Math.cos(one.lat * Math.PI / 180)) * metresPerDegree;
const showComparison = () => {
  const wanted = byId("compare").getAttribute("aria-pressed") === "true", here = drawnEstimates();
  const there = shown.kind === "online" ? shown.tracks[bestKind(shown)] : shown.online;
  byId("difference").textContent = "";
  if (!wanted || there === here) return map.setCompared(null);
  map.setCompared(there);
  const moved = here.flatMap((estimate, i) => (estimate.position && there[i]?.position ? [{ frame: i, by: distance(estimate.position, there[i].position) }] : []));
  const found = here.filter((estimate, i) => !estimate.position !== !there[i]?.position).length;
  if (moved.length === 0) return;
  moved.sort((a, b) => a.by - b.by);
  const most = moved.at(-1);
  byId("difference").textContent = `Dashed: ${shown.kind === "online" ? kindWords[bestKind(shown)] : kindWords.online}. Frames differ by ${metres(moved[moved.length >> 1].by)} (median), at most by ${metres(most.by)} (frame ${most.frame})` +
    (found ? `; ${plural(found, "frame")} placed in one of the two only` : "");
};

// ---- Frames

const previews = new Map();  // address of a blob by frame, of the flight that is shown; the last ones used
const previewsKept = 12;
const previewOf = async (frame) => {
  if (previews.has(frame)) return previews.get(frame);
  const flight = shown, response = await call(`/v1/flights/${flight.id}/pictures/${frame}?preview=true`);
  if (!response.ok) throw new Error(`the picture of frame ${frame} cannot be shown`);
  const address = URL.createObjectURL(await response.blob());
  if (flight !== shown) return address;
  previews.set(frame, address);
  for (const [old, stale] of previews) {
    if (previews.size <= previewsKept) break;
    previews.delete(old);
    setTimeout(() => URL.revokeObjectURL(stale), 60000);
  }
  return address;
};
const footprintOf = (frame) => getJson(`/v1/flights/${shown.id}/pictures/${frame}/footprint`);
const currentFrame = () => shown.frame ?? shown.online.length - 1;

// The picture beside the map.
let pictured = null;  // the frame that it shows
const picture = makePictureView(byId("picture-map"), {
  onPixel: (pixel) => { if (!fixTools.onPixel(pixel)) objects.onPixel(pixel); showMarks(); },
  onSharper: async () => {
    const frame = pictured, response = await call(`/v1/flights/${shown.id}/pictures/${frame}`);
    if (response.ok && frame === pictured) picture.sharpen(URL.createObjectURL(await response.blob()));
  },
});
const showMarks = () => {
  if (!shown || byId("picture-part").hidden) return;
  picture.ask(fixTools.asksForPixel() || objects.marking());
  picture.setMarks([...fixTools.marksOf(pictured), ...objects.marksOf(pictured)]);
};
const showPicture = async () => {
  const frame = currentFrame();
  if (byId("picture-part").hidden || frame < 0) return;
  byId("picture-frame").textContent = `Frame ${frame}`;
  if (pictured !== frame) {
    pictured = frame;
    const address = await previewOf(frame);
    if (pictured !== frame) return;
    const { width, height } = shown.head.camera;
    picture.show(address, { width, height });
  }
  showMarks();
};
const openPicture = (focus = false) => {
  const opened = byId("picture-part").hidden;
  byId("picture-part").hidden = false;
  byId("beside").setAttribute("aria-pressed", true);
  if (opened) { pictured = null; picture.clear(); }
  showPicture().then(() => { if (opened) picture.fit(); }).catch((error) => console.info(error.message));
  if (focus) byId("picture-map").focus({ preventScroll: true });
};
const closePicture = () => {
  byId("picture-part").hidden = true;
  byId("beside").setAttribute("aria-pressed", false);
  objects.cancel();
  if (fixTools.asksForPixel()) fixTools.cancel();
};

let imagesOf = null;  // the frame whose images are shown
const setImage = async (id, path, frame) => {
  const image = byId(id);
  let address = "";
  if (path) {
    const response = await call(path);
    if (response.ok) address = URL.createObjectURL(await response.blob());
  }
  if (imagesOf !== frame) return;
  if (image.src.startsWith("blob:")) URL.revokeObjectURL(image.src);
  if (address) image.src = address; else image.removeAttribute("src");
};
const loadImages = async (flight, frame) => {
  const base = `/v1/flights/${flight.id}`, picture = setImage("image-picture", `${base}/pictures/${frame}?preview=true`, frame);
  const look = await getJson(`${base}/looks/${frame}`);
  if (flight !== shown || imagesOf !== frame) return;
  flight.verdicts.set(frame, look.verdict);
  showVerdict(look.verdict, look);
  await Promise.all([picture, setImage("image-seen", look.seen ? `${base}/looks/${frame}/seen` : "", frame),
                     setImage("image-map", look.map ? `${base}/looks/${frame}/map` : "", frame)]);
};
let imageTimer = null;
const showImages = (frame) => {
  if (imagesOf === frame) return;
  imagesOf = frame;
  clearTimeout(imageTimer);
  imageTimer = setTimeout(() => {
    if (shown && imagesOf === frame) loadImages(shown, frame).catch((error) => console.info(error.message));
  }, 150);
};

const showFrames = () => {
  const last = shown.online.length - 1, frame = shown.frame ?? last;
  byId("frame").max = Math.max(0, last);
  byId("frame").value = Math.max(0, frame);
  byId("live").setAttribute("aria-pressed", shown.frame === null);
  const estimate = drawnEstimates()[frame] ?? shown.online[frame];
  showFigures(estimate);
  if (imagesOf !== frame) showVerdict(shown.verdicts.get(frame));
  if (estimate) showImages(frame);
  showPicture().catch((error) => console.info(error.message));
};
// null: the latest, whatever comes.
const selectFrame = (frame) => {
  if (!shown) return;
  shown.frame = frame === null ? null : Math.min(Math.max(0, frame), Math.max(0, shown.online.length - 1));
  map.select(shown.frame);
  showFrames();
};
const step = (by) => selectFrame((shown.frame ?? shown.online.length - 1) + by);

// ---- Fixes

const numberIn = (id) => {
  const text = byId(id).value.trim().replace(",", "."), value = Number(text);
  if (text === "" || !Number.isFinite(value)) throw new Error(`${byId(id).closest("label").firstChild.data.trim()} must be a number`);
  return value;
};

const history = makeHistory({
  onChange: (canUndo, canRedo) => { byId("undo").disabled = !canUndo; byId("redo").disabled = !canRedo; },
  onProblem: (text) => { byId("history-answer").textContent = text; },
});
const fixTools = makeFixTools({
  map, openPicture, closePicture, flight: () => shown, frame: currentFrame, footprintOf, previewOf, history,
  onChange: () => { fixesSoon(shown); showMarks(); },
});
const objects = makeObjects({
  map, openPicture: (wanted) => { if (wanted) { fixTools.cancel(); openPicture(true); } else showMarks(); },
  flight: () => shown, frame: currentFrame, history, onMarks: showMarks, onFrame: (frame) => selectFrame(frame),
});
const candidates = makeCandidates({
  pack: () => shown?.pack, footprintOf, previewOf,
  onChoose: (frame, candidate) => fixTools.give({ lat: candidate.lat_deg, lon: candidate.lon_deg, frame, radius_m: candidateRadius }, "candidate chosen")
    .then(() => { helped(); map.goTo(candidate.lat_deg, candidate.lon_deg); }).catch((problem) => { byId("fix-answer").textContent = problem.message; }),
});
const candidateRadius = 50;  // m; around a place that a person recognised in the map, not measured

// ---- Opening and creating

const reopenAfter = 1000;  // ms
const openFlight = async (id) => {
  shown?.ended.abort();
  const flight = { id, online: [], tracks: {}, verdicts: new Map(), kind: "online", frame: null, head: null, pack: null, ended: new AbortController() };
  flight.tracks.online = flight.online;
  shown = flight;
  imagesOf = pictured = null;
  for (const address of previews.values()) URL.revokeObjectURL(address);
  previews.clear();
  picture.clear();
  for (const name of ["picture", "seen", "map"]) byId("image-" + name).removeAttribute("src");
  for (const name of ["events", "refusals"]) byId(name).replaceChildren();
  for (const name of ["upload", "fix-answer", "history-answer"]) byId(name).textContent = "";
  helped();
  closePicture();
  fixTools.cancel();
  objects.clear();
  history.clear();
  map.clear();
  const head = await refreshHead(flight);
  if (flight !== shown) return;
  byId("list").hidden = true;
  byId("flight").hidden = byId("legend").hidden = false;
  if (packages.length === 0) packages = (await getJson("/v1/packages")).packages;
  flight.pack = packages.find((pack) => pack.name === head.package && pack.accepted) ?? null;
  map.setPackage(flight.pack);
  flight.online.push(...await estimatesOf(id, "online"));
  for (const kind of kinds.slice(1)) {
    if (head.kinds.includes(kind)) flight.tracks[kind] = await estimatesOf(id, kind);
  }
  if (flight !== shown) return;
  showKind(bestKind(flight));
  await Promise.all([refreshSegments(flight), refreshFixes(flight), refreshObjects(flight)]);
  let opened = false;
  followEvents(`/v1/flights/${id}/events`, {
    onOpen: async () => {
      if (opened) { await refreshHead(flight); return undefined; }
      opened = true;
      return String(Math.max(0, head.last_event - eventsBefore));
    },
    onMessage: (kind, data) => onEvent(flight, kind, data),
    onSign: sign,
    ended: flight.ended.signal,
  });
};
const closeFlight = () => {
  shown?.ended.abort();
  closePicture();
  fixTools.cancel();
  shown = null;
  map.clear();
  map.setPackage(null);
  document.title = "Nadir desk";
  byId("list").hidden = false;
  byId("flight").hidden = byId("legend").hidden = true;
  refreshList().catch((error) => console.info(error.message));
};
const followAddress = () => {
  const id = location.hash.slice(1);
  // From the missions' room: a flight with the package that was made there.
  if (id.startsWith("package=")) {
    packages = [];
    refreshList().then(() => showCreate(decodeURIComponent(id.slice("package=".length)))).catch((error) => console.info(error.message));
    return closeFlight();
  }
  if (!/^[0-9a-f]{12}$/.test(id)) return closeFlight();
  // A connection that breaks meanwhile is no reason to leave the flight; an answer that says no is.
  openFlight(id).catch((error) => {
    console.info(error.message);
    if (location.hash !== "#" + id) return;
    if (error instanceof ConnectionLost) setTimeout(() => { if (location.hash === "#" + id && shown?.id === id) followAddress(); }, reopenAfter);
    else location.hash = "";
  });
};

makePhotoImport({
  packages: () => packages,
  onFlight: ({ flight, pictures, findings }) => {
    location.hash = flight.id;
    const assumed = findings.map(({ expected, found }) => `${expected}: ${found}`);
    setTimeout(() => {
      byId("upload").textContent = `${pictures.accepted} accepted, ${pictures.refused} refused`;
      byId("refusals").replaceChildren(...pictures.pictures.filter(({ problem }) => problem).map(({ name, problem, reason }) => element("li", {}, `${name}: ${words(problem)}, ${reason}`)),
        ...assumed.map((text) => element("li", {}, text)));
    }, 300);
  },
});

const showCreate = (chosen) => {
  byId("create-package").replaceChildren(element("option", { value: "" }, "none: odometry alone"),
    ...packages.filter((pack) => pack.accepted).map((pack) => element("option", { value: pack.name }, pack.name)));
  byId("create-package").selectedIndex = byId("create-package").length > 1 ? 1 : 0;
  if (packages.some((pack) => pack.accepted && pack.name === chosen)) byId("create-package").value = chosen;
  byId("create-problem").textContent = "";
  byId("create").showModal();
};
byId("new").addEventListener("click", () => showCreate(null));
byId("create-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  try {
    const body = { name: byId("create-name").value, camera: await byId("create-camera").files[0].text() };
    if (byId("create-package").value) body.package = byId("create-package").value;
    if (byId("create-lat").value || byId("create-lon").value) body.start = { lat: numberIn("create-lat"), lon: numberIn("create-lon") };
    const flight = await postJson("/v1/flights", body);
    byId("create").close();
    location.hash = flight.id;
  } catch (problem) {
    byId("create-problem").textContent = problem.message;
  }
});
byId("pictures-form").addEventListener("submit", (event) => {
  event.preventDefault();
  byId("pictures").close();
  const flight = shown.id;
  sendPictures(flight, byId("picture-files").files, byId("telemetry-file").files[0]).catch((problem) => { byId("upload").textContent = problem.message; });
});

for (const link of document.querySelectorAll("[data-export]")) {
  link.addEventListener("click", () => saveFile(`/v1/flights/${shown.id}/${link.dataset.export}`, shown.id).catch((error) => console.info(error.message)));
}

byId("home").addEventListener("click", (event) => { event.preventDefault(); location.hash = ""; });
byId("add").addEventListener("click", () => byId("pictures").showModal());
byId("create-cancel").addEventListener("click", () => byId("create").close());
byId("pictures-cancel").addEventListener("click", () => byId("pictures").close());
byId("complete").addEventListener("click", () => postJson(`/v1/flights/${shown.id}/complete`).then(() => refreshHead(shown)).catch((problem) => { byId("upload").textContent = problem.message; }));
byId("whole").addEventListener("click", () => map.showTrack());
byId("segments").addEventListener("click", ({ target }) => {
  const segment = target.dataset.takeBack, flight = shown;
  if (segment !== undefined) callJson("DELETE", `/v1/flights/${flight.id}/segments/${segment}/merge`).then(() => refreshSegments(flight)).catch((problem) => console.info(problem.message));
});
byId("frame").addEventListener("input", () => selectFrame(Number(byId("frame").value)));
byId("previous").addEventListener("click", () => step(-1));
byId("next").addEventListener("click", () => step(1));
byId("live").addEventListener("click", () => selectFrame(null));
for (const kind of kinds) byId("kind-" + kind).addEventListener("click", () => showKind(kind));
byId("compare").addEventListener("click", () => {
  byId("compare").setAttribute("aria-pressed", byId("compare").getAttribute("aria-pressed") !== "true");
  showComparison();
});
byId("beside").addEventListener("click", () => (byId("picture-part").hidden ? openPicture() : closePicture()));
byId("picture-close").addEventListener("click", closePicture);
byId("undo").addEventListener("click", history.undo);
byId("redo").addEventListener("click", history.redo);
byId("all-ellipses").addEventListener("click", () => {
  const wanted = byId("all-ellipses").getAttribute("aria-pressed") !== "true";
  byId("all-ellipses").setAttribute("aria-pressed", wanted);
  map.showAllUncertainties(wanted);
});
document.addEventListener("keydown", (event) => {
  if (!shown || event.altKey || document.querySelector("dialog[open]")) return;
  if (event.key === "Escape") { fixTools.cancel(); objects.cancel(); showMarks(); return; }
  if (event.target.matches("input:not([type=range]), select, textarea")) return;
  const key = event.key.toLowerCase(), redo = key === "y" || (key === "z" && event.shiftKey);
  if (event.ctrlKey || event.metaKey) {
    if (key !== "z" && key !== "y") return;
  }
  const action = { p: () => step(-1), n: () => step(1), l: () => selectFrame(null), w: () => map.showTrack(), f: () => fixTools.begin("pair"),
                   d: () => fixTools.begin("drag"), g: () => fixTools.begin("place"), o: objects.begin, b: () => byId("beside").click(),
                   c: () => { if (!byId("compare").disabled) byId("compare").click(); }, z: redo ? history.redo : history.undo, y: history.redo }[key];
  if (!action) return;
  event.preventDefault();
  action();
});
window.addEventListener("hashchange", followAddress);
followAddress();
keepList();
