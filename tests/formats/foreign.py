"""Formats for other programs, read by these: foreign.py READER. What GDAL, assimp, the validator of Khronos and an XML parser find in
a file is compared with the PLY of the same mesh: every triangle, every coordinate."""
import csv
import io
import json
import os
import re
import shutil
import struct
import subprocess
import sys
import xml.etree.ElementTree as tree
from collections import Counter

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import crs  # noqa: E402
import e2e  # noqa: E402
import geo  # noqa: E402
from e2e import Daemon, Folder, expect  # noqa: E402


def needs(program, package):
    if not shutil.which(program):
        e2e.unavailable("%s is not installed (%s)" % (program, package))


def read_ply(path):
    """(vertices, faces) of our PLY."""
    with open(path, "rb") as f:
        data = f.read()
    end = data.index(b"end_header\n") + 11
    head = data[:end].decode()
    nv, nf = (int(re.search(r"element %s (\d+)" % what, head)[1]) for what in ("vertex", "face"))
    middle = end + 24 * nv
    expect(len(data) == middle + 13 * nf, "%s has %d bytes" % (path, len(data)))
    return list(struct.iter_unpack("<3d", data[end:middle])), [f[1:] for f in struct.iter_unpack("<B3i", data[middle:])]


def turned(triangle):
    """From its least corner on: the direction stays."""
    low = triangle.index(min(triangle))
    return triangle[low:] + triangle[:low]


def read_stl(path):
    """(vertices, faces) of a binary STL of assimp."""
    with open(path, "rb") as f:
        data = f.read()
    vertices = [v for t in struct.iter_unpack("<12fH", data[84:]) for v in (t[3:6], t[6:9], t[9:12])]
    return vertices, [(i, i + 1, i + 2) for i in range(0, len(vertices), 3)]


def triangles(mesh, change=lambda v: v):
    vertices = [change(v) for v in mesh[0]]
    return Counter(turned(tuple(vertices[i] for i in face)) for face in mesh[1])


def same(got, want, what):
    expect(sum(got.values()) == sum(want.values()), "%s: %d triangles, not %d" % (what, sum(got.values()), sum(want.values())))
    expect(got == want, "%s: %d triangles differ, as %s" % (what, sum((got - want).values()), list((got - want).items())[:1]))


class World:
    """A daemon with the mesh of a survey of 60,000 points, about 119,000 triangles: more than what fits a buffer."""

    def __enter__(self):
        self.folder = Folder()
        self.base = self.folder.__enter__()
        self.daemon = Daemon(self.base, memory="64M").start()
        survey = self.path("survey.las")
        e2e.run([e2e.SYNTH, "--points", "60000", survey]).ok()
        self.daemon.ctl("push", "s", survey).ok()
        self.daemon.ctl("submit", "s", "--wait").ok()
        return self

    def __exit__(self, *exc):
        self.daemon.__exit__(*exc)
        self.folder.__exit__(*exc)

    def path(self, name):
        return os.path.join(self.base, name)

    def fetch(self, name, *options):
        self.daemon.ctl("fetch", "1", "-o", self.path(name), *options).ok()
        return self.path(name)


# ---- GDAL ----


def gdal_triangles(path):
    """All rings of all features, as GDAL writes them."""
    text = e2e.run(["ogr2ogr", "-f", "CSV", "/vsistdout/", "-lco", "GEOMETRY=AS_WKT", path]).ok().out
    csv.field_size_limit(1 << 30)
    rows = list(csv.DictReader(io.StringIO(text)))
    rings = Counter()
    for row in rows:
        expect(row["Layer"] == "TIN", "a feature on layer " + row["Layer"])
        for ring in re.findall(r"\(([^()]+)\)", row["WKT"]):
            points = [tuple(float(n) for n in p.split()) for p in ring.split(",")]
            expect(len(points) == 4 and points[0] == points[3], "a ring of %s" % points)
            rings[turned(tuple(points[:3]))] += 1
    return rows, rings


