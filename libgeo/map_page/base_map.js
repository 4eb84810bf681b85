// The map beneath all of our pages, on Leaflet (L): its controls, a package's tiles, and what is drawn on it in metres.
//
//   const { map, renderer } = makeBaseMap(element);
//   makePackageTiles(pack, (z, x, y) => path).addTo(map);
//   L.polygon(ellipsePoints(position), { renderer, … }).addTo(map);
//
// Tiles are fetched by call(), because an <img> cannot send a token.

// They differ in brightness as well; the first is the one that most flights have alone.
const segmentColours = ["#0a58ca", "#d9480f", "#067a4f", "#862e9c", "#b08900", "#c2255c", "#0b7285", "#5c3d1e"];
const segmentColour = (segment) => segmentColours[segment % segmentColours.length];
const sigmasOf95 = 2.448;
const metresPerDegree = 111320;

// east_m and north_m of a place, as latitude and longitude. For distances of a picture or an ellipse.
const placeAt = ({ lat, lon }, east, north) => [lat + north / metresPerDegree, lon + east / (metresPerDegree * Math.cos(lat * Math.PI / 180))];

// The ellipse as a polygon. bearing_deg: of the major axis, clockwise from north. sigmas: of the axes that are given.
const ellipsePoints = ({ lat, lon, ellipse }, sigmas = sigmasOf95) => {
  const bearing = ellipse.bearing_deg * Math.PI / 180, points = [];
  for (let i = 0; i < 48; ++i) {
    const along = sigmas * ellipse.major_m * Math.cos(i * Math.PI / 24), across = sigmas * ellipse.minor_m * Math.sin(i * Math.PI / 24);
    points.push(placeAt({ lat, lon }, along * Math.sin(bearing) + across * Math.cos(bearing), along * Math.cos(bearing) - across * Math.sin(bearing)));
  }
  return points;
};

const makeBaseMap = (container, options = {}) => {
  const map = L.map(container, { preferCanvas: true, zoomControl: true, maxZoom: 22, zoomSnap: 0.25, attributionControl: true, ...options });
  map.attributionControl?.setPrefix("Leaflet");
  L.control.scale({ imperial: false }).addTo(map);
  new ResizeObserver(() => map.invalidateSize({ animate: false })).observe(container);
  return { map, renderer: L.canvas({ padding: 0.3, tolerance: 6 }) };
};

// pathOf(zoom, column, row): of a tile.
const makePackageTiles = (pack, pathOf) => {
  const Tiles = L.GridLayer.extend({
    createTile(coords, done) {
      const tile = document.createElement("img");
      tile.alt = "";
      tile.setAttribute("role", "presentation");
      const abort = new AbortController();
      tile.stop = () => abort.abort();
      call(pathOf(coords.z, coords.x, coords.y), {}, abort.signal).then(async (response) => {
        if (response.status !== 200) return done(null, tile);  // beyond the edge of the map
        const address = URL.createObjectURL(await response.blob());
        tile.onload = tile.onerror = () => { URL.revokeObjectURL(address); done(null, tile); };
        tile.src = address;
      }).catch((error) => done(error, tile));
      return tile;
    },
  });
  const [west, south, east, north] = pack.bounds;
  // Farther out, Leaflet would go through the tiles of all that the window shows, at the least zoom that there is.
  const farthest = Math.max(0, pack.zooms.min - 3);
  const tiles = new Tiles({ minNativeZoom: pack.zooms.min, maxNativeZoom: pack.zooms.max, minZoom: farthest, maxZoom: 22, keepBuffer: 1,
                            bounds: [[south, west], [north, east]] });
  tiles.on("tileunload", ({ tile }) => tile.stop());
  return tiles;
};
