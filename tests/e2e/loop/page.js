// A moment that is pointed at, on the map and in the curves.
const plot = document.getElementById("plot"), cursor = document.getElementById("cursor");
const here = document.getElementById("here");

function show(time_s) {
  const at = MOMENTS.reduce((best, moment) => Math.abs(moment[0] - time_s) < Math.abs(best[0] - time_s) ? moment : best);
  here.setAttribute("cx", at[1]);
  here.setAttribute("cy", at[2]);
  const x = PLOT.left + (PLOT.right - PLOT.left) * time_s / PLOT.end_s;
  cursor.setAttribute("x1", x);
  cursor.setAttribute("x2", x);
}

plot.addEventListener("pointermove", event => {
  const box = plot.getBoundingClientRect();
  const x = (event.clientX - box.left) / box.width * plot.viewBox.baseVal.width;
  const time_s = (x - PLOT.left) / (PLOT.right - PLOT.left) * PLOT.end_s;
  show(Math.min(Math.max(time_s, 0), PLOT.end_s));
});
for (const item of document.querySelectorAll("#events li")) {
  item.addEventListener("pointerenter", () => show(Number(item.dataset.s)));
}
