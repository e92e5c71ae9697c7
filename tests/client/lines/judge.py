"""ogr2ogr judges the readers of files of lines: one set of lines, written here and converted by it into the other formats, has the
same vertices in each; and of real files it finds the same vertices. Also how much memory acutctl info takes."""
import json
import os
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "e2e"))
import e2e  # noqa: E402
from e2e import ACUTCTL, Folder, expect  # noqa: E402

DUMP = sys.argv[1]

# Kind and vertices. All coordinates have few decimals, so that no format rounds them.
OPEN = [
    ("hard", [(500000.25, 5400000.5, 410.125), (500010.5, 5400003.75, 411.25), (500020.75, 5400001, 409.5)]),
    ("soft", [(500100, 5400100, 1.5), (500100.001, 5400100.002, -2.25)]),
    ("lake", [(500200, 5400200, 7), (500210, 5400200, 7), (500210, 5400210, 7), (500200, 5400200, 7)]),
]
RINGS = [
    ("lake", [[(500000, 5400000, 3.5), (500000, 5400090.5, 3.5), (500090, 5400090, 3.5), (500090, 5400000, 3.5)],
              [(500010, 5400010, 3.5), (500020, 5400010, 3.5), (500020, 5400020, 3.5)]]),
    ("hole", [[(500300, 5400300, 1), (500310, 5400320, 2), (500320, 5400300, 3)]]),
]


def geojson(path, features, crs="urn:ogc:def:crs:EPSG::25832"):
    with open(path, "w") as f:
        json.dump({"type": "FeatureCollection", "crs": {"type": "name", "properties": {"name": crs}}, "features": [
            {"type": "Feature", "properties": {"sort": kind, "Layer": kind}, "geometry": {"type": name, "coordinates": c}}
            for name, kind, c in features]}, f)
    return path


def lines():
    return [("LineString", kind, [list(v) for v in c]) for kind, c in OPEN]


def rings():
    return [("Polygon", kind, [[list(v) for v in r + r[:1]] for r in c]) for kind, c in RINGS]


def ring_key(ring):
    """The same for all beginnings and both directions."""
    turns = [ring[i:] + ring[:i] for i in range(len(ring))]
    return min(turns + [[t[0]] + t[:0:-1] for t in turns])


def dump(path, *options):
    """All features: (layer, kind, [("open", vertices) or ("ring", vertices)])."""
    out = []
    for line in e2e.run([DUMP, path, *options]).ok().out.splitlines():
        words = line.split("\t")
        if words[0] in ("open", "ring"):
            vertices = [tuple(map(float, w.split())) for w in words[1:]]
            out[-1][2].append((words[0], ring_key(vertices) if words[0] == "ring" else vertices))
        else:
            expect(words[3] == "usable", "%s: %s" % (path, line))
            out.append((words[0], words[2], []))
    return out


def want_lines():
    return [(kind, [("open", [tuple(map(float, v)) for v in c])]) for kind, c in OPEN]


def want_rings():
    return [(kind, [("ring", ring_key([tuple(map(float, v)) for v in r])) for r in c]) for kind, c in RINGS]


def convert(to, source, *options):
    e2e.run(["ogr2ogr", *options, to, source]).ok()
    return to


def same(path, want, *options):
    got = [(kind, parts) for _, kind, parts in dump(path, "--kind-field", "sort", *options)]
    expect(got == want, "%s: %s\nin place of %s" % (path, got, want))


def one_set_in_all_formats():
    with Folder() as base:
        a = geojson(base + "/lines.geojson", lines())
        r = geojson(base + "/rings.geojson", rings())
        same(a, want_lines())
        same(r, want_rings())
        for source, want in ((a, want_lines()), (r, want_rings())):
            stem = source[:-len(".geojson")]
            same(convert(stem + ".shp", source, "-f", "ESRI Shapefile"), want)
            same(convert(stem + ".gpkg", source, "-f", "GPKG"), want)
            same(convert(stem + "-2.geojson", stem + ".gpkg", "-f", "GeoJSON", "-lco", "COORDINATE_PRECISION=10"), want)
        convert(base + "/lines.gpkg", r, "-f", "GPKG", "-update", "-nln", "rings")
        same(base + "/lines.gpkg", want_lines() + want_rings())
        same(base + "/lines.gpkg", want_rings(), "--layer", "rings")


