"""Elevation models: each pixel against an independent computation with fractions from the PLY of the same mesh, read by GDAL; the
same bytes whatever the memory, the threads and the pushes; what GDAL says of the file; windows; what is refused."""
import functools
import json
import os
import shutil
import struct
import sys
from fractions import Fraction

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import e2e
from e2e import expect

try:
    from osgeo import gdal, osr
    from osgeo_utils.samples.validate_cloud_optimized_geotiff import validate
except ImportError:
    e2e.unavailable("python3-gdal is not installed")
gdal.UseExceptions()
NONE = -9999.0


def read_ply(path, scale=100):
    """Vertices as lattice numbers, and triangles."""
    with open(path, "rb") as f:
        b = f.read()
    end = b.index(b"end_header\n") + 11
    n, m = (int(w.split()[2]) for w in b[:end].decode().split("\n") if w.startswith("element"))
    v = [tuple(round(c * scale) for c in struct.unpack_from("<3d", b, end + 24 * i)) for i in range(n)]
    return v, [struct.unpack_from("<3I", b, end + 24 * n + 13 * i + 1) for i in range(m)]


class Raster:
    def __init__(self, path):
        self.data = gdal.Open(path)
        g = self.data.GetGeoTransform()
        self.w, self.h = self.data.RasterXSize, self.data.RasterYSize
        self.left, self.top, self.cell = g[0], g[3], g[1]
        expect(g[2] == g[4] == 0 and g[5] == -g[1], str(g))
        band = self.data.GetRasterBand(1)
        expect(band.GetNoDataValue() == NONE, "no data is %s" % band.GetNoDataValue())
        band.Checksum()  # every tile can be decoded, or this raises

    @functools.cached_property
    def pixel(self):
        return struct.unpack("<%df" % (self.w * self.h), self.data.GetRasterBand(1).ReadRaster(0, 0, self.w, self.h, buf_type=gdal.GDT_Float32))

    def at(self, x, y):
        """By column and row."""
        return self.pixel[y * self.w + x]


def float32(v):
    """The bytes of the nearest float32 to a fraction, ties to even, by whole numbers alone."""
    if not v:
        return struct.pack("<f", 0.0)
    n, d = abs(v.numerator), v.denominator
    e = n.bit_length() - d.bit_length() - 24
    while True:
        num, den = (n << -e, d) if e < 0 else (n, d << e)
        if num // den < 1 << 24:
            break
        e += 1
    while num // den < 1 << 23:
        e -= 1
        num, den = (n << -e, d) if e < 0 else (n, d << e)
    q, r = divmod(num, den)
    q += 2 * r > den or (2 * r == den and q & 1)
    return struct.pack("<f", float(q) * 2.0 ** e * (-1 if v < 0 else 1))


def side(a, b, x, y):
    return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])


def takes(a, b):
    """Whether the edge has the centres on it: those that are inside when they are moved to the east and, much less, to the south."""
    return b[1] < a[1] or (b[1] == a[1] and b[0] < a[0])


