// Joins the parts. What is shown is live or marked as stale.

const contactLimit = 6;   // s without a sign from the desk
const eventsBefore = 300;  // that are read again when a flight is opened: its log, and whether it needs help
const pageOfEstimates = 5000;

let shown = null;  // the open flight: id, head, estimates by kind, verdicts
let lastContactAt = performance.now();

const map = makeFlightMap(byId("map"), { onFrame: (frame) => selectFrame(frame), onPlace: (lat, lon) => choosePlace(lat, lon) });

const showContact = () => {
  const silence = (performance.now() - lastContactAt) / 1000, lost = silence > contactLimit;
  document.body.classList.toggle("stale", lost);
  byId("lost").hidden = !lost;
  byId("lost").textContent = lost ? `No contact with the desk for ${duration(silence)}` : "";
  byId("contact").textContent = lost ? "no contact" : shown ? "live" : "";
};
const sign = () => { lastContactAt = performance.now(); };

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

const drawnEstimates = () => shown.kind === "refined" && shown.refined ? shown.refined : shown.online;

const refreshHead = async (flight) => {
  const head = await getJson(`/v1/flights/${flight.id}`);
  if (flight !== shown) return head;
  flight.head = head;
  showFlightHead(head);
  byId("kind-refined").disabled = !head.kinds.includes("refined");
  return head;
};
const refreshSegments = async (flight) => {
  const { segments } = await getJson(`/v1/flights/${flight.id}/segments`);
  if (flight === shown) showSegments(segments);
};
const refreshFixes = async (flight) => {
  const { fixes } = await getJson(`/v1/flights/${flight.id}/fixes`);
  if (flight === shown) map.setFixes(fixes);
};
// Many events ask for the same: once, soon.
const soon = (work) => {
  let due = null;
  return (flight) => {
    clearTimeout(due);
    due = setTimeout(() => work(flight).catch((error) => console.info(error.message)), 300);
  };
};
const headSoon = soon(refreshHead), segmentsSoon = soon(refreshSegments), fixesSoon = soon(refreshFixes);

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
    if (!known && flight.kind === "online") map.addEstimate(estimate);
    if (event.verdict === "accepted") showHelp(null);
    if (!known) {
      flight.head.pictures.processed = Math.max(flight.head.pictures.processed, event.frame + 1);
      showFlightHead(flight.head);
    }
    showFrames();
    segmentsSoon(flight);
    headSoon(flight);
  }
  if (kind === "pictures_accepted" || kind === "processing_blocked") headSoon(flight);
  if (kind === "segment_anchored") { showHelp(null); segmentsSoon(flight); }
  if (kind === "user_fix") fixesSoon(flight);
  if (kind === "user_input_needed") {
    showHelp(`Lost at frame ${event.frame}: ${event.failed_looks} looks in a row found nothing. Compare the picture with the map, and say where the aircraft was.`);
  }
  if (kind === "flight_completed") completed(flight).catch((error) => console.info(error.message));
};

const completed = async (flight) => {
  await refreshHead(flight);
  flight.refined = await estimatesOf(flight.id, "refined");
  if (flight === shown) showKind("refined");
};

const showKind = (kind) => {
  shown.kind = kind;
  for (const name of ["online", "refined"]) byId("kind-" + name).setAttribute("aria-pressed", name === kind);
  map.setEstimates(drawnEstimates());
  showFrames();
};

// ---- Frames

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

const askForPlace = (wanted) => {
  map.askForPlace(wanted);
  byId("ask-place").setAttribute("aria-pressed", wanted);
  byId("asking").hidden = !wanted;
  if (wanted) byId("map").focus();
};
const choosePlace = (lat, lon) => {
  byId("fix-lat").value = lat.toFixed(7);
  byId("fix-lon").value = lon.toFixed(7);
  askForPlace(false);
  byId("fix-radius").focus();
};
const numberIn = (id) => {
  const text = byId(id).value.trim().replace(",", "."), value = Number(text);
  if (text === "" || !Number.isFinite(value)) throw new Error(`${byId(id).closest("label").firstChild.data.trim()} must be a number`);
  return value;
};
byId("fix").addEventListener("submit", async (event) => {
  event.preventDefault();
  const say = (text) => { byId("fix-answer").textContent = text; };
  try {
    const body = { lat: numberIn("fix-lat"), lon: numberIn("fix-lon"), radius_m: numberIn("fix-radius") };
    const frame = shown.frame ?? shown.online.length - 1;
    if (frame >= 0) body.frame = frame;
    const fix = await postJson(`/v1/flights/${shown.id}/fixes`, body);
    say(`stored: applied before frame ${fix.before_frame}, within ${metres(fix.radius_m)}`);
  } catch (problem) {
    say(problem.message);
  }
});

