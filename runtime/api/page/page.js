// Joins the parts. What is shown is live or marked as stale: a silent service, or a stalled flight thread behind it, must
// never look like a quiet flight.

const contactLimit = 6;  // s without contact to the service
const viewLimit = 2.5;   // s, age of the latest view of the flight

const map = makeMap();
let last = null, heard = 0, sign = 0, boot = null;

const showContact = () => {
  if (!last) return;
  const silence = (performance.now() - sign) / 1000, age = last.age_s + (performance.now() - heard) / 1000;
  const old = age > viewLimit;
  document.body.classList.toggle("stale", old);
  byId("lost").hidden = !old;
  if (!old) return;
  byId("lost").textContent = silence > contactLimit ? `No contact with the service for ${duration(silence)}` : `No update from the flight for ${duration(age)}`;
  byId("state").textContent = "stale";
  byId("since").textContent = "for " + duration(age);
  byId("reason").textContent = `last known state: ${words(last.state)}`;
};

const refresh = async () => {
  const [pack, state] = await Promise.all([getJson("/v1/package"), getJson("/v1/state")]);
  showPackage(pack);
  map.setPackage(pack);
  map.setTrack(state.track);
  if (boot !== null && boot !== state.boot) byId("events").replaceChildren();  // the service was restarted
  boot = state.boot;
};

const onMessage = (kind, data) => {
  if (kind === "log") {
    showEvent(data, last?.time_s);
    if (data.kind === "package") refresh().catch(() => {});
    return;
  }
  if (kind !== "state") return;
  last = data;
  heard = performance.now();
  showState(data);
  showAges(data.time_s);
  map.setState(data);
  showContact();
};

setInterval(showContact, 500);
followEvents(refresh, onMessage, () => { sign = performance.now(); });
