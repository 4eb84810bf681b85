// Joins the parts: the list of missions, one that is open, its changes with undo, and the job that makes its package.

const listEvery_ms = 3000, jobEvery_ms = 400, mergeKeys_ms = 1500;

// The open mission: id, stored (as the desk has it), doc (as it is here), what is selected, notes of its import.
let shown = null;
const sign = makeContact(() => shown !== null);
const state = () => shown ?? { id: null, stored: null, doc: {} };

// ---- Changes

const history = makeHistory({
  onChange: (canUndo, canRedo) => { byId("undo").disabled = !canUndo; byId("redo").disabled = !canRedo; },
  onProblem: (text) => { byId("history-answer").textContent = text; },
});
const saving = makeSaving({
  onState: (name, why) => {
    byId("saved").textContent = { saved: "saved", saving: "saving …", conflict: "not saved: changed elsewhere", unsaved: `not saved: ${why}` }[name];
    byId("saved").className = name === "saved" || name === "saving" ? "soft" : "bad";
  },
  onStored: (stored, last) => {
    sign();
    shown.stored = stored;
    if (!last) return;
    byId("saved").textContent = "saved";
    showStored();
  },
  onConflict: (theirs) => {
    shown.theirs = theirs;
    byId("conflict").hidden = false;
    byId("conflict-text").textContent = `Somebody else has changed this mission (revision ${theirs.revision}, ${theirs.changed.slice(0, 19).replace("T", " ")}). Your changes are here and not stored yet.`;
  },
});
// The document as it shall be, everywhere but in the history.
const setDocument = (doc) => {
  shown.doc = doc;
  const count = shown.shape && memberAt(doc, shown.shape) ? pointsOf(doc, shown.shape).length : -1;
  if (count < 0) shown.shape = shown.point = null;
  else if (shown.point !== null && shown.point >= count) shown.point = count > 0 ? count - 1 : null;
  showDocument();
  saving.change(doc);
};
const restore = (doc) => { setDocument(structuredClone(doc)); };
const addAction = (text, before, after) => {
  const action = { text, before, after, undo: () => { shown.last = null; restore(action.before); }, redo: () => { shown.last = null; restore(action.after); } };
  history.add(action);
  return action;
};
// mutate changes a copy. key: changes of one key that follow each other closely are one step.
const edit = (text, mutate, key = null) => {
  const before = shown.doc, next = structuredClone(before);
  mutate(next);
  if (JSON.stringify(next) === JSON.stringify(before)) return showDocument();
  const now = performance.now(), last = shown.last;
  if (key && last?.key === key && now - last.at < mergeKeys_ms) last.action.after = next, last.at = now;
  else shown.last = { key, at: now, action: addAction(text, before, next) };
  return setDocument(next);
};
byId("conflict-mine").addEventListener("click", () => {
  const { theirs, doc } = shown;
  byId("conflict").hidden = true;
  addAction("their version replaced", theirs.mission, doc);
  saving.resolve(theirs.revision, doc);
});
byId("conflict-theirs").addEventListener("click", () => {
  const { theirs, doc } = shown;
  byId("conflict").hidden = true;
  addAction("their version taken", doc, theirs.mission);
  shown.doc = structuredClone(theirs.mission);
  shown.shape = shown.point = null;
  showDocument();
  saving.resolve(theirs.revision, theirs.mission);
});

// ---- The map and the form

