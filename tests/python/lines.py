"""Breaklines and areas from Python: acut.Lines makes the text that acutd reads, the mesh is that of acutctl with the same lines, and what
became of them is in the result. Run under -X dev -W error."""
import decimal
import gc
import os
import struct

import acut
import e2e
from e2e import Daemon, Folder, expect, until
from module import SMALL, lost, raises, synth


def text_of(*args, **kw):
    lines = acut.Lines(*args, **kw)
    return os.pread(lines.fileno(), 1 << 20, 0).decode().splitlines()


class Shape:
    """As shapely's and geopandas' objects show themselves."""

    def __init__(self, kind, coordinates):
        self.__geo_interface__ = {"type": kind, "coordinates": coordinates}


def texts():
    line = [(0, 0, 1), (5, 0.1, decimal.Decimal("2.50"))]
    want = ["acut-lines 1", "feature 1 hard", "line", "0 0 1", "5 0.1 2.50"]
    expect(text_of(line) == text_of([line]) == text_of(iter([tuple(line)]), kind="soft") == want, "vertices: %s" % text_of(line))
    expect(text_of(Shape("LineString", line)) == text_of({"type": "LineString", "coordinates": line}) == want, "a geometry")
    numbers = memoryview(struct.pack("<6d", 1, 2, 3, 4, 5, 6)).cast("B").cast("d", [2, 3])
    expect(text_of(numbers)[3:] == ["1.0 2.0 3.0", "4.0 5.0 6.0"], "an array: %s" % text_of(numbers))
    outer, inner = [(0, 0, 7), (9, 0, 7), (9, 9, 7), (0, 0, 7)], [(4, 2, 7), (6, 2, 7), (6, 4, 7), (4, 2, 7)]
    rings = ["ring", "0 0 7", "9 0 7", "9 9 7", "ring", "4 2 7", "6 2 7", "6 4 7"]
    expect(text_of(Shape("Polygon", [outer, inner]), kind="lake", lake_level="min", densify="5.5m", crs="EPSG:2154") ==
           ["acut-lines 1", "crs EPSG:2154", "densify 5.5 m", "lake-level min", "feature 1 lake"] + rings, "a polygon with an island")
    expect(text_of([Shape("MultiPolygon", [[outer], [inner]])], kind="hole")[1:] == ["feature 1 hole"] + rings, "two polygons are one area")
    expect(text_of(outer, kind="boundary") == text_of(outer[:3], kind="boundary") == text_of(Shape("LineString", outer), kind="boundary"), "rings")
    collection = {"type": "FeatureCollection", "features": [
        {"type": "Feature", "properties": {"what": "Lake"}, "geometry": {"type": "Polygon", "coordinates": [outer]}},
        {"type": "Feature", "properties": None, "geometry": {"type": "MultiLineString", "coordinates": [line, line]}},
        {"type": "Feature", "properties": {"what": ""}, "geometry": {"type": "GeometryCollection", "geometries": [
            {"type": "LineString", "coordinates": line}, {"type": "Polygon", "coordinates": [inner]}]}}]}
    got = text_of(collection, kind_field="what")
    expect([r for r in got if r.startswith("feature")] == ["feature 1 lake", "feature 2 hard", "feature 3 hard"], str(got))
    expect([r for r in got if r in ("line", "ring")] == ["ring", "line", "line", "line", "ring"], str(got))

    class Crs:
        def to_wkt(self):
            return 'PROJCS["a",\n  UNIT["metre",1]]'
    expect(text_of(line, crs=Crs(), densify=2)[1:3] == ['crs PROJCS["a", UNIT["metre",1]]', "densify 2"], "a system that has a WKT")
    expect(text_of(line, units="us-survey-foot")[1:3] == ["unit ftUS", "unit-z ftUS"] and text_of(line, units="ft,m")[1:3] == ["unit ft", "unit-z m"] and
           text_of(line, crs="EPSG:2154", units="metre")[1:3] == ["crs EPSG:2154", "unit-z m"], "units")
    made = acut.Lines([line, line], name="roads")
    expect((made.features, made.vertices, made.name) == (2, 4, "roads") and "roads" in repr(made), repr(made))


def refusals():
    line = [(0, 0, 1), (5, 0, 1)]
    for what, options, says in (
            ([(0, 0), (1, 1)], {}, "feature 1: vertex 1 has no z"), ([line, [(0, 0, float("nan")), (1, 1, 1)]], {}, "feature 2: nan is no coordinate"),
            (Shape("Point", (0, 0, 0)), {}, "a Point is no line"), (line[:1], {}, "a line of 1 vertices"), ([], {}, "no lines"),
            (line, {"kind": "road"}, "no kind of lines"), (line, {"kind": "lake"}, "a ring of 2 vertices"), ("roads.shp", {}, "features or vertices"),
            (Shape("LineString", line), {"kind": "lake"}, "does not end where it begins"), (line, {"units": "yards"}, "units are"), (line, {"densify": "far"}, "a length"),
            (line, {"lake_level": "low"}, "min, max or mean"), (None, {}, "features or vertices"),
            ({"type": "Feature", "geometry": None}, {}, "feature 1: it has no geometry")):
        e = raises(acut.UsageError, lambda: acut.Lines(what, **options))
        expect(says in str(e), "%r: %s" % (what, e))