// ---- Opening and creating

const openFlight = async (id) => {
  shown?.ended.abort();
  const flight = { id, online: [], refined: null, verdicts: new Map(), kind: "online", frame: null, head: null, ended: new AbortController() };
  shown = flight;
  imagesOf = null;
  for (const name of ["picture", "seen", "map"]) byId("image-" + name).removeAttribute("src");
  for (const name of ["events", "refusals"]) byId(name).replaceChildren();
  for (const name of ["upload", "fix-answer"]) byId(name).textContent = "";
  showHelp(null);
  askForPlace(false);
  map.clear();
  const head = await refreshHead(flight);
  if (flight !== shown) return;
  byId("list").hidden = true;
  byId("flight").hidden = byId("legend").hidden = false;
  if (packages.length === 0) packages = (await getJson("/v1/packages")).packages;
  map.setPackage(packages.find((pack) => pack.name === head.package && pack.accepted) ?? null);
  flight.online = await estimatesOf(id, "online");
  if (head.kinds.includes("refined")) flight.refined = await estimatesOf(id, "refined");
  if (flight !== shown) return;
  showKind(flight.refined ? "refined" : "online");
  await Promise.all([refreshSegments(flight), refreshFixes(flight)]);
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
  shown = null;
  map.clear();
  map.setPackage(null);
  askForPlace(false);
  document.title = "Nadir desk";
  byId("list").hidden = false;
  byId("flight").hidden = byId("legend").hidden = true;
  refreshList().catch((error) => console.info(error.message));
};
const followAddress = () => {
  const id = location.hash.slice(1);
  if (!/^[0-9a-f]{12}$/.test(id)) return closeFlight();
  openFlight(id).catch((error) => { console.info(error.message); location.hash = ""; });
};

byId("new").addEventListener("click", () => {
  byId("create-package").replaceChildren(element("option", { value: "" }, "none: odometry alone"),
    ...packages.filter((pack) => pack.accepted).map((pack) => element("option", { value: pack.name }, pack.name)));
  byId("create-package").selectedIndex = byId("create-package").length > 1 ? 1 : 0;
  byId("create-problem").textContent = "";
  byId("create").showModal();
});
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

const save = async (format) => {
  const response = await call(`/v1/flights/${shown.id}/export?format=${format}`);
  if (!response.ok) return;
  const address = URL.createObjectURL(await response.blob());
  const name = /filename="([^"]+)"/.exec(response.headers.get("Content-Disposition") ?? "")?.[1] ?? `${shown.id}.${format}`;
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
};
for (const link of document.querySelectorAll("#exports a")) {
  link.addEventListener("click", (event) => { event.preventDefault(); save(link.dataset.format).catch((error) => console.info(error.message)); });
}

byId("home").addEventListener("click", (event) => { event.preventDefault(); location.hash = ""; });
byId("add").addEventListener("click", () => byId("pictures").showModal());
byId("create-cancel").addEventListener("click", () => byId("create").close());
byId("pictures-cancel").addEventListener("click", () => byId("pictures").close());
byId("complete").addEventListener("click", () => postJson(`/v1/flights/${shown.id}/complete`).then(() => refreshHead(shown)).catch((problem) => { byId("upload").textContent = problem.message; }));
byId("whole").addEventListener("click", () => map.showTrack());
byId("frame").addEventListener("input", () => selectFrame(Number(byId("frame").value)));
byId("previous").addEventListener("click", () => step(-1));
byId("next").addEventListener("click", () => step(1));
byId("live").addEventListener("click", () => selectFrame(null));
byId("ask-place").addEventListener("click", () => askForPlace(byId("ask-place").getAttribute("aria-pressed") !== "true"));
byId("kind-online").addEventListener("click", () => showKind("online"));
byId("kind-refined").addEventListener("click", () => (shown.refined ? showKind("refined") : completed(shown)));
byId("all-ellipses").addEventListener("click", () => {
  const wanted = byId("all-ellipses").getAttribute("aria-pressed") !== "true";
  byId("all-ellipses").setAttribute("aria-pressed", wanted);
  map.showAllUncertainties(wanted);
});
document.addEventListener("keydown", (event) => {
  if (!shown || event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
  if (event.key === "Escape") return askForPlace(false);
  if (event.target.matches("input:not([type=range]), select, textarea")) return;
  const action = { p: () => step(-1), n: () => step(1), l: () => selectFrame(null), w: () => map.showTrack(), f: () => askForPlace(true) }[event.key.toLowerCase()];
  if (!action) return;
  event.preventDefault();
  action();
});
window.addEventListener("hashchange", followAddress);
setInterval(showContact, 500);
followAddress();
keepList();