const drawWords = { route: "route", area: "area", "no-fly": "no-fly area", circle: "no-fly circle", takeoff: "take-off" };
const select = (shape, point) => {
  if (!shown) return;
  shown.shape = shape, shown.point = point;
  showDocument();
  if (shape && point !== null && pointsOf(shown.doc, shape)[point]) map.goTo(pointsOf(shown.doc, shape)[point]);
};
const pointsFrom = (list) => list.map(({ lat, lng }) => [lng, lat]);
const map = makeMissionMap(byId("map"), {
  onSelect: select,
  onPoints: (shape, list, key = null) => edit(`${nameOf(shown.doc, shape)} moved`, (next) => {
    const heights = heightsOf(next, shape), points = pointsFrom(list);
    if (heights) next.route.heights.m = list.map(({ alt }, i) => alt ?? heightBetween(list[i - 1]?.alt, list[i + 1]?.alt, next.route.agl_m));
    setPoints(next, shape, points);
  }, key && `${key} ${shape} ${shown.point}`),
  onRadius: (shape, place, radius) => edit(`${nameOf(shown.doc, shape)} changed`, (next) => {
    setPoints(next, shape, [place]);
    memberAt(next, shape).circle.radius_m = radius;
  }),
  onDrawn: (name, points) => {
    const added = { route: "route", takeoff: "takeoff", area: `sectors[${sectorsOf(shown.doc).length}]` }[name] ?? `no_fly[${noFlyOf(shown.doc).length}]`;
    edit(`${drawWords[name]} drawn`, (next) => {
      if (name === "takeoff") setPoints(next, "takeoff", points);
      if (name === "route") { setMember(next, "route.heights", undefined); setPoints(next, "route", points); }
      if (name === "area") addSector(next, points);
      if (name === "no-fly") addNoFly(next, { polygon: closedRing(points) });
      if (name === "circle") addNoFly(next, { circle: { lon_deg: points[0][0], lat_deg: points[0][1], radius_m: 100 } });
    });
    select(added, name === "takeoff" || name === "circle" ? 0 : null);
  },
  onTool: (name, count, problem = "") => {
    byId("drawing").hidden = name === null;
    for (const button of document.querySelectorAll("[data-draw]")) button.setAttribute("aria-pressed", button.dataset.draw === name);
    if (name === null) return;
    const single = name === "takeoff" || name === "circle";
    byId("draw-finish").hidden = single;
    byId("asking").textContent = problem ? problem : single ? `Click where the ${drawWords[name]} is, or move the map and press Enter.`
      : count === 0 ? `Draw the ${drawWords[name]}: click its points, or move the map and press Enter for its middle.` : `${plural(count, "point")}. Finish, or click the last one again; Backspace takes it back.`;
  },
});
const form = makeMissionForm({ edit, select, middle: map.middle, removePart: (shape) => edit(`${nameOf(shown.doc, shape)} removed`, (next) => removeShape(next, shape)) });
const findings = makeFindings({ map: map.leaflet, renderer: map.renderer, select });
const layers = makeMissionLayers({ missionMap: map, state });
const profile = makeMissionProfile({ map: map.leaflet, renderer: map.renderer, nearestLook: layers.nearestLook });
const making = makeMissionPackage({ state, flush: saving.flush, edit, onJob: (job) => { shown.stored.job = job; making.setJob(job); } });

const showDocument = () => {
  map.show(shown.doc, shown.shape, shown.point);
  layers.raiseLegs();
  form.show(shown.doc, shown.shape, shown.point);
  showFindings();
};
const showFindings = () => {
  const job = shown.stored.job, ofCommands = isActive(job) ? [] : (job?.steps ?? []).flatMap(({ findings: found }) => found);
  findings.show(shown.doc, shown.stored.findings, [...shown.notes, ...ofCommands]);
};

// ---- What the desk knows about it

const stateWords = ({ valid, package: pack, job }) => (isActive(job) ? job.state : pack?.signed ? "signed" : pack ? "built" : valid ? "complete" : "draft");
const showEstimate = ({ estimate, mission, job }) => {
  const budget = mission.budget_mb, show = (id, text) => { byId(id).textContent = text; };
  show("estimate-tiles", estimate ? String(estimate.tiles) : "–");
  show("estimate-megabytes", estimate ? `${estimate.megabytes.toFixed(1)} MB of ${budget}` : "–");
  byId("estimate-megabytes").className = estimate && estimate.megabytes > budget ? "bad" : "";
  show("estimate-minutes", estimate ? (estimate.build_minutes < 1 ? `${Math.ceil(estimate.build_minutes * 60)} s` : `${estimate.build_minutes.toFixed(1)} min`) : "–");
  show("estimate-ground", estimate ? `${estimate.route_km.toFixed(1)} km, ${estimate.needed_km2.toFixed(2)} km²` : "–");
  const measured = job?.steps.find(({ kind, state: of }) => kind === "estimate" && of === "done")?.result;
  show("estimate-measured", measured ? `of this imagery: ${plural(measured.tiles, "tile")}, ${measured.megabytes.toFixed(1)} MB` : "");
  byId("measure").disabled = !estimate || isActive(job);
};
let profileAsked = 0;
const showProfile = async () => {
  const { id, stored, doc } = shown, mine = ++profileAsked;
  if (!stored.valid || pointsOf(doc, "route").length < 2) return profile.set(null);
  const query = new URLSearchParams();
  if (making.elevation()) query.set("elevation", making.elevation());
  if (making.camera()) query.set("camera", making.camera());
  const found = await getJson(`/v1/missions/${id}/profile?${query.toString().replaceAll("+", "%20")}`);
  if (mine === profileAsked && shown?.id === id) profile.set(found);
  return undefined;
};
const showStored = () => {
  const { stored } = shown;
  byId("state").textContent = stateWords(stored);
  byId("state").dataset.state = { signed: "completed", running: "processing", waiting: "processing" }[stateWords(stored)] ?? "";
  document.title = `${stored.mission.id || "mission"} · Missions · Nadir desk`;
  showEstimate(stored);
  showFindings();
  making.setJob(stored.job);
  layers.setMission(shown).then(layers.redraw).then(showProfile).catch((error) => console.info(error.message));
};
const refreshStored = async () => {
  const { id } = shown, stored = await getJson(`/v1/missions/${id}`);
  sign();
  if (shown?.id !== id || !saving.clean() || JSON.stringify(stored) === JSON.stringify(shown.stored)) return;
  if (stored.revision !== shown.stored.revision) {
    addAction("changed elsewhere", shown.doc, stored.mission);
    byId("history-answer").textContent = "changed elsewhere, and shown as it is now; Undo brings your version back";
    saving.adopt(stored.revision);
    shown.stored = stored;
    shown.doc = structuredClone(stored.mission);
    shown.shape = shown.point = null;
    showDocument();
  }
  shown.stored = stored;
  showStored();
};

