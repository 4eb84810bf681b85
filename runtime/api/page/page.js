// Joins the parts. What is shown is live, or marked as stale or as a recording: a silent service, or a stalled flight thread
// behind it, must never look like a quiet flight.

const contactLimit = 6;  // s without contact to the service
const viewLimit = 2.5;   // s, age of the latest view of the flight

const map = makeLiveMap(), sound = makeAlarmSound(byId("sound")), playback = makePlayback();
let last = null, lastStateAt = 0, lastContactAt = 0, boot = null;

// Ages go on from the arrival of the latest state, whether or not another one comes.
const showContact = () => {
  if (!last) return;
  const since = (performance.now() - lastStateAt) / 1000, silence = (performance.now() - lastContactAt) / 1000, age = last.age_s + since;
  showAges(last, since * playback.rate());
  const old = age > viewLimit;
  document.body.classList.toggle("stale", old);
  sound.setStale(old);
  byId("lost").hidden = !old;
  if (!old) return;
  byId("lost").textContent = silence > contactLimit ? `No contact with the service for ${duration(silence)}` : `No update from the flight for ${duration(age)}`;
  byId("state").textContent = "stale";
  byId("since").textContent = "for " + duration(age);
  byId("reason").textContent = `last known state: ${words(last.state)}`;
};

const load = async () => {
  const [pack, state] = await Promise.all([getJson("/v1/package"), getJson("/v1/state")]);
  return { pack, state };
};
const showAll = ({ pack, state }) => {
  playback.setState(state.playback);
  showPackage(pack);
  map.setPackage(pack);
  map.setTrack(state.track);
  showAlarms(state.alarms);
};
const open = async () => {
  const loaded = await load();
  if (boot !== null && boot !== loaded.state.boot) clearEvents();  // the service was restarted
  boot = loaded.state.boot;
  showAll(loaded);
};
const refresh = async () => {
  const loaded = await load();
  if (loaded.state.boot === boot) showAll(loaded);  // else enterRun() loads again, or has
};

// Another run, as after each jump in a recording: what was shown is not of this one.
const enterRun = (run) => {
  if (boot === run) return;
  boot = run;
  clearEvents();
  map.setTrack([]);
  refresh().catch(() => {});
};

const onMessage = (kind, data, id) => {
  if (kind === "log") {
    enterRun(id.slice(0, id.lastIndexOf("-")));
    showEvent(data);
    if (data.severity === "critical") sound.alarm();
    if (data.kind === "package") refresh().catch(() => {});
    return;
  }
  if (kind === "missed") refresh().catch(() => {});  // an alarm may be among what was missed
  if (kind !== "state") return;
  enterRun(data.boot);
  last = data;
  lastStateAt = performance.now();
  showState(data);
  playback.setState(data.playback);
  sound.setState(data.state);
  map.setState(data);
  showContact();
};

setInterval(showContact, 500);
followEvents("/v1/events", { onOpen: open, onMessage, onSign: () => { lastContactAt = performance.now(); } });