def gdal_reads_dxf():
    with World() as w:
        mesh = read_ply(w.fetch("m.ply"))
        want = triangles(mesh)
        used = {i for face in mesh[1] for i in face}
        low, high = ([f(mesh[0][i][j] for i in used) for j in range(3)] for f in (min, max))
        for name, options in (("faces.dxf", []), ("sorted.dxf", ["--canonical"]), ("poly.dxf", ["--polyface"]),
                              ("sorted-poly.dxf", ["--polyface", "--canonical"])):
            path = w.fetch(name, *options)
            rows, got = gdal_triangles(path)
            same(got, want, name)
            if "--polyface" in options:
                expect(1 < len(rows) < 20 and all(r["WKT"].startswith("POLYHEDRALSURFACE Z") for r in rows), "%d meshes" % len(rows))
            said = e2e.run(["ogrinfo", "-so", "-al", path]).ok().out
            expect("Feature Count: %d" % len(rows) in said, said)
            extent = [float(n) for n in re.search(r"Extent: \((\S+), (\S+)\) - \((\S+), (\S+)\)", said).groups()]
            expect(extent == low[:2] + high[:2], "the extent is %s, not %s, %s" % (extent, low, high))
            with open(path) as f:
                head = f.read(4000)
            for mark, box in (("$EXTMIN", low), ("$EXTMAX", high)):
                numbers = head.split(mark + "\n")[1].split("\n")[:6]
                expect([float(n) for n in numbers[1::2]] == box, "%s: %s, not %s" % (mark, numbers, box))


LAMBERT = ('PROJCS["%s",GEOGCS["RGF93",DATUM["Reseau_Geodesique_Francais_1993",SPHEROID["GRS 1980",6378137,298.257222101]],'
           'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Lambert_Conformal_Conic_2SP"],'
           'PARAMETER["latitude_of_origin",%s],PARAMETER["central_meridian",3],PARAMETER["standard_parallel_1",49],'
           'PARAMETER["standard_parallel_2",44],PARAMETER["false_easting",700000],PARAMETER["false_northing",6600000],'
           'UNIT["metre",1]%s]')
NGF = 'VERT_CS["NGF-IGN69 height",VERT_DATUM["NGF-IGN69",2005],UNIT["metre",1]%s]'


def gdal_reads_systems():
    """From the records of a file, through the daemon, to what GDAL says of the raster."""
    code = lambda n: ',AUTHORITY["EPSG","%d"]' % n
    known, site = LAMBERT % ("RGF93 / Lambert-93", "46.5", code(2154)), LAMBERT % ("quarry", "46.6", "")
    keys = [(1024, 0, 1, 1), (3072, 0, 1, 2154), (4096, 0, 1, 5720), (4099, 0, 1, 9001)]
    both = ["COMPOUNDCRS[", 'ID["EPSG",2154]', "NGF-IGN69", 'ID["EPSG",5720]']
    with Folder() as base, Daemon(base) as d:
        d.ctl("geoid", "add", geo.pgm(base + "/flat.pgm")).ok()
        for i, (records, push, fetch, parts, not_parts) in enumerate((
                (dict(wkt=crs.compound(known, NGF % code(5720))), [], [], both, []),
                (dict(keys=keys), [], [], both, []),
                (dict(wkt=known), ["--assume-units", ",m"], [], ['ID["EPSG",2154]'], ["COMPOUNDCRS", "VERTCRS"]),
                (dict(wkt=crs.compound(known, NGF % code(5720))), [], ["--raster", "slope"], ['ID["EPSG",2154]'], ["COMPOUNDCRS"]),
                (dict(wkt=crs.compound(known, NGF % code(5720))), [], ["--z-unit", "ft"], ['ID["EPSG",2154]'], ["5720"]),
                (dict(wkt=crs.compound(known, NGF % "")), [], [], ["COMPOUNDCRS", 'ID["EPSG",2154]', 'VERTCRS["NGF-IGN69 height"'], ["5720"]),
                (dict(wkt=known), ["--assume-units", ",m", "--geoid", "flat"], [],
                 ["COMPOUNDCRS", 'ID["EPSG",2154]', 'VERTCRS["orthometric height (flat)"'], []),
                (dict(wkt=known), ["--assume-units", ",m", "--geoid", "flat", "--geoid-way", "ellipsoidal"], [],
                 ['ID["EPSG",2154]', "ellipsoidal height (flat)"], ["5720", "5030"]),
                (dict(wkt=site), [], [], ['PROJCRS["quarry"', '"Latitude of false origin",46.6'], ["COMPOUNDCRS"]),
                (dict(wkt=crs.compound(site, NGF % code(5720))), [], [],
                 ["COMPOUNDCRS", 'PROJCRS["quarry"', '"Latitude of false origin",46.6', 'ID["EPSG",5720]'], []),
                (dict(wkt=crs.compound(site, NGF % code(5720))), [], ["--raster", "slope"], ['["quarry'], ["5720]]"]))):
            name = "%d" % i
            d.ctl("push", name, crs.las(base + "/%s.las" % name, x0=700000, **records), *push).ok()
            job = d.ctl("submit", name, "--wait", "--json").ok().json()["job"]
            out = base + "/%s.tif" % name
            d.ctl("fetch", str(job), "-o", out, "--cell", "5", *fetch).ok()
            info = json.loads(e2e.run(["gdalinfo", "-json", out]).ok().out)
            said = info["coordinateSystem"]["wkt"]
            for part in parts:
                expect(part in said, "%s: no %s in %s" % (name, part, said))
            for part in not_parts:
                expect(part not in said, "%s: %s in %s" % (name, part, said))


