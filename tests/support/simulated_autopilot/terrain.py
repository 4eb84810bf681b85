"""Heights of the ground: one number, or an Arc/Info ASCII grid in degrees (gdal_translate -of AAIGrid)."""


class Flat:
    def __init__(self, height):
        self.value = height

    def height(self, _lat_deg, _lon_deg):
        return self.value


class Grid:
    """Bilinear between cell centres; beyond the rim, the rim's heights."""

    def __init__(self, path):
        head = {}
        with open(path, encoding="ascii") as file:
            words = file.read().split()
        at = 0
        while words[at][0].isalpha() and words[at].lower() != "nan":
            head[words[at].lower()] = float(words[at + 1])
            at += 2
        self.columns, self.rows = int(head["ncols"]), int(head["nrows"])
        self.dx = head.get("cellsize", head.get("dx"))
        self.dy = head.get("cellsize", head.get("dy"))
        self.west = head["xllcorner"] if "xllcorner" in head else head["xllcenter"] - self.dx / 2
        south = head["yllcorner"] if "yllcorner" in head else head["yllcenter"] - self.dy / 2
        self.north = south + self.rows * self.dy
        self.values = [float(word) for word in words[at:]]
        if len(self.values) != self.rows * self.columns:
            raise ValueError(f"{path}: {len(self.values)} heights, expected {self.rows} x {self.columns}")
        nothing = head.get("nodata_value")
        known = [value for value in self.values if value != nothing]
        if not known:
            raise ValueError(f"{path}: no heights")
        mean = sum(known) / len(known)  # a warped grid has empty corners
        self.values = [mean if value == nothing else value for value in self.values]

    def height(self, lat_deg, lon_deg):
        x = min(max((lon_deg - self.west) / self.dx - 0.5, 0), self.columns - 1)
        y = min(max((self.north - lat_deg) / self.dy - 0.5, 0), self.rows - 1)
        c, r = min(int(x), self.columns - 2), min(int(y), self.rows - 2)
        tx, ty = x - c, y - r
        at = r * self.columns + c
        top = self.values[at] * (1 - tx) + self.values[at + 1] * tx
        bottom = self.values[at + self.columns] * (1 - tx) + self.values[at + self.columns + 1] * tx
        return top * (1 - ty) + bottom * ty