// ---- The list

const showList = (missions) => {
  byId("missions").replaceChildren(...missions.map(({ id, name, changed, valid, package: pack, job }) => element("li", {}, element("a", { href: "#" + id }, element("b", {}, name || id),
    element("span", { class: "chip", "data-state": job ? "processing" : pack ? "completed" : "" }, job ?? (pack ? "package" : valid ? "complete" : "draft")), element("span", {}, changed.slice(0, 16).replace("T", " "))))));
  if (missions.length === 0) byId("missions").append(element("li", { class: "soft" }, "none yet"));
};
const showSources = ({ imagery, elevation, cameras, keys, trust }) => {
  const line = (kind, { name, problem, appointed, provider, captured_at }) => element("li", {}, element("b", {}, name), " ",
    element("span", { class: problem || appointed === false ? "bad" : "" }, problem ?? [kind, captured_at?.slice(0, 10), provider, appointed === false ? "not in the root of trust" : ""].filter(Boolean).join(", ")));
  byId("sources").replaceChildren(...imagery.map((one) => line("imagery", one)), ...elevation.map((one) => line("elevation model", one)), ...cameras.map((one) => line("camera", one)), ...keys.map((one) => line("key", one)));
  if (byId("sources").children.length === 0) byId("sources").append(element("li", { class: "soft" }, "none: put rasters into imagery/ and elevation/ of the desk's folder, cameras into cameras/, or name them when it is started"));
  if (!trust) byId("sources").append(element("li", { class: "soft" }, "no root of trust: packages cannot be verified (--trust)"));
};
let planning = null;
const refreshSources = async () => {
  planning = await getJson("/v1/planning");
  showSources(planning);
  making.setPlanning(planning);
  layers.setSources(planning.imagery);
};
const keepUp = async () => {
  for (let round = 0; ; ++round) {
    const active = shown && isActive(shown.stored.job);
    try {
      if (active) {
        const { id } = shown, job = await getJson(`/v1/missions/${id}/jobs/latest`);
        sign();
        if (shown?.id === id) {
          shown.stored.job = job;
          making.setJob(job);
          if (!isActive(job)) await refreshStored();
          if (!isActive(job) && shown?.id === id) showStored();
        }
      } else if (shown) {
        await refreshStored();
      } else {
        const { missions } = await getJson("/v1/missions");
        sign();
        if (shown) continue;
        showList(missions);
        if (round % 5 === 4) await refreshSources();
      }
    } catch (error) {
      console.info(error.message);
    }
    await pause(active ? jobEvery_ms : listEvery_ms);
  }
};

// ---- Opening

const openMission = async (id, notes = []) => {
  await saving.flush();
  const stored = await getJson(`/v1/missions/${id}`);
  sign();
  map.stop();
  layers.clear();
  making.clear();
  history.clear();
  shown = { id, stored, doc: structuredClone(stored.mission), shape: null, point: null, last: null, notes, theirs: null };
  saving.begin(id, stored.revision);
  byId("list").hidden = true;
  byId("mission").hidden = byId("profile").hidden = false;
  byId("conflict").hidden = true;
  for (const name of ["history-answer", "export-answer", "layer-answer"]) byId(name).textContent = "";
  showDocument();
  fit();
  showStored();
};
const fit = () => {
  const bounds = (shown && boundsOf(shown.doc)) ?? layers.bounds();
  if (bounds) map.fit(bounds);
};
const closeMission = async () => {
  await saving.flush();
  map.stop();
  saving.end();
  shown = null;
  layers.clear();
  map.show(null, null, null);
  profile.set(null);
  findings.show({}, [], []);
  document.title = "Missions · Nadir desk";
  byId("list").hidden = false;
  byId("mission").hidden = byId("profile").hidden = true;
  showList((await getJson("/v1/missions")).missions);
};
let notesOf = { id: null, notes: [] };
const followAddress = async () => {
  const id = location.hash.slice(1);
  if (!/^[0-9a-f]{12}$/.test(id)) return closeMission();
  return openMission(id, notesOf.id === id ? notesOf.notes : []);
};
const follow = () => followAddress().catch((error) => { console.info(error.message); location.hash = ""; });
makeMissionFiles({ state, flush: saving.flush, onImported: (mission, notes) => { notesOf = { id: mission.id, notes }; location.hash = mission.id; } });

