// A recording that is played: a bar that says so, and what it is played with. By keys: space plays and pauses, the arrows go
// ten seconds back and on.

const arrowStep = 10;  // s
const playbackSpeeds = [1, 2, 4, 8, 16];

const clockTime = (seconds) => {
  const whole = Math.floor(seconds), pad = (part) => String(part).padStart(2, "0");
  const minutes = Math.floor(whole / 60);
  return minutes < 60 ? `${minutes}:${pad(whole % 60)}` : `${Math.floor(minutes / 60)}:${pad(minutes % 60)}:${pad(whole % 60)}`;
};
const utcText = (time) => time.replace("T", " ").replace("Z", " UTC");

const makePlayback = () => {
  const bar = byId("playback"), play = byId("play"), speed = byId("rate"), moment = byId("moment");
  for (const choice of playbackSpeeds) speed.append(element("option", { value: choice }, `${choice} ×`));
  let now = null, asked = null, asking = false;  // until all that was asked for is answered, the bar shows that

  const show = (playback) => {
    play.textContent = playback.playing ? "Pause" : "Play";
    speed.value = playback.speed;
    moment.max = playback.length_s;
    moment.value = playback.at_s;
    showClock(playback.at_s);
  };
  const showClock = (at) => {
    const began = now.recorded ? Date.parse(now.recorded) : null;
    const utc = began === null ? "" : utcText(new Date(began + at * 1000).toISOString().slice(0, 19) + "Z").slice(11) + ", ";
    byId("clock").textContent = `${utc}${clockTime(at)} of ${clockTime(now.length_s)}`;
    moment.setAttribute("aria-valuetext", byId("clock").textContent);
  };
  const control = async (change) => {
    Object.assign(now, change);
    show(now);
    asked = { ...asked, ...change };
    if (asking) return;
    asking = true;
    while (asked) {
      const body = JSON.stringify(asked);
      asked = null;
      await call("/v1/playback", { "Content-Type": "application/json" }, undefined, { method: "POST", body }).catch(() => {});
    }
    asking = false;
  };
  const seek = (at) => control({ at_s: Math.min(Math.max(at, 0), now.length_s) });

  play.addEventListener("click", () => control({ playing: !now.playing }));
  speed.addEventListener("change", () => control({ speed: Number(speed.value) }));
  moment.addEventListener("input", () => seek(Number(moment.value)));
  document.addEventListener("keydown", (event) => {
    if (!now || event.ctrlKey || event.altKey || event.metaKey || event.target.closest("dialog, select")) return;
    if (event.key === " " && !event.target.closest("button")) control({ playing: !now.playing });
    else if (event.key === "ArrowLeft" && !event.target.closest("#map-view")) seek(now.at_s - arrowStep);
    else if (event.key === "ArrowRight" && !event.target.closest("#map-view")) seek(now.at_s + arrowStep);
    else return;
    event.preventDefault();
  });

  return {
    // Seconds of the recording in a second of the viewer.
    rate: () => now === null ? 1 : now.playing ? now.speed : 0,
    setState: (playback) => {
      bar.hidden = playback === null;
      document.body.classList.toggle("playback", playback !== null);
      if (playback === null || asking) return;
      now = playback;
      byId("recorded").textContent = playback.recorded ? "of " + utcText(playback.recorded) : "of a replay";
      byId("playback-notice").hidden = !playback.notice;
      byId("playback-notice").textContent = "Not all of it can be read: " + playback.notice;
      document.title = "RECORDING · " + document.title.replace("RECORDING · ", "");
      show(playback);
    },
  };
};
