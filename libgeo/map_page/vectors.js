// Roads, water, woods and buildings of a package (docs/formats/vectors.md), above the imagery and beneath all else that is drawn,
// with a box to switch them off and what their licence asks to be shown.
//
//   const vectors = makeVectorOverlay(map);   // of our base map; { place: ([lon, lat]) => [lat, lng] } where it is not in degrees
//   vectors.show(geojson);                    // null: none
//   vectors.load(path);                       // from a service; a package without them answers 204
//
// Drawn tile by tile on canvases: a town has tens of thousands of buildings.

const vectorStyles = {
  wood: { fill: "rgba(38,120,52,.20)", stroke: "rgba(38,120,52,.75)", width: 1 },
  water: { fill: "rgba(10,88,202,.30)", stroke: "rgba(120,180,255,.95)", width: 1.4 },
  building: { fill: "rgba(255,196,120,.28)", stroke: "rgba(255,214,160,.9)", width: .8 },
  road: { stroke: "#ffe9b8", width: 1.6 },
};
const wideRoads = { motorway: 3.2, trunk: 3, primary: 2.8, secondary: 2.4, tertiary: 2.1, rail: 1.3, track: 1, path: .8, footway: .8, cycleway: .8 };
const leastShown = 2;  // pixels on the screen; smaller ones are left out

const makeVectorOverlay = (map, { place = ([lon, lat]) => [lat, lon], zIndex = 250 } = {}) => {
  const crs = map.options.crs, side = 256, pane = map.createPane("vectors");
  pane.style.zIndex = zIndex;
  pane.style.pointerEvents = "none";
  let features = [], layer = null, control = null, credit = null, wanted = true, asked = 0;

  // In pixels of zoom 0, which those of every other zoom are multiples of.
  const projected = (coordinates) => {
    const points = new Float64Array(2 * coordinates.length);
    coordinates.forEach((coordinate, i) => {
      const point = crs.latLngToPoint(L.latLng(place(coordinate)), 0);
      points[2 * i] = point.x;
      points[2 * i + 1] = point.y;
    });
    return points;
  };
  const prepared = ({ properties, geometry }) => {
    const area = geometry.type === "Polygon", parts = (area ? geometry.coordinates : [geometry.coordinates]).map(projected);
    let west = Infinity, north = Infinity, east = -Infinity, south = -Infinity;
    for (let i = 0; i < parts[0].length; i += 2) {
      west = Math.min(west, parts[0][i]), east = Math.max(east, parts[0][i]);
      north = Math.min(north, parts[0][i + 1]), south = Math.max(south, parts[0][i + 1]);
    }
    return { style: vectorStyles[properties.class], wide: wideRoads[properties.kind], area, parts, west, north, east, south };
  };

  const Tiles = L.GridLayer.extend({
    createTile(coords) {
      const ratio = window.devicePixelRatio || 1, canvas = document.createElement("canvas");
      canvas.width = canvas.height = side * ratio;
      canvas.setAttribute("role", "presentation");
      const scale = crs.scale(coords.z) / crs.scale(0), left = coords.x * side, top = coords.y * side, rim = 4;
      const context = canvas.getContext("2d");
      context.scale(ratio, ratio);
      context.lineJoin = "round";
      for (const { style, wide, area, parts, west, north, east, south } of features) {
        if (east * scale < left - rim || west * scale > left + side + rim || south * scale < top - rim || north * scale > top + side + rim) continue;
        if (Math.max(east - west, south - north) * scale < leastShown) continue;
        context.beginPath();
        for (const points of parts) {
          for (let i = 0; i < points.length; i += 2) {
            const x = points[i] * scale - left, y = points[i + 1] * scale - top;
            if (i === 0) context.moveTo(x, y); else context.lineTo(x, y);
          }
        }
        if (area) {
          context.fillStyle = style.fill;
          context.fill("evenodd");
        } else {
          context.strokeStyle = "rgba(10,15,20,.55)";
          context.lineWidth = (wide ?? style.width) + 1.4;
          context.stroke();
        }
        context.strokeStyle = style.stroke;
        context.lineWidth = wide ?? style.width;
        context.stroke();
      }
      return canvas;
    },
  });

  const draw = () => {
    layer?.remove();
    layer = null;
    if (wanted && features.length > 0) layer = new Tiles({ pane: "vectors", tileSize: side, minZoom: -20, maxZoom: 30, keepBuffer: 1 }).addTo(map);
  };
  const offer = (attribution) => {
    control = L.control({ position: "topright" });
    control.onAdd = () => {
      const label = document.createElement("label"), box = document.createElement("input"), text = document.createElement("span");
      label.className = "leaflet-bar vectors-switch";
      Object.assign(label.style, { display: "flex", gap: "6px", alignItems: "center", padding: "5px 9px", background: "rgba(255,255,255,.92)", color: "#0a0f14",
                                   font: "13px/1.3 system-ui, sans-serif", whiteSpace: "nowrap", cursor: "pointer" });
      box.type = "checkbox";
      Object.assign(box.style, { width: "16px", height: "16px", minHeight: "0", margin: "0", flex: "none" });  // whatever the page's style gives to others
      box.checked = wanted;
      box.addEventListener("change", () => { wanted = box.checked; draw(); });
      text.textContent = map.attributionControl ? "roads, water" : `roads, water: ${attribution}`;
      label.title = attribution;
      label.append(box, text);
      L.DomEvent.disableClickPropagation(label);
      return label;
    };
    control.addTo(map);
  };

  const overlay = {
    show: (collection) => {
      ++asked;
      if (credit) map.attributionControl?.removeAttribution(credit);
      control?.remove();
      control = credit = null;
      features = (collection?.features ?? []).map(prepared);
      if (features.length > 0) {
        const attribution = `${collection.attribution}, ${collection.licence}`, text = document.createElement("span");
        text.textContent = attribution;
        credit = text.innerHTML;  // escaped
        map.attributionControl?.addAttribution(credit);
        offer(attribution);
      }
      draw();
    },
    load: async (path) => {
      const mine = ++asked;
      try {
        const response = await call(path), collection = response.status === 200 ? await response.json() : null;
        if (mine === asked) overlay.show(collection);
      } catch (error) {
        console.info("vectors:", error.message);  // the map does without them
      }
    },
  };
  return overlay;
};