def a_drawing():
    with Folder() as base:
        path = convert(base + "/d.dxf", geojson(base + "/l.geojson", lines()), "-f", "DXF")
        got = [(layer, parts) for layer, _, parts in dump(path)]
        want = want_lines()
        expect(got == want, "%s\nin place of %s" % (got, want))
        expect(dump(path, "--layer", "LAKE") == [g for g in dump(path) if g[0] == "lake"], "a layer")


def a_table_of_points():
    """ogr2ogr writes points, one row each."""
    with Folder() as base:
        points = [("Point", "line %d" % i, list(v)) for i, (_, c) in enumerate(OPEN) for v in c]
        path = convert(base + "/p.csv", geojson(base + "/p.geojson", points), "-f", "CSV", "-lco", "GEOMETRY=AS_XYZ", "-sql",
                       "SELECT sort AS name FROM p")
        got = [parts for _, _, parts in dump(path, "--csv")]
        expect(got == [parts for _, parts in want_lines()], str(got))


def systems_are_found():
    with Folder() as base:
        a = geojson(base + "/l.geojson", lines())
        for to, options in (("l.shp", ["-f", "ESRI Shapefile"]), ("l.gpkg", ["-f", "GPKG"]), ("m.geojson", ["-f", "GeoJSON"])):
            said = json.loads(e2e.run([ACUTCTL, "info", "--json", convert(base + "/" + to, a, *options)]).ok().out)
            layer = said["layers"][0]
            expect(layer["epsg"] == 25832 or "UTM_Zone_32N" in layer["crs_name"], str(layer))
            expect(said["usable"] == 3 and said["lines"] == 3 and said["closed"] == 1 and said["vertices"] == 9, str(said))
            expect(said["min"] == [500000.25, 5400000.5, -2.25] and said["max"] == [500210, 5400210, 411.25], str(said))
        flat = convert(base + "/flat.shp", a, "-f", "ESRI Shapefile", "-dim", "XY")
        said = json.loads(e2e.run([ACUTCTL, "info", "--json", flat]).ok().out)
        expect(said["usable"] == 0 and not said["has_z"] and said["reasons"] == [
            {"name": "it has no z", "features": 3, "first": 1, "place": "byte", "at": 100}], str(said))


def what_people_read():
    """The report for people, the failures, and files of points beside them."""
    with Folder() as base:
        a = geojson(base + "/l.geojson", lines() + [("LineString", "soft", [[1, 2], [3, 4]]), ("Point", "x", [1, 2, 3])])
        said = e2e.run([ACUTCTL, "info", "--kind-field", "sort", a]).ok().out
        for want in ("format    GeoJSON", "features  5: 3 usable, 1 refused", "lines     3 (closed: 1), rings: 0, vertices: 9", "geometry  LineString: 4",
                     "kinds     hard: 1, soft: 2, lake: 1", "box       500000.25 5400000.5 -2.25 to 500210 5400210 411.25",
                     "z         -2.25 to 411.25", "crs       EPSG:25832, urn:ogc:def:crs:EPSG::25832 (member crs)", "refused   it has no z: 1 (the first is feature 4, at byte ",
                     "left out  points: 1"):
            expect(want in said, "%s\nis not in\n%s" % (want, said))
        bad = base + "/bad.geojson"
        with open(a) as f, open(bad, "w") as g:
            g.write(f.read()[:-20])
        r = e2e.run([ACUTCTL, "info", bad])
        expect(r.status == 1 and "bad.geojson: byte " in r.err and "hint: the file is damaged" in r.err, r.err)
        r = e2e.run([ACUTCTL, "info", bad, a])
        expect(r.status == 3 and "3 usable" in r.out, r.err)
        r = e2e.run([ACUTCTL, "info", "--layer", "none", a])
        expect(r.status == 1 and 'no layer "none"' in r.err and "its layers: l" in r.err, r.err)
        r = subprocess.run([ACUTCTL, "info", "--lines", "--input-format", "xyz", "-"], input=b"1", stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=e2e.PATIENCE)
        expect(r.returncode == 2 and b"not from pipes" in r.stderr, r.stderr.decode())
        survey = base + "/s.xyz"
        with open(survey, "w") as f:
            f.write("0 0 1\n1 0 2\n0 1 3\n")
        with e2e.Daemon(base) as d:
            both = [json.loads(line) for line in d.ctl("info", "--json", a, survey).ok().out.splitlines()]
        expect(both[0]["format"] == "geojson" and both[1]["format"] == "xyz" and both[1]["records"] == 3, str(both))


