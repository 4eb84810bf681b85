"""A frame of CADRG (MIL-C-89038) or CIB (MIL-PRF-89041), both in the Raster Product Format of MIL-STD-2411: a NITF file whose pixels
are 4 x 4 patches of a codebook of 4096 (vector quantization), with a table of colours (CADRG) or greys (CIB), and whose place is
stated in its coverage section. Byte by byte, because no program of Debian 12 writes them: GDAL does since 3.13, and CADRG alone."""
import random
import struct

SIDE, BLOCK, PATCH, CODES, COLOURS = 1536, 256, 4, 4096, 216
HEADER, COVERAGE, LOOKUP, SPATIAL = 128, 130, 132, 140  # ids of what the location section names


def text(value, size):
    return str(value).ljust(size).encode()[:size]


def number(value, size):
    return str(value).zfill(size).encode()


def tre(tag, data):
    return text(tag, 6) + number(len(data), 5) + data


SECURITY = text("U", 1) + text("", 166)


class Frame:
    """Colours and codes at random, between these corners in degrees."""

    def __init__(self, west, north, east, south, seed=1, grey=False):
        generator = random.Random(seed)
        self.grey = grey
        self.corners = [(north, west), (south, west), (north, east), (south, east)]
        self.colours = [bytes([20 + index] * 3) if grey else bytes(generator.randrange(40, 216) for _ in range(3)) for index in range(COLOURS)]
        self.patches = [[bytes(generator.randrange(COLOURS) for _ in range(PATCH)) for _ in range(PATCH)] for _ in range(CODES)]
        self.codes = [[generator.randrange(CODES) for _ in range(SIDE // PATCH)] for _ in range(SIDE // PATCH)]

    def ppm(self):
        """The picture that a reader must see."""
        rows = []
        for codes in self.codes:
            for line in range(PATCH):
                rows.append(b"".join(self.colours[index] for code in codes for index in self.patches[code][line]))
        return b"P6 %d %d 255\n" % (SIDE, SIDE) + b"".join(rows)

    def spatial_data(self):
        """Block by block, two codes of 12 bits in three bytes."""
        out = bytearray()
        across = BLOCK // PATCH
        for top in range(0, SIDE // PATCH, across):
            for left in range(0, SIDE // PATCH, across):
                for row in self.codes[top:top + across]:
                    for first, second in zip(row[left:left + across:2], row[left + 1:left + across:2]):
                        out += bytes((first >> 4, (first & 15) << 4 | second >> 8, second & 255))
        return bytes(out)

    def lookup(self):
        """One table for each line of a patch."""
        records = b"".join(struct.pack(">HIHHI", line + 1, CODES, PATCH, 8, 6 + 4 * 14 + line * CODES * PATCH) for line in range(PATCH))
        return struct.pack(">IH", 6, 14) + records + b"".join(patch[line] for line in range(PATCH) for patch in self.patches)

    def image_header(self, locations):
        tables = 1 if self.grey else 3
        luts = b"".join(bytes(colour[band] for colour in self.colours) for band in range(tables))
        title, representation, category = ("CIB", "MONO", "VIS") if self.grey else ("CADRG", "RGB/LUT", "MAP")
        degrees = "".join(f"{int(abs(lat)):02d}{int(abs(lat) * 60 % 60):02d}{int(abs(lat) * 3600 % 60):02d}N"
                          f"{int(abs(lon)):03d}{int(abs(lon) * 60 % 60):02d}{int(abs(lon) * 3600 % 60):02d}E"
                          for lat, lon in (self.corners[0], self.corners[2], self.corners[3], self.corners[1]))
        records = b"".join(struct.pack(">HII", name, size, at) for name, size, at in locations)
        section = tre("RPFIMG", struct.pack(">HIHHI", 14 + len(records), 14, len(locations), 10, 0) + records)
        return b"".join((b"IM", text(title, 10), text("20261126000000", 14), text("", 17), text("", 80), SECURITY, b"0", text("", 42), number(SIDE, 8), number(SIDE, 8),
                         b"INT", text(representation, 8), text(category, 8), b"08", b"R", b"G", text(degrees, 60), b"0", b"C4", text("8.00", 4), b"1",
                         text("LU", 2), text("", 6), b"N", text("", 3), str(tables).encode(), number(COLOURS, 5), luts, b"0", b"B",
                         number(SIDE // BLOCK, 4), number(SIDE // BLOCK, 4), number(BLOCK, 4), number(BLOCK, 4), b"08", b"001", b"000", b"0000000000",
                         text("1.0", 4), number(3 + len(section), 5), b"000", section, number(0, 5)))

    def nitf(self):
        coverage = struct.pack(">8d", *(value for corner in self.corners for value in corner))
        lookup, spatial = self.lookup(), self.spatial_data()
        image_bytes = len(coverage) + len(lookup) + len(spatial)
        subheader_bytes = len(self.image_header([(0, 0, 0)] * 4))

        def header(at):
            rpf = tre("RPFHDR", b"\0" + struct.pack(">H", 48) + text("00000000.I42" if self.grey else "00000000.JN1", 12) + b"0" + text("MIL-PRF-89041A" if self.grey else "MIL-C-89038", 15) + text("20261126", 8) + b"U" +
                      text("", 4) + struct.pack(">I", at))
            fixed = b"".join((b"NITF02.10", b"03", b"BF01", text("", 10), text("20261126000000", 14), text("", 80), SECURITY, number(0, 5), number(0, 5), b"0",
                              bytes(3), text("", 24), text("", 18)))
            rest = b"".join((b"001", number(subheader_bytes, 6), number(image_bytes, 10), b"000" * 5, number(3 + len(rpf), 5), b"000", rpf, number(0, 5)))
            size = len(fixed) + 12 + 6 + len(rest)
            return fixed + number(size + subheader_bytes + image_bytes, 12) + number(size, 6) + rest
        begin = len(header(0)) + subheader_bytes
        places, at = [], begin
        for name, part in ((COVERAGE, coverage), (LOOKUP, lookup), (SPATIAL, spatial)):
            places.append((name, len(part), at))
            at += len(part)
        head = header(begin)
        places.insert(0, (HEADER, 48, head.index(b"RPFHDR") + 11))
        return head + self.image_header(places) + coverage + lookup + spatial