def gdal_reads_systems_of_contours():
    quarry = LAMBERT % ("quarry", "46.6", "")
    both = crs.compound(quarry, NGF % ',AUTHORITY["EPSG","5720"]')
    long = LAMBERT % ("quarry", "46.6", ',EXTENSION["PROJ4","%s"]' % ("x" * 4000))
    with Folder() as base, Daemon(base) as d:
        for i, (wkt, options, parts, not_parts) in enumerate((
                (LAMBERT % ("RGF93 / Lambert-93", "46.5", ',AUTHORITY["EPSG","2154"]'), [], ['ID["EPSG",2154]'], []),
                (quarry, [], ['PROJCRS["quarry"', '"Latitude of false origin",46.6'], ["COMPOUNDCRS"]),
                (both, [], ["COMPOUNDCRS", 'PROJCRS["quarry"', 'ID["EPSG",5720]'], []),
                (both, ["--z-unit", "m"], ["COMPOUNDCRS"], []),
                (both, ["--z-unit", "ft"], ["Undefined Cartesian SRS"], ["quarry"]),
                (long, [], ["Undefined Cartesian SRS"], ["quarry"]))):
            las, out = crs.las(base + "/%d.las" % i, wkt, x0=700000), base + "/%d.gpkg" % i
            d.ctl("mesh", las, "-o", out, "--interval", "0.1", *options).ok()
            said = e2e.run(["ogrinfo", "-so", "-al", out]).ok().out
            said = said[said.index("Layer SRS WKT"):]
            for part in parts:
                expect(part in said, "%d: no %s in %s" % (i, part, said))
            for part in not_parts:
                expect(part not in said, "%d: %s in %s" % (i, part, said))


# ---- assimp ----


def floats(values):
    """Rounded to 32-bit floats; no -0."""
    return tuple(struct.unpack("<f", struct.pack("<f", v))[0] + 0.0 for v in values)


def assimp_reads_floats():
    with World() as w:
        mesh = read_ply(w.fetch("m.ply", "--origin", "auto"))
        up, steps = lambda v: (v[0], v[2], -v[1]), lambda v: tuple(round(100 * x) for x in v)
        plain = lambda v: v
        for name, change, options in (("m.glb", up, []), ("sorted.glb", up, ["--canonical"]), ("m.stl", plain, []), ("sorted.stl", plain, ["--canonical"]),
                                      ("m.dxf", up, []), ("poly.dxf", up, ["--polyface"])):
            path = w.fetch(name, "--origin", "auto", *options)
            out = w.path("read.stl")
            e2e.run(["assimp", "export", path, out, "-fstlb"]).ok()
            # Its numbers from texts are not always the nearest.
            rounded = steps if name.endswith(".dxf") else floats
            same(triangles(read_stl(out), rounded), triangles(mesh, lambda v: rounded(change(v))), name)
            said = e2e.run(["assimp", "info", path]).ok().out
            expect(re.search(r"^Faces: +%d$" % len(mesh[1]), said, re.M), said)
            if name.endswith(".glb"):
                expect(re.search(r"^Vertices: +%d$" % len(mesh[0]), said, re.M), said)


