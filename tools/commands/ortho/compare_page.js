// The flight over the map, cut where the slider stands.

const data = JSON.parse(document.getElementById("data").textContent);
const at = id => document.getElementById(id);

at("title").textContent = data.title;
at("subtitle").textContent = data.subtitle;
at("before").src = data.before;
at("after").src = data.after;
at("note").textContent = data.note;
for (const [value, name] of data.headline) {
  at("headline").append(element("div", { class: "tile" }, element("b", {}, value), element("span", {}, name)));
}
const table = element("table");
for (const [name, value] of data.figures) table.append(element("tr", {}, element("td", {}, name), element("td", {}, value)));
at("figures").append(table);
at("footer").textContent = data.footer;

const slide = () => at("compare").style.setProperty("--cut", `${at("slider").value / 10}%`);
at("slider").addEventListener("input", slide);
slide();
