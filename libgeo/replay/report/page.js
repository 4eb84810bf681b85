// Puts the page together.

document.getElementById("title").textContent = data.title;
document.getElementById("subtitle").textContent = data.subtitle;
document.getElementById('footer').textContent = data.generator +
    '. Self-contained: nothing is loaded from a network. Positions are WGS84, distances metres on the ground.';
if (data.notice) document.getElementById("headline").before(element("p", { class: "card notice", role: "alert" }, data.notice));
for (const tile of data.tiles) {
  document.getElementById("headline").append(element("div", { class: "tile " + tile.mood },
    element("b", {}, tile.value, element("small", {}, tile.unit)), element("span", {}, tile.label)));
}
for (const [name, value] of data.figures)
  document.getElementById("figures").append(element("div", {}, element("span", {}, name), element("span", {}, value)));

drawMap(document.getElementById("map"));
drawReadout(document.getElementById("readout"));
drawStrip(document.getElementById("strip"));
drawWorst(document.getElementById("worst"));
drawChart(document.getElementById("chart"));
drawStanford(document.getElementById("stanford"));
addEventListener("keydown", (event) => {
  if (event.key === "ArrowRight") select(selected + 1);
  if (event.key === "ArrowLeft") select(selected - 1);
});
const errors = data.frames.map((frame) => frame.error ?? -1);
select(Math.max(0, errors.indexOf(Math.max(...errors))));