def far_coordinates_are_refused():
    with World() as w:
        for name in ("m.glb", "m.stl"):
            r = w.daemon.ctl("fetch", "1", "-o", w.path(name))
            expect(r.status == 2 and "32-bit floats" in r.err and "--origin auto" in r.err, r.err)
            expect(not os.path.exists(w.path(name)), name + " is there")


# ---- the validator of glTF ----

VALIDATE = """
const validator = require("gltf-validator"), fs = require("fs");
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1]))).then(r => console.log(JSON.stringify(r)));
"""


def validator_finds_nothing():
    with World() as w:
        mesh = read_ply(w.fetch("m.ply"))
        for name, options in (("m.glb", []), ("sorted.glb", ["--canonical"]), ("empty.glb", ["--max-edge", "0.001"])):
            path = w.fetch(name, "--origin", "auto", *options)
            said = json.loads(e2e.run(["node", "-e", VALIDATE, path]).ok().out)
            expect(said["issues"]["messages"] == [], said["issues"])
            faces = 0 if name == "empty.glb" else len(mesh[1])
            info = said["info"]
            expect((info["totalVertexCount"], info["totalTriangleCount"]) == (len(mesh[0]), faces), info)


# ---- LandXML: the part of the schema that a surface needs ----

NAMESPACE = "{http://www.landxml.org/schema/LandXML-1.2}"
# Element: its children in their order, and its attributes with what they must match ("?": may be missing).
METRIC = {"areaUnit": "squareMeter", "linearUnit": "meter", "volumeUnit": "cubicMeter", "temperatureUnit": "celsius", "pressureUnit": "milliBars"}
IMPERIAL = {"areaUnit": "squareFoot", "linearUnit": "foot|USSurveyFoot", "volumeUnit": "cubicYard", "temperatureUnit": "fahrenheit",
            "pressureUnit": "inHG"}
SCHEMA = {
    "LandXML": ("Units CoordinateSystem? Project Application Surfaces", {
        "date": r"\d{4}-\d\d-\d\d", "time": r"\d\d:\d\d:\d\d", "version": r"1\.2", "language": "English", "readOnly": "false",
        "{http://www.w3.org/2001/XMLSchema-instance}schemaLocation": r"\S+ \S+"}),
    "Units": ("(Metric|Imperial)", {}),
    "Metric": ("", METRIC),
    "Imperial": ("", IMPERIAL),
    "CoordinateSystem": ("", {"desc": ".+", "epsgCode?": r"\d{4,6}", "ogcWktCode?": ".+", "verticalDatum?": ".+"}),
    "Project": ("Feature*", {"name": ".+"}),
    "Application": ("", {"name": "acut"}),
    "Surfaces": ("Surface", {}),
    "Surface": ("Definition Feature*", {"name": ".+"}),
    "Definition": ("Pnts Faces", {"surfType": "TIN"}),
    "Pnts": ("P+", {}),
    "P": ("", {"id": "[1-9][0-9]*"}),
    "Faces": ("F+", {}),
    "F": ("", {}),
    "Feature": ("Property*", {"code": "acut"}),
    "Property": ("", {"label": "acut-[a-z-]+", "value": ".*"}),
}


