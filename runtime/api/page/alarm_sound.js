// A change of state for the ear of an operator who looks elsewhere: falling tones when it gets worse, rising ones when it gets
// better, five quick ones for an alarm. Browsers are silent until somebody has clicked, so that it is off at first.

const stateRank = { normal: 0, degraded: 1, boot: 2, awaiting_autopilot: 2, relocalizing: 2, no_fix: 3, failsafe: 4, no_package: 4 };
const tones = { better: [523, 784], worse: [784, 523, 392], alarm: [988, 740, 988, 740, 988] };  // Hz
const toneLength = .16;                                                                          // s
const urgency = ["better", "worse", "alarm"];

const makeAlarmSound = (button) => {
  let context = null, on = false, ends = 0, playing = "better", state = null, old = false;

  // One thing at a time, the most urgent: an alarm and the change of state that it is about come together.
  const play = (kind) => {
    if (!on || (performance.now() < ends && urgency.indexOf(kind) <= urgency.indexOf(playing))) return;
    playing = kind;
    ends = performance.now() + tones[kind].length * toneLength * 1000;
    tones[kind].forEach((frequency, i) => {
      const tone = new OscillatorNode(context, { type: "square", frequency }), volume = new GainNode(context, { gain: .2 });
      tone.connect(volume).connect(context.destination);
      tone.start(context.currentTime + i * toneLength);
      tone.stop(context.currentTime + (i + .85) * toneLength);
    });
    button.dataset.played = kind;
  };

  button.addEventListener("click", async () => {
    context ??= new AudioContext();
    await context.resume();
    on = !on;
    button.setAttribute("aria-pressed", on);
    play("better");  // so that the operator hears whether anything is heard
  });

  return {
    setState: (next) => {
      if (state !== null && next !== state) play(stateRank[next] < stateRank[state] ? "better" : "worse");
      state = next;
    },
    setStale: (now) => {
      if (now !== old) play(now ? "alarm" : "better");
      old = now;
    },
    alarm: () => play("alarm"),
  };
};
