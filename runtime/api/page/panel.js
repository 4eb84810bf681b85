// The figures, the subsystems and the events, as text. Whatever comes from outside is set as text, never as HTML.

const byId = (id) => document.getElementById(id);
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
  byId("since").textContent = "for " + duration(state.state_for_s);
  document.title = `${words(state.state)} · Nadir`;

  const sigma = state.position?.sigma_m ?? null, age = state.anchor_age_s;
  figure("sigma", sigma === null ? "–" : metres(sigma), "m", sigma === null ? "bad" : sigma > 100 ? "bad" : sigma > 20 ? "warn" : "");
  figure("anchor-age", age === null ? "–" : age < 100 ? age.toFixed(1) : duration(age).split(" ")[0], age !== null && age >= 100 ? duration(age).split(" ")[1] : "s", age === null || age > 30 ? "bad" : age > 10 ? "warn" : "");
  figure("speed", state.velocity ? Math.hypot(state.velocity.east_m_s, state.velocity.north_m_s).toFixed(1) : "–", "m/s");
  figure("heading", state.heading_deg === null ? "–" : String(Math.round(state.heading_deg) % 360).padStart(3, "0") + "°");
  figure("agl", state.agl_m === null ? "–" : Math.round(state.agl_m), "m");

  byId("source").className = state.source;
  byId("source").textContent = words(state.source);
  byId("coordinates").textContent = state.position ? `${state.position.lat.toFixed(6)}, ${state.position.lon.toFixed(6)}` : "no position";

  const { frames, anchors, link, gps, recorder } = state;
  const share = frames.received ? frames.dropped / frames.received : 0;
  part("frames", `${frames.per_s.toFixed(1)} per s, ${frames.dropped} of ${frames.received} dropped`, frames.per_s === 0 ? "bad" : share > .1 ? "warn" : "good");
  const gate = worst(anchors.rejected_by);
  part("anchors", `${anchors.accepted} accepted, ${anchors.rejected} rejected` + (gate ? (gate[1] < anchors.rejected ? ", mostly " : ": ") + words(gate[0]) : ""), anchors.accepted === 0 ? "warn" : "good");
  const rejects = Object.values(link.rejected_by).reduce((sum, count) => sum + count, 0);
  part("link", (link.connected ? "connected" : "not connected") + (link.signed ? ", signed" : ", NOT SIGNED: anybody can pose as the autopilot") + (link.rivals ? `, ${link.rivals} frames of a second sender` : "") + (rejects ? `, ${rejects} frames rejected` : ""),
       !link.connected || link.rivals ? "bad" : link.signed && !rejects ? "good" : "warn");
  part("gps", gps.judgement + (gps.reason ? ": " + gps.reason : ""), { good: "good", denied: "warn", spoofed: "bad", unknown: "" }[gps.judgement]);
  part("recorder", recorder.state + (recorder.state === "recording" ? `, ${bytes(recorder.written_bytes)}` : "") + (recorder.reason ? ": " + recorder.reason : ""),
       { recording: "good", limited: "warn", failed: "bad", off: "" }[recorder.state]);
};

const showPackage = (pack) => {
  if (!pack.accepted) return part("package", "not accepted" + (pack.reason ? ": " + pack.reason : ""), "bad");
  part("package", `${pack.mission} (${pack.series} ${pack.sequence})` + (pack.expires ? `, until ${pack.expires.slice(0, 10)}` : ""), "good");
};

const eventsShown = 40;
const showEvent = (event, now) => {
  const list = byId("events");
  list.querySelector(".none")?.remove();
  const line = element("li", { class: event.severity }, element("time"), element("span", {}, event.text));
  line.dataset.time = event.time_s;
  list.prepend(line);
  while (list.children.length > eventsShown) list.lastChild.remove();
  showAges(now ?? event.time_s);
};
const showAges = (now) => {
  for (const line of byId("events").children) {
    if (line.dataset.time) line.firstChild.textContent = duration(Math.max(0, now - line.dataset.time));
  }
};
