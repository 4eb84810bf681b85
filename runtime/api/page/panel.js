// The figures, the subsystems and the events, as text. Whatever comes from outside is set as text, never as HTML.

const byId = (id) => document.getElementById(id);
const metresPerFoot = 0.3048;
const words = (name) => name.replaceAll("_", " ");

const duration = (seconds) => {
  if (seconds < 100) return Math.round(seconds) + " s";
  if (seconds < 6000) return Math.round(seconds / 60) + " min";
  return (seconds / 3600).toFixed(1) + " h";
};
const metres = (value) => value < 10 ? value.toFixed(1) : value < 10000 ? Math.round(value).toString() : (value / 1000).toFixed(1) + " k";
const bytes = (value) => value < 1e6 ? (value / 1e3).toFixed(0) + " kB" : value < 1e9 ? (value / 1e6).toFixed(0) + " MB" : (value / 1e9).toFixed(1) + " GB";

const figure = (id, text, unit, grade = "") => {
  const node = byId(id);
  node.textContent = text;
  if (unit && text !== "–") node.append(element("small", {}, unit));
  node.parentNode.className = node.parentNode.className.split(" ").filter((name) => name !== "warn" && name !== "bad").concat(grade || []).join(" ");
};
const part = (id, text, grade) => {
  byId(id).className = grade;
  byId(id).querySelector("dd").textContent = text;
};
const worst = (counts) => Object.entries(counts).sort((a, b) => b[1] - a[1])[0];

const showState = (state) => {
  document.body.dataset.state = state.state;
  byId("state").textContent = words(state.state);
  byId("reason").textContent = state.reason;
  document.title = `${words(state.state)} · Nadir`;

  const sigma = state.position?.sigma_m ?? null;
  figure("sigma", sigma === null ? "–" : metres(sigma), "m", sigma === null ? "bad" : sigma > 100 ? "bad" : sigma > 20 ? "warn" : "");
  const level = state.position?.hpl_m ?? null, { usable, alert_limit_m: limit } = state.integrity;
  figure("hpl", level === null ? "–" : metres(level), "m", usable ? "" : "bad");
  byId("hpl-limit").textContent = usable || !state.position ? "protection level" : `NOT USABLE (> ${metres(limit)} m)`;
  byId("hpl-limit").title = `protection level, alert limit ${metres(limit)} m`;
  figure("speed", state.velocity ? Math.hypot(state.velocity.east_m_s, state.velocity.north_m_s).toFixed(1) : "–", "m/s");
  figure("heading", state.heading_deg === null ? "–" : String(Math.round(state.heading_deg) % 360).padStart(3, "0") + "°");
  figure("agl", state.agl_m === null ? "–" : Math.round(state.agl_m), state.agl_m === null ? "" : `m · ${Math.round(state.agl_m / metresPerFoot)} ft`);

  byId("source").className = state.source;
  byId("source").textContent = words(state.source);
  byId("coordinates").textContent = state.position ? `${state.position.lat.toFixed(6)}, ${state.position.lon.toFixed(6)}` : "no position";

  const { anchors, link, gps, recorder, playback } = state;
  const gate = worst(anchors.rejected_by);
  part("anchors", `${anchors.accepted} accepted, ${anchors.rejected} rejected` + (gate ? (gate[1] < anchors.rejected ? ", mostly " : ": ") + words(gate[0]) : "") + (anchors.failed ? `, ${anchors.failed} FAILED` : ""),
       anchors.failed ? "bad" : anchors.accepted === 0 ? "warn" : "good");
  const rejects = Object.values(link.rejected_by).reduce((sum, count) => sum + count, 0);
  lastLink = (link.connected ? "connected" : "not connected") + (link.signed ? ", signed" : playback && !link.connected ? "" : ", NOT SIGNED: anybody can pose as the autopilot") + (link.rivals ? `, ${link.rivals} frames of a second sender` : "") + (rejects ? `, ${rejects} frames rejected` : "");
  byId("link").className = !link.connected || link.rivals ? "bad" : link.signed && !rejects ? "good" : "warn";
  part("gps", gps.judgement + (gps.reason ? ": " + gps.reason : ""), { good: "good", denied: "warn", spoofed: "bad", unknown: "" }[gps.judgement]);
  if (playback) part("recorder", "plays " + playback.session, "");
  else part("recorder", recorder.state + (recorder.state === "recording" ? `, ${bytes(recorder.written_bytes)}` : "") + (recorder.reason ? ": " + recorder.reason : ""),
       { recording: "good", limited: "warn", failed: "bad", off: "" }[recorder.state]);
  showMap(state);
};