def heights(vertices, triangles, cell, factor=1, scale=100):
    """(column, row) of absolute pixels -> bytes of the height; each of them has one owner."""
    found = {}
    n, d = (Fraction(cell) * scale).as_integer_ratio()  # a pixel in lattice units; in parts of these, 2 d each, all is whole
    places = [(2 * d * x, 2 * d * y, z) for x, y, z in vertices]
    for t in triangles:
        p = a, b, c = [places[i] for i in t]
        low, high = ([f(q[k] for q in p) // (2 * n) for k in (0, 1)] for f in (min, max))
        for row in range(low[1], high[1] + 1):
            y = (2 * row + 1) * n
            for column in range(low[0], high[0] + 1):
                x = (2 * column + 1) * n
                w = side(b, c, x, y), side(c, a, x, y), side(a, b, x, y)
                if all(v > 0 or (v == 0 and takes(p[(i + 1) % 3], p[(i + 2) % 3])) for i, v in enumerate(w)):
                    expect((column, row) not in found, "two triangles have a centre")
                    found[column, row] = float32(Fraction(sum(v * q[2] for v, q in zip(w, p)), sum(w)) / scale * factor)
    return found


def compare(raster, found, cell):
    """All pixels of a raster of the whole mesh, bit for bit."""
    first = round(raster.left / raster.cell), round(raster.top / raster.cell)
    s = Fraction(cell)
    expect(abs(raster.left - float(first[0] * s)) < 1e-6 and abs(raster.top - float(first[1] * s)) < 1e-6, "the grid is not aligned")
    seen = 0
    for y in range(raster.h):
        for x in range(raster.w):
            want = found.get((first[0] + x, first[1] - 1 - y))
            got = raster.at(x, y)
            if want is None:
                expect(got == NONE, "a height outside of the mesh, in column %d, row %d" % (x, y))
            else:
                expect(struct.pack("<f", got) == want, "%s in column %d, row %d is not %s" %
                       (got, x, y, struct.unpack("<f", want)))
                seen += 1
    expect(seen == len(found), "%d of %d pixels are in the raster" % (seen, len(found)))


def survey(base, points=6000, name="s.las", *options):
    path = os.path.join(base, name)
    e2e.run([e2e.SYNTH, "--points", points, "--density", 1, "--seed", 7, *options, path]).ok()
    return path


def pixels():
    """Elevations of a survey, of a grid whose points are on centres and borders, of other units, with long triangles left out."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        las, ply, tif = survey(base), os.path.join(base, "m.ply"), os.path.join(base, "m.tif")
        grid = os.path.join(base, "grid.las")
        e2e.run([e2e.SYNTH, "--points", 900, "--distribution", "grid", "--step", 50, "--seed", 3, grid]).ok()
        for path, cell, text, options, factor in ((las, Fraction(1), "1m", (), 1),
                                                  (las, Fraction(3, 4), "0.75", ("--z-unit", "ft"), Fraction(1250, 381)),
                                                  (las, Fraction(381, 1250) * 5, "5ft", ("--max-edge", "2"), 1),
                                                  (las, Fraction(1200, 3937) * 4, "4ftUS", ("--z-unit", "ftUS"), Fraction(3937, 1200)),
                                                  (grid, Fraction(1), "1", (), 1), (grid, Fraction(1, 4), "0.25", (), 1),
                                                  (grid, Fraction(3, 10), "0.3", (), 1)):
            d.ctl("mesh", path, *[o for o in options if "z-unit" not in o and "ft" not in o], "-o", ply).ok()
            d.ctl("mesh", path, *options, "-o", tif, "--cell", text).ok()
            found = heights(*read_ply(ply), cell, factor)
            expect(len(found) > 100, "%d pixels" % len(found))
            compare(Raster(tif), found, cell)
            warnings, errors, _ = validate(tif, full_check=True)
            expect(not warnings and not errors, "as a COG: %s %s" % (warnings, errors))


def same_bytes():
    with e2e.Folder() as base:
        one, two = survey(base, 150000, "1.las"), survey(base, 150000, "2.las", "--origin", "500200,5400100,0", "--seed", "9")
        files = []
        for memory, threads, twice in (("24M", 1, False), ("1G", 4, False), ("64M", 2, True)):
            folder = os.path.join(base, memory)
            os.mkdir(folder)
            out = os.path.join(folder, "d.tif")
            with e2e.Daemon(folder, memory=memory, threads=threads) as d:
                for inputs in ((one,), (two,)) if twice else ((one, two),):
                    d.ctl("push", "s", *inputs).ok()
                job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
                d.ctl("fetch", job, "-o", out, "--cell", "0.5").ok()
            with open(out, "rb") as f:
                files.append(f.read())
        expect(files[0] == files[1], "memory and threads change the bytes")
        expect(files[0] == files[2], "two pushes change the bytes")
        expect(len(files[0]) > 1000000, "the raster is small: %d" % len(files[0]))


def systems():
    """What GDAL says of the place and the system."""
    import crs
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        def mesh(path, *options):
            tif = os.path.join(base, "m.tif")
            d.ctl("mesh", path, "-o", tif, "--cell", "4", *options).ok()
            r = Raster(tif)
            return r, r.data.GetSpatialRef()

        r, s = mesh(crs.las(os.path.join(base, "a.las"), crs.compound(crs.UTM32, crs.HEIGHT)))
        expect((r.left, r.top, r.cell, r.w, r.h) == (500000, 5000020, 4, 5, 5), str(vars(r)))
        expect(s.IsCompound() and s.GetAuthorityCode("PROJCS") == "25832" and s.GetAuthorityCode("VERT_CS") == "7837", s.ExportToWkt())
        expect(r.data.GetMetadataItem("AREA_OR_POINT") == "Area", "pixels are points")
        r, s = mesh(crs.las(os.path.join(base, "a.las"), crs.compound(crs.UTM32, crs.HEIGHT)), "--z-unit", "ft")
        expect(not s.IsCompound() and s.GetAuthorityCode(None) == "25832", s.ExportToWkt())
        r, s = mesh(crs.las(os.path.join(base, "a.las"), crs.compound(crs.UTM32, crs.HEIGHT)), "--raster", "hillshade")
        expect(not s.IsCompound() and s.GetAuthorityCode(None) == "25832", "light is no height: " + s.ExportToWkt())
        r, s = mesh(crs.las(os.path.join(base, "b.las"), crs.UTM32))
        expect(s.IsProjected() and s.GetAuthorityCode(None) == "25832" and s.GetLinearUnits() == 1, s.ExportToWkt())
        r, s = mesh(crs.xyz(os.path.join(base, "c.xyz")))
        expect(not s or not s.GetAuthorityCode(None), s and s.ExportToWkt())
        tif = os.path.join(base, "deg.tif")
        degrees = os.path.join(base, "d.xyz")
        with open(degrees, "w") as f:
            for i in range(25):
                f.write("%.7f %.7f %.2f\n" % (8 + i % 5 * 1e-4, 50 + i // 5 * 1e-4, 100 + i * 0.37))
        d.ctl("mesh", degrees, "-o", tif, "--planar", "--assume-crs", "EPSG:4326", "--cell", "0.00001").ok()
        r = Raster(tif)
        s = r.data.GetSpatialRef()
        expect(s.IsGeographic() and s.GetAuthorityCode(None) == "4326", s.ExportToWkt())
        expect(r.w == 40 and abs(r.left - 8) < 1e-12, str(vars(r)))


def windows():
    """Windows have the pixels of the whole, each of them once, of a mesh and of a fetch."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        las, whole, part = survey(base, 40000), os.path.join(base, "w.tif"), os.path.join(base, "p.tif")
        d.ctl("push", "s", las).ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        d.ctl("fetch", job, "-o", whole, "--cell", "1").ok()
        w = Raster(whole)
        seen = {}
        for i, (x1, x2) in enumerate(((500000, 500060.5), (500060.5, 500120), (500120, 500300))):
            box = "%s,5400000,%s,5400300" % (x1, x2)
            if i == 1:
                d.ctl("mesh", las, "--bbox", box, "-o", part, "--cell", "1").ok()
            else:
                d.ctl("fetch", job, "--bbox", box, "-o", part, "--cell", "1").ok()
            p = Raster(part)
            for y in range(p.h):
                for x in range(p.w):
                    key = int(p.left - w.left) + x, int(w.top - p.top) + y
                    if p.at(x, y) != NONE:
                        expect(key not in seen, "two windows have a pixel")
                        seen[key] = p.at(x, y)
        want = {(x, y): w.at(x, y) for y in range(w.h) for x in range(w.w) if w.at(x, y) != NONE}
        expect(seen == want, "%d pixels of windows, %d of the whole" % (len(seen), len(want)))


def holds(rings, x, y):
    """Whether a centre is in a polygon: a border is to the west or north of what it belongs to."""
    def ring_holds(ring):
        odd = False
        for (ax, ay), (bx, by) in zip(ring, ring[1:] + ring[:1]):
            if (ay >= y) != (by >= y):
                odd ^= x < ax + Fraction(bx - ax) * (y - ay) / (by - ay)
        return odd
    return ring_holds(rings[0]) and not any(map(ring_holds, rings[1:]))


def polygons():
    """A raster of a polygon has the pixels of the whole whose centres are in it; of polygons side by side each has its own."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        las, whole, part, area = survey(base, 40000), base + "/w.tif", base + "/p.tif", base + "/a.wkt"
        d.ctl("push", "s", las).ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        x0, y0 = 500000, 5400000
        corner = lambda *at: [(Fraction(x) + x0, Fraction(y) + y0) for x, y in at]
        hole = corner((110, 60), (170, 60), (170, 120), ("140.5", "75.5"))  # borders through centres
        left = [corner((-10, -10), (100, -10), ("100.5", "20.5"), ("40.5", "80.5"), ("100.5", "140.5"), (100, 400), (-10, 400))]
        right = [[*left[0][1:6], *corner((400, 400), (400, -10))], hole]
        islands = [hole]
        for cell in (Fraction(1), Fraction(3, 10)):
            d.ctl("fetch", job, "-o", whole, "--cell", str(float(cell))).ok()
            w, seen = Raster(whole), {}
            line = lambda n: n * cell  # a border of pixels
            first = round(Fraction(w.left) / cell), round(Fraction(w.top) / cell)
            for i, rings in enumerate((left, right, islands)):
                with open(area, "w") as f:
                    f.write("POLYGON (%s)" % ",".join("(%s)" % ",".join("%s %s" % (float(x), float(y)) for x, y in r + r[:1]) for r in rings))
                d.ctl(*(("mesh", las) if i == 1 else ("fetch", job)), "--polygon", area, "-o", part, "--cell", str(float(cell))).ok()
                p = Raster(part)
                at = round(Fraction(p.left) / cell) - first[0], first[1] - round(Fraction(p.top) / cell)
                expect(0 <= at[0] and 0 <= at[1] and at[0] + p.w <= w.w and at[1] + p.h <= w.h, "larger than the whole")
                for y in range(p.h):
                    for x in range(p.w):
                        if p.at(x, y) != NONE:
                            key = at[0] + x, at[1] + y
                            expect(key not in seen, "two polygons have a pixel")
                            seen[key] = i, p.at(x, y)
            inside = 0
            for (x, y), (i, _) in list(seen.items())[::7] if cell == 1 else []:
                rings = (left, right, islands)[i]
                expect(holds(rings, line(first[0] + x + Fraction(1, 2)), line(first[1] - y - Fraction(1, 2))), "a centre is outside")
                inside += 1
            want = {(x, y): w.at(x, y) for y in range(w.h) for x in range(w.w) if w.at(x, y) != NONE}
            expect({k: v for k, (_, v) in seen.items()} == want, "%d pixels of polygons, %d of the whole" % (len(seen), len(want)))
            expect({i for i, _ in seen.values()} == {0, 1, 2} and (inside or cell != 1), "a polygon has no pixel")


def tiles():
    """The tiles of a raster are the whole, pixel for pixel, wherever their borders are; the same bytes with any memory."""
    import glob
    import json
    with e2e.Folder() as base:
        las = survey(base, 40000)
        hole = base + "/hole.wkt"
        with open(hole, "w") as f:
            f.write("POLYGON ((500055 5400055, 500170 5400055, 500170 5400170, 500055 5400170))")
        files = {}
        for memory, threads in (("24M", 1), ("1G", 4)):
            with e2e.Daemon(base, memory=memory, threads=threads) as d:
                d.ctl("push", memory, las).ok()
                job = d.ctl("submit", memory, "--wait", "--json").ok().json()["job"]
                for n, (cell, size, options) in enumerate((("1", "50", ()), ("0.7", "33.3", ()), ("1", "15.25", ("--erase", hole)),
                                                           ("2", "20000", ()), ("1", "64", ("--bbox", "500010.5,5400020,500150,5400123.5")),
                                                           ("1", "40", ("--raster", "hillshade", "--polygon", hole)))):
                    whole, folder = base + "/w.tif", "%s/%s-%d" % (base, memory, n)
                    d.ctl("fetch", job, "-o", whole, "--cell", cell, *options).ok()
                    j = d.ctl("fetch", job, "-o", folder, "--format", "tif", "--tile", size, "--cell", cell, *options, "--json").ok().json()
                    names = sorted(glob.glob(folder + "/tile_*.tif"))
                    files.setdefault(n, []).append([open(name, "rb").read() for name in names])
                    if memory == "1G":  # the same bytes, so they are read once
                        continue
                    w, seen, c, s = Raster(whole), {}, Fraction(cell), Fraction(size)
                    with open(folder + "/index.geojson") as f:
                        index = {i["properties"]["file"]: i["properties"] for i in json.load(f)["features"]}
                    expect(len(names) == len(index) == j["tiles"]["files"] and set(os.listdir(folder)) == set(index) | {"index.geojson"}, folder)
                    for name in names:
                        p = Raster(name)
                        row = index[os.path.basename(name)]
                        at = round(Fraction(p.left) / c), round(Fraction(p.top) / c)  # absolute pixels; the first below the upper border
                        expect(row["pixels"] == [p.w, p.h] and row["bytes"] == os.path.getsize(name), str(row))
                        expect(row["box"] == [p.left, p.top - p.h * p.cell, p.left + p.w * p.cell, p.top] or
                               all(abs(a - b) < 1e-6 for a, b in zip(row["box"], [p.left, p.top - p.h * p.cell, p.left + p.w * p.cell, p.top])), str(row))
                        for k, (low, many) in enumerate(((at[0], p.w), (at[1] - p.h, p.h))):
                            tile = row["column" if not k else "row"]
                            centre = lambda i: (2 * i + 1) * c / 2
                            expect(tile * s <= centre(low) and centre(low + many - 1) < (tile + 1) * s
                                   and centre(low - 1) < tile * s and centre(low + many) >= (tile + 1) * s, "a tile has other pixels: %s" % row)
                        here = {(at[0] + x, at[1] - 1 - y): p.at(x, y) for y in range(p.h) for x in range(p.w) if p.at(x, y) != NONE} \
                            if p.w * p.h < 1e6 else None
                        if here is None:  # one tile that has it all
                            left, top = round(Fraction(w.left) / c) - at[0], at[1] - round(Fraction(w.top) / c)
                            got = p.data.GetRasterBand(1).ReadRaster(left, top, w.w, w.h, buf_type=gdal.GDT_Float32)
                            expect(struct.unpack("<%df" % (w.w * w.h), got) == w.pixel, "another tile")
                            continue
                        expect(here and not set(here) & set(seen), "a tile without heights, or two have a pixel")
                        seen.update(here)
                        if not seen.keys() - here.keys():
                            warnings, errors, _ = validate(name, full_check=True)
                            expect(not warnings and not errors, "as a COG: %s %s" % (warnings, errors))
                    first = round(Fraction(w.left) / c), round(Fraction(w.top) / c)
                    want = {(first[0] + x, first[1] - 1 - y): w.at(x, y) for y in range(w.h) for x in range(w.w) if w.at(x, y) != NONE}
                    expect(size == "20000" or seen == want, "%s: %d pixels of tiles, %d of the whole" % (folder, len(seen), len(want)))
                    if n < 2:  # and as GDAL puts them together
                        vrt = gdal.BuildVRT(base + "/all.vrt", names)
                        left, top = vrt.GetGeoTransform()[0], vrt.GetGeoTransform()[3]
                        got = vrt.GetRasterBand(1).ReadRaster(round((w.left - left) / w.cell), round((top - w.top) / w.cell), w.w, w.h,
                                                              buf_type=gdal.GDT_Float32)
                        expect(struct.unpack("<%df" % (w.w * w.h), got) == w.pixel, "the mosaic differs")
        for n, (one, two) in files.items():
            expect(one == two and (n == 3) == (len(one) == 1), "other tiles with other memory")


def picture_tiles(d, base, job):
    """Tiles of pictures are those of the hillshade as GeoTIFF, pixel by pixel and place by place; each has its world file."""
    one, other = base + "/png", base + "/tif"
    for cell, side, words in (("1", "50", ()), ("0.3", "47.7", ()), ("2ft", "60", ("--bbox", "500010.5,5400020,500150.2,5400100")),
                              ("1", "50", ("--polygon", base + "/a.wkt"))):
        got = d.ctl("fetch", job, "-o", one, "--format", "png", "--tile", side, "--cell", cell, *words, "--json").ok().json()
        d.ctl("fetch", job, "-o", other, "--format", "tif", "--tile", side, "--cell", cell, "--raster", "hillshade", *words).ok()
        names = [n[:-4] for n in sorted(os.listdir(other)) if n.endswith(".tif")]
        expect(len(names) > 3 and sorted(os.listdir(one)) == sorted(["index.geojson"] + [n + e for n in names for e in (".png", ".pgw", ".png.aux.xml")]),
               "%s, not %s" % (os.listdir(one), names))
        expect(got["output_bytes"] == sum(os.path.getsize(os.path.join(one, n)) for n in os.listdir(one)), str(got["output_bytes"]))
        for name in names:
            p, t = gdal.Open("%s/%s.png" % (one, name)), Raster("%s/%s.tif" % (other, name))
            grey, alpha = (p.GetRasterBand(i).ReadRaster() for i in (1, 2))
            expect((p.RasterXSize, p.RasterYSize) == (t.w, t.h) and
                   all((a == 255 and g == v) if v != NONE else a == 0 for g, a, v in zip(grey, alpha, t.pixel)), "other pixels in " + name)
            expect(all(abs(a - b) < 1e-7 for a, b in zip(p.GetGeoTransform(), t.data.GetGeoTransform())), name)
            expect(p.GetSpatialRef().GetAuthorityCode(None) == "25832", p.GetProjection())
        with open(one + "/index.geojson") as f, open(other + "/index.geojson") as g:
            boxes = [[(v["properties"]["column"], v["properties"]["row"], v["properties"]["box"], v["properties"]["pixels"])
                      for v in json.load(h)["features"]] for h in (f, g)]
        expect(boxes[0] == boxes[1], "%s, not %s" % tuple(boxes))
        # What is there and may not be replaced.
        os.unlink(one + "/index.geojson")
        for n in names:
            os.unlink("%s/%s.png" % (one, n))
        before = sorted(os.listdir(one))
        r = d.ctl("fetch", job, "-o", one, "--format", "png", "--tile", side, "--cell", cell, *words, "--no-clobber")
        expect(r.status == 2 and ".pgw" in r.err and sorted(os.listdir(one)) == before, r.err)
        shutil.rmtree(one)
        shutil.rmtree(other)



def pictures():
    """A picture with --cell has the pixels of the hillshade of that cell, and GDAL knows where they are."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        las, png, tif = survey(base, 40000), base + "/h.png", base + "/h.tif"
        area = base + "/a.wkt"
        with open(area, "w") as f:
            f.write("POLYGON ((500000 5400000, 500150 5400000, 500000 5400150))")
        d.ctl("push", "s", las, "--override-crs", "EPSG:25832").ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        for cell, words in (("1m", ()), ("0.3", ()), ("2ft", ("--raster", "hillshade")), ("1", ("--bbox", "500010.5,5400020,500050.2,5400100")),
                            ("0.5", ("--polygon", area))):
            d.ctl("fetch", job, *[w for w in words if w not in ("--raster", "hillshade")], "-o", png, "--cell", cell,
                  *[w for w in words if w in ("--raster", "hillshade")], "-o", tif, "--cell", cell, "--raster", "hillshade").ok()
            p, t = gdal.Open(png), Raster(tif)
            expect((p.RasterXSize, p.RasterYSize, p.RasterCount) == (t.w, t.h, 2), "%d x %d" % (p.RasterXSize, p.RasterYSize))
            grey, alpha = (p.GetRasterBand(i).ReadRaster() for i in (1, 2))
            expect(all((a == 255 and g == v) if v != NONE else a == 0 for g, a, v in zip(grey, alpha, t.pixel)), "other pixels")
            expect(all(abs(a - b) < 1e-7 for a, b in zip(p.GetGeoTransform(), t.data.GetGeoTransform())), "%s %s" %
                   (p.GetGeoTransform(), t.data.GetGeoTransform()))
            expect(p.GetSpatialRef().GetAuthorityCode(None) == "25832", p.GetProjection())
        before = sorted(os.listdir(base))
        for words, said in ((("--width", "100"), "two sizes"), (("--color", "elevation"), "--color has no meaning"),
                            (("--raster", "slope"), "holds no heights"), (("--raster", "elevation"), "holds no heights"), (("--no-clobber",), "exists")):
            out = base + ("/h.png" if "--no-clobber" in words else "/x.png")
            r = d.ctl("fetch", job, "-o", out, "--format", "png", "--cell", "1", *words)
            expect(r.status == 2 and said in r.err, "%s: %d %s" % (words, r.status, r.err))
        r = d.ctl("fetch", job, "-o", base + "/x.png", "--raster", "hillshade")
        expect(r.status == 2 and "--cell" in r.err, r.err)
        os.unlink(png)
        r = d.ctl("fetch", job, "-o", png, "--cell", "1", "--no-clobber")
        expect(r.status == 2 and "h.pgw" in r.err and not os.path.exists(png), "a world file that exists: " + r.err)
        with open(base + "/pipe.png", "wb") as f:
            e2e.subprocess.run([e2e.ACUTCTL, "fetch", str(job), "-o", "-", "--format", "png", "--cell", "1"], stdout=f, check=True,
                               env=dict(os.environ, ACUT_SOCKET=d.socket))
        os.unlink(base + "/h.pgw")
        os.unlink(png + ".aux.xml")
        expect(sorted(os.listdir(base)) == sorted(set(before) - {"h.png", "h.pgw", "h.png.aux.xml"} | {"pipe.png"}), str(os.listdir(base)))
        picture_tiles(d, base, job)
        # A system without a number, by its WKT.
        import crs
        odd = crs.UTM32.replace(',AUTHORITY["EPSG","25832"]', "").replace("zone 32N", "zone 32N & more").replace("meridian\",9", "meridian\",9.5")
        d.ctl("mesh", crs.las(base + "/odd.las", odd), "-o", png, "--cell", "4").ok()
        got = gdal.Open(png).GetSpatialRef()
        expect(got and got.IsProjected() and "zone 32N & more" in got.ExportToWkt(), str(got))
        os.unlink(png + ".aux.xml")
        # Without a system there is a world file alone.
        d.ctl("mesh", crs_xyz(base), "-o", png, "--cell", "1").ok()
        expect(os.path.exists(base + "/h.pgw") and not os.path.exists(png + ".aux.xml"), "a system out of nothing")


def crs_xyz(base):
    with open(base + "/c.xyz", "w") as f:
        f.writelines("%d %d %d\n" % (i % 5, i // 5, i % 3) for i in range(25))
    return base + "/c.xyz"


def memory():
    """acutctl stays below 64 MiB with a raster of 25 million pixels, in one file, in tiles, cut at a polygon, and three at once."""
    import subprocess
    import time
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        d.ctl("push", "s", survey(base, 60000)).ok()
        job = str(d.ctl("submit", "s", "--wait", "--json").ok().json()["job"])
        area = base + "/a.wkt"
        with open(area, "w") as f:
            f.write("POLYGON ((500000 5400000, 500300 5400000, 500000 5400300))")
        out = lambda n: ("-o", "%s/%d.tif" % (base, n), "--cell", "0.05")
        for words in (out(0), ("-o", base + "/tiles", "--format", "tif", "--cell", "0.05", "--tile", "20"),
                      (*out(1), "--polygon", area), (*out(2), *out(3), "--raster", "slope", *out(4), "--raster", "hillshade"),
                      ("-o", base + "/h.png", "--cell", "0.05", "--sidecar")):
            p = subprocess.Popen([e2e.ACUTCTL, "fetch", job, *words], env=dict(os.environ, ACUT_SOCKET=d.socket),
                                 stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            peak = 0
            while p.poll() is None:
                with open("/proc/%d/status" % p.pid) as f:
                    peak = max([peak] + [int(line.split()[1]) for line in f if line.startswith("VmHWM")])
                time.sleep(0.01)
            expect(p.returncode == 0, p.stderr.read())
            p.stderr.close()
            print("     VmHWM of acutctl %.1f MiB with %s" % (peak / 1024, " ".join(w for w in words if w.startswith("--"))))
            expect(e2e.sanitized() or peak < 64 * 1024, "VmHWM %d KiB with %s" % (peak, words))
        expect(len(os.listdir(base + "/tiles")) > 100, "%d tiles" % len(os.listdir(base + "/tiles")))


def refused():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        las, tif = survey(base), os.path.join(base, "r.tif")
        d.ctl("push", "s", las).ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        d.ctl("push", "s", survey(base, 100, "t.las", "--seed", "2")).ok()
        other = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        for words, args in ((("--cell 1m",), ("mesh", las, "-o", tif)),
                            (("--cell is not a length",), ("mesh", las, "-o", tif, "--cell", "1x")),
                            (("--cell is not a length",), ("mesh", las, "-o", tif, "--cell", "0")),
                            (("--raster is",), ("mesh", las, "-o", tif, "--cell", "1", "--raster", "aspect")),
                            (("--cell has no meaning for ply",), ("mesh", las, "-o", tif, "--cell", "1", "-o", tif + ".ply", "--cell", "1")),
                            (("--cell 1m",), ("mesh", las, "-o", tif, "-o", tif + "f", "--cell", "1")),
                            (("--cell has no meaning for ply",), ("mesh", las, "-o", tif, "-o", tif + ".ply", "--cell", "1")),
                            (("--origin has no meaning for tif",), ("mesh", las, "-o", tif, "--cell", "1", "--origin", "auto")),
                            (("--canonical has no meaning for tif",), ("mesh", las, "-o", tif, "--cell", "1", "--canonical")),
                            (("--tile is less than --cell",), ("fetch", job, "-o", tif + "/", "--format", "tif", "--cell", "1", "--tile", "0.99")),
                            (("more than 100000 tiles", "larger --tile"), ("fetch", job, "-o", tif + "/", "--format", "tif", "--cell", "0.1", "--tile", "0.1")),
                            (("smaller --tile",), ("fetch", job, "-o", tif + "/", "--format", "tif", "--cell", "0.1", "--tile", "100000")),
                            (("--changed-since has no meaning for tif",), ("fetch", other, "-o", tif, "--cell", "1", "--changed-since", "1")),
                            (("into tif cannot be resumed",), ("fetch", job, "-o", tif, "--cell", "1", "--resume")),
                            (("too many digits",), ("mesh", las, "-o", tif, "--cell", "0.12345678901"))):
            r = d.ctl(*args)
            expect(r.status == 2 and all(w in r.err for w in words), "%s: %d\n%s" % (args, r.status, r.err))
            expect(not os.path.exists(tif), "%s: there is an output" % (args,))
        # Far too many pixels are refused before the disk fills with them, with a cell that fits.
        big = os.path.join(base, "big.xyz")
        with open(big, "w") as f:
            f.write("0 0 1\n100000 0 2\n0 100000 3\n100000 100000 4\n")
        r = d.ctl("mesh", big, "--assume-units", "m,m", "-o", tif, "--cell", "0.01")
        expect(r.status == 2 and "--cell 2 fits" in r.err and not os.path.exists(tif), r.err)
        # A mean of two pixels may have the value of no data.
        flat = os.path.join(base, "flat.xyz")
        with open(flat, "w") as f:
            f.writelines("%d %d %d\n" % (x, y, -9999 + 2 * (x - 3)) for x in range(300) for y in range(4))
        d.ctl("mesh", flat, "--assume-units", "m,m", "-o", tif, "--cell", "1").ok()
        os.unlink(tif)
        low = os.path.join(base, "u.xyz")
        with open(low, "w") as f:
            f.write("0 0 1\n10 0 1\n0 10 1\n")
        r = d.ctl("mesh", low, "-o", tif, "--cell", "1m")
        expect(r.status == 2 and "--assume-units" in r.err and not os.path.exists(tif), r.err)


if __name__ == "__main__":
    e2e.main(pixels, same_bytes, systems, windows, polygons, tiles, pictures, memory, refused)