def check_schema(node):
    name = node.tag.replace(NAMESPACE, "")
    expect(name in SCHEMA and node.tag.startswith(NAMESPACE), "an element " + node.tag)
    children, attributes = SCHEMA[name]
    pattern = re.sub(r"(\w+)", r"(?:<\1>)", children).replace(" ", "")
    found = "".join("<%s>" % c.tag.replace(NAMESPACE, "") for c in node)
    expect(re.fullmatch(pattern, found), "%s has %s" % (name, found[:200]))
    known = {a.rstrip("?") for a in attributes}
    expect(set(node.attrib) <= known, "%s has attributes %s" % (name, sorted(set(node.attrib) - known)))
    for a, value in attributes.items():
        text = node.get(a.rstrip("?"))
        expect(text is None and a.endswith("?") or text is not None and re.fullmatch(value, text), "%s: %s is %s" % (name, a, text))
    if name not in ("P", "F"):
        expect(not (node.text or "").strip(), "%s has a text" % name)
    for child in node:
        check_schema(child)


def landxml_is_the_mesh():
    with World() as w:
        for name, options in (("site <1> & \"2\".xml", []), ("sorted.landxml", ["--canonical"]), ("moved.xml", ["--origin", "500000,5400000,0.005"])):
            vertices, faces = read_ply(w.fetch("m.ply", *options))
            root = tree.parse(w.fetch(name, *options)).getroot()
            check_schema(root)
            find = lambda path: root.find("/".join(NAMESPACE + p for p in path.split("/")))
            expect(find("Surfaces/Surface").get("name") == name.rsplit(".", 1)[0], find("Surfaces/Surface").get("name"))
            expect(find("CoordinateSystem").get("epsgCode") == (None if name == "moved.xml" else "32633"), "the code")
            expect(find("Units/Metric") is not None, "the units")
            points = {}
            for p in find("Surfaces/Surface/Definition/Pnts"):
                n, e, h = p.text.split()
                points[int(p.get("id"))] = (float(e), float(n), float(h))
            expect(points == dict(enumerate(vertices, 1)), "points differ")
            got = [tuple(int(i) - 1 for i in f.text.split()) for f in find("Surfaces/Surface/Definition/Faces")]
            expect(Counter(map(turned, got)) == Counter(map(turned, faces)), "faces differ")
            if "--canonical" in options:
                expect(got == list(faces), "their order differs")


def units_are_named_or_refused():
    with World() as w:
        survey = w.path("feet.las")
        e2e.run([e2e.SYNTH, "--points", "300", "--no-crs", survey]).ok()
        out = w.path("feet.xml")
        for units, z_unit, want in (("ft,ft", None, "foot"), ("ftUS,ftUS", None, "USSurveyFoot"), ("ftUS,m", "ftUS", "USSurveyFoot"), ("m,m", None, "meter"),
                                    (None, None, "--assume-units m"), ("ft,m", None, "--z-unit ft")):
            options = (["--assume-units", units] if units else []) + (["--z-unit", z_unit] if z_unit else [])
            r = w.daemon.ctl("mesh", survey, "-o", out, *options)
            if want.startswith("--"):
                expect(r.status == 2 and "LandXML" in r.err and want in r.err, r.err)
                expect(not os.path.exists(out), "it is there")
                continue
            root = tree.parse(r.ok() and out).getroot()
            check_schema(root)
            expect(root[0][0].get("linearUnit") == want, "%s: %s" % (units, root[0][0].attrib))
            os.unlink(out)


def main():
    reader = sys.argv[1]
    if reader == "gdal":
        needs("ogr2ogr", "gdal-bin")
        needs("gdalinfo", "gdal-bin")
        e2e.main(gdal_reads_dxf, gdal_reads_systems, gdal_reads_systems_of_contours)
    if reader == "assimp":
        needs("assimp", "assimp-utils")
        e2e.main(assimp_reads_floats, far_coordinates_are_refused)
    if reader == "gltf":
        # No package of Debian: ./check installs it where there is npm.
        if not shutil.which("node") or subprocess.run(["node", "-e", 'require("gltf-validator")'], stderr=subprocess.DEVNULL, check=False).returncode:
            e2e.skip("gltf-validator is not installed (npm, NODE_PATH)")
        e2e.main(validator_finds_nothing)
    if reader == "landxml":
        e2e.main(landxml_is_the_mesh, units_are_named_or_refused)


if __name__ == "__main__":
    main()
