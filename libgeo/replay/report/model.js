// The data that the page was made with, words for its codes, and the one piece of shared state: the selected frame.

const data = JSON.parse(document.getElementById("data").textContent);

const sources = {
  satellite_anchored: {label: 'anchored to the map', colour: 'var(--anchored)'},
  vo_extrapolated: {label: 'propagated by odometry', colour: 'var(--vo)'},
  dead_reckoned: {label: 'dead reckoned', colour: 'var(--dead)'},
  no_fix: {label: 'no fix', colour: 'var(--none)'},
};

const verdicts = {
  accepted: "the belief is sure of this place",
  not_tried: "no match was due for this frame",
  frame_unfit: "the frame is unfit: black, blown out, blurred or unreadable",
  no_map: "the search window lies off the map",
  ambiguous: "another place fits nearly as well",
  few_inliers: "too few patches agree on one pose",
  bad_geometry: "the pose is not credible: residual, tilt, height or share of the frame",
  off_prediction: "the match contradicts the prediction",
  awaiting_votes: "plausible, but to be confirmed by other frames",
};

const verdictColour = (verdict) =>
  verdict === "accepted" ? "var(--good)" : verdict === "not_tried" ? "var(--grid)" :
  verdict === "awaiting_votes" ? "var(--dead)" : "var(--bad)";

const words = (code) => code.replace(/_/g, " ");
const metres = (value) => value == null ? "–" :
  value >= 1000 ? (value / 1000).toFixed(2) + " km" : value.toFixed(value < 100 ? 1 : 0) + " m";
const clock = (seconds) => {
  const whole = Math.floor(seconds);
  const minutes = Math.floor(whole / 60);
  return minutes + ":" + String(whole % 60).padStart(2, "0");
};

const listeners = [];
let selected = -1;
const onSelect = (listener) => listeners.push(listener);
const select = (index) => {
  if (index < 0 || index >= data.frames.length || index === selected) return;
  selected = index;
  for (const listener of listeners) listener(index);
};