const beSure = (heading, text) => new Promise((resolve) => {
  byId("sure-heading").textContent = heading;
  byId("sure-text").textContent = text;
  byId("sure").returnValue = "no";
  byId("sure").onclose = () => resolve(byId("sure").returnValue === "yes");
  byId("sure").showModal();
});
byId("new").addEventListener("click", () => { byId("create-form").reset(); byId("create-problem").textContent = ""; byId("create").showModal(); });
byId("create-cancel").addEventListener("click", () => byId("create").close());
byId("create-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  try {
    const mission = await postJson("/v1/missions", { name: byId("create-name").value });
    byId("create").close();
    location.hash = mission.id;
  } catch (problem) {
    byId("create-problem").textContent = problem.message;
  }
});
byId("delete").addEventListener("click", async () => {
  if (!await beSure("Delete this mission?", `${shown.doc.id}: the draft goes, and cannot be brought back. Its package stays.`)) return;
  try {
    await callJson("DELETE", `/v1/missions/${shown.id}`);
    saving.end();
    location.hash = "";
  } catch (problem) {
    byId("export-answer").textContent = problem.message;
  }
});
byId("delete-package").addEventListener("click", async () => {
  if (!await beSure("Delete the package?", `${shown.stored.package.name} can be built again from the same mission and imagery.`)) return;
  try {
    await callJson("DELETE", `/v1/missions/${shown.id}/package`);
    await refreshStored();
  } catch (problem) {
    making.say(problem.message, true);
  }
});
byId("measure").addEventListener("click", () => making.run(["estimate"]));
byId("home").addEventListener("click", (event) => { event.preventDefault(); location.hash = ""; });
byId("whole").addEventListener("click", fit);
byId("undo").addEventListener("click", history.undo);
byId("redo").addEventListener("click", history.redo);
byId("snapping").addEventListener("change", () => map.setSnapping(byId("snapping").checked));
byId("draw-finish").addEventListener("click", map.finish);
byId("draw-cancel").addEventListener("click", map.stop);
for (const button of document.querySelectorAll("[data-draw]")) {
  button.addEventListener("click", () => (map.drawing() === button.dataset.draw ? map.stop() : map.draw(button.dataset.draw)));
}
for (const field of ["use-elevation", "use-camera"]) byId(field).addEventListener("change", () => showProfile().catch((error) => console.info(error.message)));

document.addEventListener("keydown", (event) => {
  if (!shown || event.altKey || document.querySelector("dialog[open]")) return;
  if (event.key === "Escape") return map.drawing() ? map.stop() : select(null, null);
  if (event.target.matches("input:not([type=range], [type=checkbox], [type=radio]), select, textarea")) return undefined;
  const key = event.key.toLowerCase(), redo = key === "y" || (key === "z" && event.shiftKey), { shape, point, doc } = shown;
  if ((event.ctrlKey || event.metaKey) && key !== "z" && key !== "y") return undefined;
  // The button with a point's number: arrow keys move the point, as they do on the map.
  if (event.target.matches(".point .number") && point !== null && key.startsWith("arrow")) { event.preventDefault(); return map.moveSelectedBy(event); }
  const drawing = map.drawing() !== null;
  const action = drawing ? { f: map.finish, escape: map.stop }[key] : { r: () => map.draw("route"), a: () => map.draw("area"), n: () => map.draw("no-fly"), c: () => map.draw("circle"), t: () => map.draw("takeoff"),
    z: redo ? history.redo : history.undo, y: history.redo, w: fit, g: () => making.run(),
    delete: () => { if (shape && point !== null && shape !== "takeoff" && !isCircle(doc, shape)) edit("point removed", (next) => removePoint(next, shape, point)); } }[key];
  if (!action) return undefined;
  event.preventDefault();
  return action();
});
addEventListener("beforeunload", (event) => { if (!saving.clean()) event.preventDefault(); });
addEventListener("hashchange", follow);
refreshSources().catch((error) => console.info(error.message)).then(() => { if (!shown) fit(); return follow(); }).then(keepUp);