// Everything that grows with time: `since` seconds have passed since the state arrived.
const showAges = (state, since) => {
  byId("since").textContent = "for " + duration(state.state_for_s + since);
  const aged = (age) => age === null ? null : age + since;
  const age = aged(state.anchor_age_s), frameAge = aged(state.frames.age_s), linkAge = aged(state.link.age_s);
  figure("anchor-age", age === null ? "–" : age < 100 ? age.toFixed(1) : duration(age).split(" ")[0], age !== null && age >= 100 ? duration(age).split(" ")[1] : "s", age === null || age > 30 ? "bad" : age > 10 ? "warn" : "");
  const { frames } = state, share = frames.received ? frames.dropped / frames.received : 0, silent = frameAge === null || frameAge > 2;
  part("frames", (frameAge === null ? "none yet" : silent ? `NONE for ${duration(frameAge)}` : `${frames.per_s.toFixed(1)} per s`) + (state.playback ? `, ${frames.received} processed` : `, ${frames.dropped} of ${frames.received} dropped`),
       silent ? "bad" : share > .1 ? "warn" : "good");
  byId("link").querySelector("dd").textContent = lastLink + (linkAge !== null && linkAge > 2 ? `, silent for ${duration(linkAge)}` : "");
  const now = state.time_s + state.age_s + since;
  for (const line of document.querySelectorAll("#events li, #alarms li")) {
    if (line.dataset.time) line.firstChild.textContent = duration(Math.max(0, now - line.dataset.time));
  }
};
let lastLink = "";

let lastPackage = null;
const showPackage = (pack) => {
  lastPackage = pack;
  if (!pack.accepted && document.body.classList.contains("playback")) return part("package", pack.reason, "");
  if (!pack.accepted) return part("package", "not accepted" + (pack.reason ? ": " + pack.reason : ""), "bad");
  part("package", `${pack.mission} (${pack.series} ${pack.sequence})` + (pack.expires ? `, until ${pack.expires.slice(0, 10)}` : ""), "good");
};
const showMap = (state) => {
  if (!lastPackage?.accepted || !state.map.corrupt_tiles) return;
  showPackage(lastPackage);
  const line = byId("package");
  line.className = "bad";
  line.querySelector("dd").append(`, ${state.map.corrupt_tiles} CORRUPT TILE${state.map.corrupt_tiles > 1 ? "S" : ""}`);
};

// An event that repeats takes the place of its last occurrence. Alarms have a list of their own.
const eventsShown = 40, alarmsShown = 12;
const enlist = (id, event, most) => {
  const list = byId(id);
  list.querySelector(".none")?.remove();
  for (const old of list.querySelectorAll("li")) {
    if (Number(old.dataset.id) === event.id || (event.replaces !== null && Number(old.dataset.id) === event.replaces)) old.remove();
  }
  const line = element("li", { class: event.severity }, element("time"), element("span", {}, event.text));
  if (event.count > 1) line.lastChild.append(element("b", {}, `× ${event.count}`));
  line.dataset.time = event.time_s;
  line.dataset.id = event.id;
  list.prepend(line);
  while (list.children.length > most) list.lastChild.remove();
  return line;
};
const showEvent = (event) => {
  const line = enlist("events", event, eventsShown);
  if (event.severity === "critical") addAlarm(event);
  line.firstChild.textContent = duration(event.age_s);
};
// The two lists number their events apart: the same alarm is the one of the same time.
const addAlarm = (event) => {
  const wording = (text) => text.replace(/[0-9.]/g, "");
  for (const old of byId("alarms").children) if (wording(old.children[1].firstChild.data) === wording(event.text)) old.remove();
  const line = enlist("alarms", { ...event, id: -1, replaces: null }, alarmsShown);
  line.dataset.id = "";
  line.firstChild.textContent = duration(event.age_s);
  byId("alarm-list").hidden = false;
};
const showAlarms = (alarms) => {
  byId("alarms").replaceChildren();
  byId("alarm-list").hidden = alarms.length === 0;
  for (const alarm of alarms) addAlarm(alarm);
};
const clearEvents = () => { byId("events").replaceChildren(); showAlarms([]); };