def pushes():
    """The same mesh as of acutctl with the same lines as files; marked edges; the set, its places, and lines that are replaced."""
    with Folder() as base, Daemon(base, **SMALL) as d, acut.connect(d.socket) as c:
        cloud = synth(os.path.join(base, "a.las"), 200000, 1, "--origin", "500000,5400000")
        box = c.info(cloud)
        x, y = box.min[0] + 10, box.min[1] + 10
        roads = [[(x, y, 300.0), (x + 40, y + 41.5, 301.0)], [(x, y + 30, 310.0), (x + 50, y + 5, 310.0)]]
        lake = [(x + 20, y + 50, 299.5), (x + 45, y + 50, 299.5), (x + 40, y + 70, 299.5)]
        files = {}
        for kind, rings in (("hard", roads), ("lake", [lake + lake[:1]])):
            files[kind] = os.path.join(base, kind + ".csv")
            with open(files[kind], "w") as f:
                f.write("x,y,z,name\n" + "".join("%r,%r,%r,%d\n" % (*v, i) for i, r in enumerate(rings) for v in r))
        system = {"crs": box.crs, "units": box.unit_z}
        e = raises(acut.InputError, c.push, "s", [cloud, acut.Lines(roads)])
        expect("that of lines" in str(e), str(e))
        e = raises(acut.InputError, c.push, "s", [cloud, acut.Lines(roads, crs=box.crs)])
        expect("--assume-units ,m which is of z alone" in str(e), str(e))
        pushed = c.push("s", [cloud, acut.Lines(roads, name="roads", **system), acut.Lines(lake, kind="lake", name="lakes", **system)])
        s = pushed.line_set
        expect(s is not None and (s.features, s.lines, s.vertices, s.crossings, s.pieces) == ((2, 1, 0, 0), 3, 7, 1, 7), str(pushed))
        expect([f.name for f in pushed.files][1:] == ["roads", "lakes"], str(pushed.files))
        places = c.line_places("s")
        expect(len(places) == 1 and places[0].kind == "crossing" and places[0].upper > places[0].lower, str(places))
        job = c.wait(c.submit("s"))
        d.ctl("push", "t", cloud).ok()
        for kind, file in files.items():
            d.ctl("push", "t", file, "--lines-as", kind, "--assume-crs", box.crs, "--assume-units", "m,m").ok()
        r = d.ctl("submit", "t", "--wait", "--json").ok().json()
        mesh = c.mesh(job)
        expect((mesh.digest, mesh.vertex_digest) == (r["digest"], r["vertex_digest"]), "another mesh than with files")
        expect(mesh.head.lines and not mesh.head.bounded and len(mesh.flags) == len(mesh.triangles), "flags of %r" % mesh)
        edges = set()
        for t, flags in zip(mesh.triangles.tolist(), mesh.flags):
            edges.update(frozenset((t[(k + 1) % 3], t[(k + 2) % 3])) for k in range(3) if flags >> k & 1)
        expect(len(edges) == s.pieces, "%d marked edges of %d pieces" % (len(edges), s.pieces))
        with c.fetch(job) as blocks:
            expect(sum(b.flags is None for b in blocks) > 0, "all blocks have flags, so their order is not tested")
        # Again, and in place of each other.
        expect(c.push("s", acut.Lines(roads, name="roads", **system)).files[0].state == "known", "the same lines")
        e = raises(acut.Error, c.push, "s", acut.Lines([roads[0], roads[0]], name="roads", **system))
        expect("replace" in str(e), str(e))
        pushed = c.push("s", acut.Lines(roads[:1], name="roads", **system), replace=True)
        expect(pushed.files[0].replaced == 1 and pushed.line_set.features == (1, 1, 0, 0), str(pushed))
        expect(c.line_places("s") == [] and len(earlier_places(c, "s", 1)) == 1, "places by generation")
        e = raises(acut.InputError, c.push, "s", acut.Lines([(x, y, 1), (x + 1, y + 1, 2), (x + 1, y, 1)], kind="lake", name="pond", **system))
        expect("lake" in str(e) and "feature 1" in str(e), str(e))
        hole = c.push("u", [cloud, acut.Lines(lake, kind="hole", name="h", **system)])
        expect(hole.line_set.features == (0, 0, 0, 1) and c.mesh(c.submit("u")).head.bounded, str(hole))


def earlier_places(c, name, at):
    """Only the newest generation keeps its line set; a mesh of an earlier one makes it again, until it is removed once more."""
    def ask():
        try:
            return c.line_places(name, at=at)
        except acut.NotFoundError:
            c.wait(c.submit(name, at=at))
            return None
    return until(ask, "no places of generation %d" % at)


def nothing_is_left():
    def count():
        gc.collect()
        return len(os.listdir("/proc/self/fd"))

    before = count()
    kept = [acut.Lines([(0, 0, 1), (5, 0, 1)]) for _ in range(5)]
    for _ in range(5):
        try:
            acut.Lines([(0, 0)])
        except acut.UsageError:
            pass
    expect(count() == before + 5, "descriptors of lines that were refused")
    kept.clear()
    expect(count() == before and not lost, "descriptors or exceptions are left: %s" % lost)


if __name__ == "__main__":
    e2e.main(texts, refusals, pushes, nothing_is_left)