def contours_come_back():
    """The contours that acutctl writes are files of lines: the same ones in each format."""
    with Folder() as base:
        survey = base + "/s.las"
        e2e.run([e2e.SYNTH, "--points", "3000", survey]).ok()
        with e2e.Daemon(base) as d:
            d.ctl("mesh", survey, "--interval", "2", *[w for name in ("k.geojson", "k.gpkg", "k.dxf") for w in ("-o", base + "/" + name)]).ok()
        texts = [sorted(ring_key(v[:-1] if kind == "open" and v[0] == v[-1] else v) if kind == "ring" or v[0] == v[-1] else v
                        for _, _, parts in dump(base + name) for kind, v in parts) for name in ("/k.geojson", "/k.dxf")]
        expect(len(texts[0]) > 20 and texts[0] == texts[1], "%d and %d lines" % tuple(map(len, texts)))
        said = [json.loads(e2e.run([ACUTCTL, "info", "--json", base + name]).ok().out) for name in ("/k.geojson", "/k.gpkg")]
        keys = ("features", "usable", "lines", "closed", "vertices")
        expect([said[0][k] for k in keys] == [said[1][k] for k in keys], str(said))


def real_files():
    data = e2e.data_dir()
    if not data:
        print("skipped: real files (ACUT_TEST_DATA)")
        return
    folder = os.path.join(data, "lidar", "breaklines")
    for name in sorted(n for n in os.listdir(folder) if n.endswith(".shp")):
        path = os.path.join(folder, name)
        text = e2e.run(["ogr2ogr", "-f", "GeoJSON", "-lco", "COORDINATE_PRECISION=17", "/vsistdout/", path]).ok().out
        want = []
        for feature in json.loads(text)["features"]:
            c, kind = feature["geometry"]["coordinates"], feature["geometry"]["type"]
            for part in {"LineString": [c], "Polygon": c, "MultiLineString": c}.get(kind) or [r for p in c for r in p]:
                part = [tuple(map(float, v)) for v in part]
                want.append(("ring", ring_key(part[:-1])) if "Polygon" in kind else ("open", part))
        got = [part for _, _, parts in dump(path) for part in parts]
        expect(len(want) > 0 and sorted(got) == sorted(want), name)
        with Folder() as base:
            again = convert(base + "/x.gpkg", path, "-f", "GPKG", "-dim", "XYZ")
            expect(sorted(part for _, _, parts in dump(again) for part in parts) == sorted(want), name + " as GeoPackage")


def memory_is_bounded():
    """A feature of as many vertices as one may have, in each format: less than 64 MiB. This process stays small: a child inherits
    what it has at the fork."""
    with Folder() as base:
        n, path = 1 << 19, base + "/l.geojson"
        with open(path, "w") as f:
            f.write('{"type":"LineString","coordinates":[')
            f.writelines("%s[%d,%g,1.5]" % ("," if i else "", i, i / 4) for i in range(n))
            f.write("]}")
        with open(base + "/l.csv", "w") as f:
            f.write("x,y,z,name\n")
            f.writelines("%d,%g,1.5,a\n" % (i, i / 4) for i in range(n))
        files = [path, base + "/l.csv", convert(base + "/l.shp", path, "-f", "ESRI Shapefile"), convert(base + "/l.gpkg", path, "-f", "GPKG"),
                 convert(base + "/l.dxf", path, "-f", "DXF")]
        for file in files:
            child = subprocess.Popen([ACUTCTL, "info", "--json", file] + (["--lines"] if file.endswith(".csv") else []), stdout=subprocess.PIPE)
            said = json.loads(child.stdout.read())
            _, status, used = os.wait4(child.pid, 0)
            child.stdout.close()
            expect(status == 0 and said["vertices"] == n, "%s: %s" % (file, said))
            print("%s: %d MiB" % (os.path.basename(file), used.ru_maxrss // 1024))
            expect(used.ru_maxrss < 64 << 10, "%s: %d KiB" % (file, used.ru_maxrss))


if not shutil.which("ogr2ogr"):
    e2e.unavailable("ogr2ogr is not installed (gdal-bin)")
e2e.main(one_set_in_all_formats, a_drawing, a_table_of_points, systems_are_found, what_people_read, contours_come_back, real_files, memory_is_bounded)
