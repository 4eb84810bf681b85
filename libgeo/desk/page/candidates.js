// Candidates: where a lost frame may have been taken, best first, as the search found them. Beside the picture stands the
// map at each, turned as the picture is.

const mostCandidates = 5, cropWidth = 220, cropHeight = 165;  // pixels

// The map around a place, width_m wide, with the heading upwards. False when the map shows nothing there.
const drawMapCrop = async (canvas, pack, { lat_deg: lat, lon_deg: lon, heading_deg: heading }, width) => {
  const context = canvas.getContext("2d"), metresPerPixel = width / canvas.width;
  const around = 156543.034 * Math.cos(lat * Math.PI / 180);  // metres a pixel of a tile at zoom 0
  const zoom = Math.min(pack.zooms.max, Math.max(pack.zooms.min, Math.ceil(Math.log2(around / metresPerPixel))));
  const scale = around / 2 ** zoom / metresPerPixel, count = 2 ** zoom;
  const x = (lon + 180) / 360 * count, y = (.5 - Math.asinh(Math.tan(lat * Math.PI / 180)) / (2 * Math.PI)) * count;
  const reach = Math.hypot(canvas.width, canvas.height) / 2 / scale / 256, tiles = [];
  for (let row = Math.floor(y - reach); row <= y + reach; ++row)
    for (let column = Math.floor(x - reach); column <= x + reach; ++column) tiles.push([column, row]);
  const images = await Promise.all(tiles.slice(0, 64).map(async ([column, row]) => {
    const response = await call(`/v1/packages/${encodeURIComponent(pack.name)}/tiles/${zoom}/${column}/${row}`);
    return response.status === 200 ? { column, row, image: await createImageBitmap(await response.blob()) } : null;
  }));
  context.setTransform(1, 0, 0, 1, canvas.width / 2, canvas.height / 2);
  context.rotate(-heading * Math.PI / 180);
  context.scale(scale, scale);
  for (const tile of images) {
    if (tile) context.drawImage(tile.image, (tile.column - x) * 256, (tile.row - y) * 256, 256.5, 256.5);
  }
  return images.some((tile) => tile);
};

const makeCandidates = ({ pack, footprintOf, previewOf, onChoose }) => {
  let turn = 0;  // what was asked for before the last hide() or show() is no longer wanted
  const hide = () => { ++turn; byId("candidates").hidden = true; byId("candidate-list").replaceChildren(); };
  const show = async (event) => {
    hide();
    const candidates = (event.candidates ?? []).slice(0, mostCandidates), mine = turn;
    if (candidates.length === 0) return;
    const [print, address] = await Promise.all([footprintOf(event.frame), previewOf(event.frame)]);
    if (mine !== turn) return;
    byId("candidates").hidden = false;
    byId("candidates-heading").textContent = `Where was frame ${event.frame} taken?`;
    byId("candidates-picture").src = address;
    const width = print.corners ? Math.hypot(print.corners[1][0] - print.corners[0][0], print.corners[1][1] - print.corners[0][1]) : 200;
    byId("candidate-list").replaceChildren(...candidates.map((candidate, i) => {
      const canvas = element("canvas", { width: cropWidth, height: cropHeight, role: "img", "aria-label": `The map at candidate ${i + 1}` });
      const percent = Math.round(100 * Math.min(1, Math.max(0, candidate.likeness)));
      const button = element("button", { type: "button", "aria-label": `The frame was taken at candidate ${i + 1}` }, "It is here");
      button.addEventListener("click", () => onChoose(event.frame, candidate));
      if (pack()) drawMapCrop(canvas, pack(), candidate, width * (candidate.scale ?? 1)).catch((error) => console.info(error.message));
      return element("li", {}, canvas,
        element("div", { class: "likeness" }, element("meter", { min: 0, max: 100, value: percent, "aria-label": `Likeness of candidate ${i + 1}` }, `${percent} %`), element("b", {}, `${percent} %`)),
        element("span", { class: "soft" }, `${candidate.lat_deg.toFixed(5)}, ${candidate.lon_deg.toFixed(5)}`), button);
    }));
  };
  return { show: (event) => show(event).catch((error) => console.info(error.message)), hide };
};
