"""Coordinate systems and units: which combinations are accepted, assumptions, refusals and their messages, and how outputs mark
unknown ones."""
import itertools
import json
import re
import os
import struct
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import e2e
from e2e import expect
from fractions import Fraction

UTM32 = ('PROJCS["ETRS89 / UTM zone 32N",GEOGCS["ETRS89",DATUM["European_Terrestrial_Reference_System_1989",'
         'SPHEROID["GRS 1980",6378137,298.257222101]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],'
         'PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",9],'
         'PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],PARAMETER["false_northing",0],'
         'UNIT["metre",1],AUTHORITY["EPSG","25832"]]')
HEIGHT = 'VERT_CS["DHHN2016 height",VERT_DATUM["DHHN2016",2005],UNIT["metre",1],AUTHORITY["EPSG","7837"]]'
FEET = 'VERT_CS["NAVD88 height (ftUS)",VERT_DATUM["NAVD88",2005],UNIT["US survey foot",0.304800609601219],' \
       'AUTHORITY["EPSG","6360"]]'
DEGREES = ('GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],'
           'UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4326"]]')


def compound(a, b):
    return 'COMPD_CS["both",%s,%s]' % (a, b)


def las(path, wkt=None, keys=None, x0=500000, z0=100):
    """Nine points on a grid of 10, LAS 1.4, format 6 with WKT, 1.2 format 0 with GeoTIFF keys."""
    records = b""
    n = 0
    if wkt:
        text = wkt.encode() + b"\0"
        records = struct.pack("<H16sHH32s", 0, b"LASF_Projection", 2112, len(text), b"") + text
        n = 1
    if keys:
        body = struct.pack("<%dH" % (4 + 4 * len(keys)), 1, 1, 0, len(keys), *itertools.chain(*keys))
        records = struct.pack("<H16sHH32s", 0, b"LASF_Projection", 34735, len(body), b"") + body
        n = 1
    points = b""
    for i in range(9):
        x, y, z = x0 * 100 + i % 3 * 1000, 500000000 + i // 3 * 1000, z0 * 100 + i * 10 + (i == 4)
        points += struct.pack("<iiiHBBbBH", x, y, z, 0, 0x09, 2, 0, 0, 0)
    box = [x0 + 20, x0, 5000020, 5000000, z0 + .81, z0]
    head = struct.pack("<4sHH16sBB32s32sHHHIIBHI5I3d3d6d", b"LASF", 0, 0x10 if wkt else 0, b"", 1, 2, b"", b"", 1, 2026, 227,
                       227 + len(records), n, 0, 20, 9, 9, 0, 0, 0, 0, .01, .01, .01, 0, 0, 0, *box)
    with open(path, "wb") as f:
        f.write(head + records + points)
    return path


def xyz(path, x0=500000):
    with open(path, "w") as f:
        for i in range(9):
            f.write("%.2f %.2f %.2f\n" % (x0 + 100 + i % 3 * 10, 5000000 + i // 3 * 10, 100 + i / 10))
    return path


def said(r, *parts):
    for p in parts:
        expect(p in r.err, "%r is not in what %s said:\n%s" % (p, " ".join(r.args), r.err))


def files(base):
    f = {
        "utm": las(base + "/utm.las", UTM32),
        "utm2": las(base + "/utm2.las", UTM32, x0=500200),
        "height": las(base + "/height.las", compound(UTM32, HEIGHT), x0=500400),
        "feet": las(base + "/feet.las", compound(UTM32, FEET), x0=500600),
        "n32": las(base + "/n32.las", keys=[(1024, 0, 1, 1), (3072, 0, 1, 32632)], x0=500800),
        "ftus": las(base + "/ftus.las", keys=[(1024, 0, 1, 1), (3072, 0, 1, 25832), (3076, 0, 1, 9003)], x0=501000),
        "none": las(base + "/none.las", x0=501200),
        "text": xyz(base + "/text.xyz", 501400),
        "lonlat": las(base + "/lonlat.las", DEGREES, x0=8),
        # one name, two definitions
        "site1": las(base + "/site1.las", UTM32.replace("ETRS89 / UTM zone 32N", "site").replace(
            ',AUTHORITY["EPSG","25832"]', "").replace('"scale_factor",0.9996', '"scale_factor",1'), x0=501600),
        "site2": las(base + "/site2.las", UTM32.replace("ETRS89 / UTM zone 32N", "site").replace(
            ',AUTHORITY["EPSG","25832"]', "").replace('"scale_factor",0.9996', '"scale_factor",0.99999'), x0=501800),
    }
    return f


MIXED = [
    # a set, what its refusal says
    (["utm", "n32"], ["its coordinate system is", "EPSG:25832", "EPSG:32632", "utm.las", "n32.las", "two datasets"]),
    (["utm", "none"], ["its coordinate system is", "EPSG:25832", "unknown", "utm.las", "none.las", "--assume-crs"]),
    (["utm", "text"], ["EPSG:25832", "unknown", "text.xyz", "--assume-crs"]),
    (["utm", "height"], ["EPSG:25832 + EPSG:7837", "utm.las", "height.las"]),
    (["height", "feet"], ["EPSG:7837", "EPSG:6360", "height.las", "feet.las"]),
    (["utm", "ftus"], ["the unit of its x and y is", "metre", "us-survey-foot", "utm.las", "ftus.las"]),
    (["site1", "site2"], ["the definition of its coordinate system", "site1.las", "site2.las", "one name"]),
    (["none", "text", "utm"], ["unknown", "EPSG:25832"]),
    (["utm", "utm2", "n32"], ["EPSG:32632"]),
]


def mixing():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        f = files(base)
        for names, parts in MIXED:
            errors = set()
            for order in itertools.permutations(names):
                r = d.ctl("mesh", *[f[n] for n in order], "-o", base + "/m.ply")
                expect(r.status == 1, "%s: %d\n%s" % (order, r.status, r.err))
                said(r, *parts)
                expect(not os.path.exists(base + "/m.ply"), "an output of a refused set")
                errors.add(r.err)
            if len(names) == 2:
                expect(len(errors) == 1, "the order changes the words: %s" % errors)
        for one in (["utm", "utm2"], ["none", "text"], ["height"]):
            d.ctl("mesh", *[f[n] for n in one], "-o", base + "/m.ply").ok()


def across_pushes():
    """A second push with another system is refused, whichever was first; the dataset is unchanged."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        f = files(base)
        pairs = [(a, b) for names, _ in MIXED for a, b in itertools.permutations(names[:2]) if "site1" not in names]
        for i, (a, b) in enumerate(pairs):
            name = "d%d" % i
            first = d.ctl("push", name, f[a])
            expect(first.status == 0, first.err)
            if {a, b} == {"none", "text"} or {a, b} == {"utm", "utm2"}:
                d.ctl("push", name, f[b]).ok()
                continue
            r = d.ctl("push", name, f[b])
            expect(r.status == 1, "%s then %s: %d\n%s" % (a, b, r.status, r.err))
            said(r, "the dataset " + name, os.path.basename(f[b]))
            expect(d.ctl("dataset", "show", name, "--json").json()["points"] == 9, "what is there changed")


def unknown():
    """Accepted, with one warning; null in JSON and `unknown` in the outputs."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        f = files(base)
        r = d.ctl("mesh", f["none"], f["text"], "-o", base + "/m.ply", "-o", base + "/m.obj", "--json").ok()
        j = r.json()
        expect(j["crs"] is None and j["units"] == {"xy": None, "z": None}, str(j))
        warned = [w for w in j["warnings"] if "unknown" in w]
        expect(len(warned) == 1, str(j["warnings"]))
        expect("the coordinate system, the unit of x and y and the unit of z are unknown" in warned[0], warned[0])
        expect(r.err.count("unknown") <= 1, r.err)
        head = open(base + "/m.ply", "rb").read(2000).decode(errors="replace")
        expect("acut-geoid" not in head and "comment acut-crs unknown\n" in head and "comment acut-units unknown unknown\n" in head, head)
        head = open(base + "/m.obj").read(2000)
        expect("# acut-crs unknown\n" in head and "# acut-units unknown unknown\n" in head, head)
        # If the plane is known, only the heights.
        j = d.ctl("mesh", f["utm"], "-o", base + "/m.ply", "--json").ok().json()
        expect(j["crs"] == "EPSG:25832" and j["units"] == {"xy": "metre", "z": None}, str(j))
        expect(any(w.startswith("the unit of z is unknown") for w in j["warnings"]), str(j["warnings"]))
        j = d.ctl("mesh", f["height"], "-o", base + "/m.ply", "--json").ok().json()
        expect(j["units"] == {"xy": "metre", "z": "metre"} and not [w for w in j["warnings"] if "unknown" in w], str(j))


def assumed():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        f = files(base)
        out = base + "/m.ply"

        def units(*words):
            j = d.ctl("mesh", *words, "-o", out, "--json").ok().json()
            return j["crs"], j["units"]["xy"], j["units"]["z"]

        expect(units(f["none"], f["text"], "--assume-crs", "EPSG:25832") == ("EPSG:25832", "metre", None), "crs")
        expect(units(f["utm"], f["text"], "--assume-crs", "epsg:25832") == ("EPSG:25832", "metre", None), "crs beside")
        # An equal assumption does no harm; a name that EPSG has is its number.
        expect(units(f["utm"], f["none"], "--assume-crs", "ETRS89 / UTM zone 32N")[0] == "EPSG:25832", "name")
        expect(units(f["height"], f["text"], "--assume-crs", "EPSG:25832 + EPSG:7837") ==
               ("EPSG:25832 + EPSG:7837", "metre", "metre"), "compound")
        expect(units(f["utm"], f["height"], "--assume-crs", "EPSG:25832 + EPSG:7837")[2] == "metre", "heights only")
        with open(base + "/crs.wkt", "w") as w:
            w.write(compound(UTM32, FEET) + "\n")
        expect(units(f["none"], f["feet"], "--assume-crs", base + "/crs.wkt") ==
               ("EPSG:25832 + EPSG:6360", "metre", "us-survey-foot"), "WKT file")
        expect(units(f["none"], "--assume-units", "ft") == (None, "foot", None), "ft")
        expect(units(f["none"], "--assume-units", "m,ftUS") == (None, "metre", "us-survey-foot"), "both")
        expect(units(f["utm"], "--assume-units", ",ft") == ("EPSG:25832", "metre", "foot"), "z alone")
        expect(units(f["none"], "--assume-crs", "EPSG:2903", "--assume-units", "ftUS,ftUS") ==
               ("EPSG:2903", "us-survey-foot", "us-survey-foot"), "a unit said again")
        # The dataset remembers, and a push that says nothing must assume the same again.
        d.ctl("push", "d", f["none"], "--assume-crs", "EPSG:25832", "--assume-units", "m,m").ok()
        j = d.ctl("dataset", "show", "d", "--json").ok().json()
        expect(j["crs"] == "EPSG:25832" and j["units"] == {"xy": "metre", "z": "metre"}, str(j))
        r = d.ctl("push", "d", f["text"])
        expect(r.status == 1, "unknown into known")
        said(r, "unknown", "the dataset d", "--assume-crs")
        d.ctl("push", "d", f["text"], "--assume-crs", "EPSG:25832", "--assume-units", "m,m").ok()


def assumed_wrongly():
    """An assumption does not override the file. Invalid ones are refused before anything is read."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        f = files(base)
        out = base + "/m.ply"
        cases = [
            (1, ["utm"], ["--assume-crs", "EPSG:32632"], ["EPSG:25832", "EPSG:32632", "utm.las", "--override-crs"]),
            (1, ["utm"], ["--assume-units", "ft"], ["the unit of its x and y is metre", "assumes foot", "utm.las", "--override-units"]),
            (1, ["feet"], ["--assume-units", "m,m"], ["the unit of its z is us-survey-foot", "metre", "feet.las"]),
            (1, ["feet"], ["--assume-crs", "EPSG:25832 + EPSG:7837"], ["EPSG:6360", "EPSG:7837", "feet.las"]),
            (1, ["lonlat"], ["--planar", "--assume-crs", "EPSG:25832"], ["EPSG:4326", "EPSG:25832", "lonlat.las"]),
            (2, ["none"], ["--assume-crs", "EPSG:4978"], ["geocentric", "none.las"]),
            (2, ["none"], ["--assume-crs", "EPSG:25832", "--assume-units", "ft"], ["foot", "metre"]),
            (2, ["none"], ["--assume-crs", "PROJCS[\"p\"", ], ["no WKT", "PROJCS"]),
            (2, ["none"], ["--assume-crs", "FOO[\"p\"]", ], ["no WKT"]),
            (2, ["none"], ["--assume-crs", ""], ["empty"]),
            (2, ["none"], ["--assume-crs", "EPSG:99999"], ["EPSG:99999 is no system that acut knows", "check the number"]),
            (2, ["none"], ["--override-crs", "99999"], ["EPSG:99999 is no system that acut knows"]),
            (2, ["none"], ["--assume-crs", "EPSG:25832+7837"], ["EPSG:25832 + EPSG:7837"]),
            (2, ["none"], ["--override-crs", "EPSG:25832 + 1"], ["EPSG:1 is no system"]),
            (2, ["none"], ["--assume-units", "feet"], ["--assume-units", "m, ft and ftUS"]),
            (2, ["none"], ["--assume-units", "m,"], ["--assume-units"]),
            (2, ["none"], ["--assume-units", "m,m,m"], ["--assume-units"]),
            (2, ["none"], ["--assume-units", ""], ["--assume-units"]),
        ]
        for status, names, options, parts in cases:
            r = d.ctl("mesh", *[f[n] for n in names], "-o", out, *options)
            expect(r.status == status, "%s: %d\n%s" % (options, r.status, r.err))
            said(r, *parts)
        # A number alone is one of EPSG, also where a file has that name.
        with open(base + "/25832", "w") as number:
            number.write("no system")
        here = os.getcwd()
        os.chdir(base)
        for option, word, crs in (("--assume-crs", "25832 + 7837", "EPSG:25832 + EPSG:7837"), ("--override-crs", "25832", "EPSG:25832")):
            r = d.ctl("mesh", f["none"], "-o", out, option, word, "--scale", ".5,.25", "--json").ok()
            expect(r.json()["crs"] == crs, r.out)
        os.chdir(here)
        # One of several: the others go on, as with any refused input.
        r = d.ctl("mesh", f["utm"], f["none"], f["n32"], "-o", out, "--assume-crs", "EPSG:25832")
        expect(r.status == 3, r.err)
        said(r, "n32.las", "EPSG:32632")


GEOCENTRIC = [(1024, 0, 1, 3), (2048, 0, 1, 4978)]


def overridden():
    """A wrong header is overridden: noted in the report, in the log of the dataset, and after an interruption."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        f = files(base)
        earth = las(base + "/earth.las", keys=GEOCENTRIC, x0=502000)
        degrees = las(base + "/degrees.las", DEGREES, x0=502200)
        out = base + "/m.ply"
        r = d.ctl("mesh", earth, "-o", out)
        expect(r.status == 2, r.err)
        said(r, "geocentric", "--override-crs")
        r = d.ctl("mesh", f["utm"], earth, degrees, f["none"], f["text"], "-o", out, "--override-crs", "EPSG:32632",
                  "--override-units", "m,ft", "--json")
        j = r.ok().json()
        expect(j["crs"] == "EPSG:32632" and j["units"] == {"xy": "metre", "z": "foot"}, str(j))
        expect([i["overridden"] for i in j["inputs"]] ==
               ["EPSG:25832, x and y in metre, z in unknown", "EPSG:4978, x and y in metre, z in metre",
                "EPSG:4326, x and y in degree, z in unknown", None, None], str(j["inputs"]))
        # The heights are unknown if the given system has none; units alone replace units.
        j = d.ctl("mesh", f["height"], "-o", out, "--override-crs", "EPSG:32632", "--json").ok().json()
        expect(j["crs"] == "EPSG:32632" and j["units"] == {"xy": "metre", "z": None}, str(j))
        j = d.ctl("mesh", f["feet"], "-o", out, "--override-units", ",m", "--json").ok().json()
        expect(j["crs"] == "EPSG:25832 + EPSG:6360" and j["units"] == {"xy": "metre", "z": "metre"}, str(j))
        # The same system as that of the file overrides nothing.
        j = d.ctl("mesh", f["utm"], "-o", out, "--override-crs", "EPSG:25832", "--json").ok().json()
        expect(j["inputs"][0]["overridden"] is None, str(j["inputs"]))
        # Projected numbers that are degrees are projected as such.
        lonlat = las(base + "/named-utm.las", UTM32.replace("25832", "32632"), x0=8)
        box = bytearray(open(lonlat, "rb").read())
        box[131 + 32:131 + 40] = struct.pack("<d", -4999950.)  # y offset: y at 50 degrees
        box[179 + 16:179 + 32] = struct.pack("<2d", 70, 50)
        open(lonlat, "wb").write(bytes(box))
        j = d.ctl("mesh", lonlat, "-o", out, "--override-crs", "EPSG:4326", "--utm", "32N", "--json")
        expect("zone" in j.out or "longitude" in j.err, j.out + j.err)

        r = d.ctl("push", "d", earth, f["utm"], "--override-crs", "EPSG:25832", "--override-units", "m,m").ok()
        expect("earth.las: overridden: its records have EPSG:4978" in r.out + r.err, r.out + r.err)
        d.ctl("push", "d", degrees, "--override-crs", "EPSG:25832", "--override-units", "m,m", "--json").ok()
        d.stop()
        d.start()
        rows = [json.loads(line) for line in d.ctl("dataset", "log", "d", "--files", "--json").ok().out.splitlines()]
        log = {file["name"]: file["overridden"] for row in rows for file in row["files"]}
        expect(log == {"earth.las": "EPSG:4978, x and y in metre, z in metre",
                       "utm.las": "EPSG:25832, x and y in metre, z in unknown",
                       "degrees.las": "EPSG:4326, x and y in degree, z in unknown"}, str(log))
        expect("EPSG:4978" in d.ctl("dataset", "log", "d", "--files").ok().out, "the list for people")

        for status, names, options, parts in (
                (2, ["utm"], ["--override-crs", "EPSG:25832", "--assume-crs", "EPSG:25832"], ["--assume-crs", "--override-crs"]),
                (2, ["utm"], ["--override-units", "m", "--assume-units", ",m"], ["--assume-units", "--override-units"]),
                (2, ["utm"], ["--override-crs", ""], ["empty"]),
                (2, ["utm"], ["--override-units", "feet"], ["--override-units", "m, ft and ftUS"]),
                (2, ["utm"], ["--override-crs", "EPSG:25832", "--override-units", "ft"], ["foot", "metre"]),
                (2, ["utm"], ["--override-crs", "EPSG:4978"], ["geocentric"]),
                (1, ["lonlat"], ["--override-units", "m"], ["degrees", "EPSG:4326", "--override-crs"])):
            r = d.ctl("mesh", *[f[n] for n in names], "-o", out, *options)
            expect(r.status == status, "%s: %d\n%s" % (options, r.status, r.err))
            said(r, *parts)


# Numbers alone, as files have them: EPSG's name and unit, or the two halves of a compound one.
NUMBERS = {3005: "metre", 2948: "metre", 2229: "us-survey-foot", 2263: "us-survey-foot", 31983: "metre", 3763: "metre", 3003: "metre",
           3045: "metre", 4647: "metre", 5972: "metre", 6677: "metre", 2446: "metre", 31256: "metre", 6514: "metre"}


def numbers():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        for i, (code, unit) in enumerate(NUMBERS.items()):
            path = las("%s/%d.las" % (base, code), keys=[(1024, 0, 1, 1), (3072, 0, 1, code)])
            j = d.ctl("info", path, "--header", "--json").ok().json()
            expect(j["crs_name"] and j["units"]["xy"] == unit and not j["warning"], str(j))
            j = d.ctl("mesh", path, "-o", base + "/m.ply", "--max-edge", "30m", "--json").ok().json()
            expect(j["triangles"] == 8 and j["left_out"]["triangles"] == 0, str(j))
            expect(j["crs"] == ("EPSG:25832 + EPSG:5941" if code == 5972 else "EPSG:%d" % code), str(j))
            expect(j["units"] == {"xy": unit, "z": "metre" if code == 5972 else None}, str(j))
        r = d.ctl("info", path, "--header").ok()
        expect("EPSG:6514 (NAD83(2011) / Montana)" in r.out, r.out)
        # The file's own unit holds, and the contradiction is told by name; so is a unit that has no name here.
        odd = las(base + "/odd.las", keys=[(1024, 0, 1, 1), (3072, 0, 1, 2229), (3076, 0, 1, 9001)])
        expect(d.ctl("mesh", odd, "-o", base + "/m.ply", "--json").ok().json()["units"]["xy"] == "metre", "the file's own unit")
        r = d.ctl("mesh", odd, "-o", base + "/m.ply").ok()
        said(r, "odd.las", "x and y are taken as metre, but EPSG:2229 (NAD83 / California zone 5 (ftUS)) is in the unit us-survey-foot")
        r = d.ctl("mesh", las(base + "/link.las", keys=[(1024, 0, 1, 1), (3072, 0, 1, 2314)]), "-o", base + "/m.ply").ok()
        said(r, "EPSG:2314 (Trinidad 1903 / Trinidad Grid (ftCla)) is in the unit Clarke's foot", "the unit of x and y")
        # Unknown units are reported when a dataset is created, and not again.
        said(d.ctl("push", "d", path).ok(), "the unit of z is unknown")
        r = d.ctl("push", "d", las(base + "/more.las", keys=[(1024, 0, 1, 1), (3072, 0, 1, 6514)], x0=500200)).ok()
        expect("unknown" not in r.err, r.err)
        expect("unknown" not in d.ctl("submit", "d", "--wait").ok().err, "a mesh of it")


METRES = {"metre": Fraction(1), "foot": Fraction(3048, 10000), "us-survey-foot": Fraction(1200, 3937)}
WORD = {"metre": "m", "foot": "ft", "us-survey-foot": "ftUS"}


def read_obj(path):
    head, vertices = [], []
    with open(path) as f:
        for line in f:
            if line.startswith("#"):
                head.append(line[2:-1])
            elif line.startswith("v "):
                vertices.append(line.split()[1:])
    return head, vertices


def read_ply(path):
    with open(path, "rb") as f:
        data = f.read()
    head, body = data.split(b"end_header\n", 1)
    n = int(re.search(rb"element vertex (\d+)", head).group(1))
    return head.decode(), [struct.unpack_from("<3d", body, 24 * i) for i in range(n)]


def z_unit():
    """Every pair of units, compared with fractions: doubles are the nearest ones, decimals exact or rounded in the last digit."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        low = las(base + "/low.las", z0=-12345)
        for (a, fa), (b, fb) in itertools.product(METRES.items(), METRES.items()):
            out, obj = base + "/m.ply", base + "/m.obj"
            words = ["--assume-units", "m," + WORD[a], "--z-unit", WORD[b], "--canonical"]
            plain = d.ctl("mesh", low, "-o", base + "/p.obj", "--assume-units", "m," + WORD[a], "--canonical").ok()
            j = d.ctl("mesh", low, "-o", out, "-o", obj, "--json", *words).ok().json()
            expect(j["units"] == {"xy": "metre", "z": b}, str(j["units"]))
            want = [Fraction(v[2]) * fa / fb for v in read_obj(base + "/p.obj")[1]]
            head, doubles = read_ply(out)
            expect("comment acut-units metre %s\n" % b in head, head)
            expect([v[2] for v in doubles] == [float(w) for w in want], "%s to %s: doubles" % (a, b))
            head, texts = read_obj(obj)
            exact = (fa / fb).denominator in (1, 1250, 500000)
            for text, w in zip(texts, want):
                digits = len(text[2].split(".")[1])
                error = abs(Fraction(text[2]) - w)
                expect(error == 0 if exact else error <= Fraction(1, 2 * 10 ** digits) and digits == 11,
                       "%s to %s: %s is not %s" % (a, b, text[2], w))
                expect(round(Fraction(text[2]) * fb / fa * 100) == w * fb / fa * 100, "the lattice number is lost")
            note = [h for h in head if h.startswith("acut-z-unit")]
            if a == b:
                expect(not note, str(note))
            else:
                ratio = fa / fb
                expect(note == ["acut-z-unit %s: z is the lattice's z in %s times %d/%d" %
                                (b, a, ratio.numerator, ratio.denominator)], str(note))
                v = e2e.run([e2e.VERIFY, out, "--planar", low])
                expect(v.status != 0 and "acut-z-unit" in v.err + v.out, v.err + v.out)
            del plain
        # The origin is taken off after the conversion; that of auto is whole.
        for origin in ("1,2,-40000.125", "auto"):
            d.ctl("mesh", low, "-o", obj, "--assume-units", "m,m", "--z-unit", "ftUS", "--origin", origin).ok()
            head, vertices = read_obj(obj)
            taken = [h for h in head if h.startswith("acut-origin")][0].split()[3]
            expect("." not in taken or origin != "auto", taken)
            for v in vertices:
                metres = (Fraction(v[2]) + Fraction(taken)) * METRES["us-survey-foot"]
                expect(abs(metres - Fraction(round(metres * 100), 100)) < Fraction(1, 10 ** 8), "origin " + origin)
                expect(abs(metres + 12345) < 2, str(metres))
        for status, words, parts in [
            (2, ["--z-unit", "ft"], ["the unit of z is unknown", "--assume-units ,m"]),
            (2, ["--z-unit", "yard"], ["--z-unit is m, ft or ftUS", "yard"]),
            (2, ["--z-unit", "m", "--assume-units", "m"], ["the unit of z is unknown"]),
        ]:
            r = d.ctl("mesh", low, "-o", base + "/x.ply", *words)
            expect(r.status == status and not os.path.exists(base + "/x.ply"), "%s: %d %s" % (words, r.status, r.err))
            said(r, *parts)
        r = d.ctl("mesh", low, "-o", base + "/x.png", "--z-unit", "m", "--assume-units", "m,m")
        expect(r.status == 2, r.err)
        said(r, "--z-unit has no meaning for png")


def lengths():
    """Nine points 10 apart: the diagonals are 14.14 long, every triangle has one."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        nine = las(base + "/nine.las")

        def left(length, *words):
            j = d.ctl("mesh", nine, "-o", base + "/m.ply", "--json", "--max-edge", length, *words).ok().json()
            return j["left_out"]["triangles"], j["left_out"]["area"]

        expect(left("15") == (0, None) and left("14") == (8, None), "file units, unknown: no area")
        expect(left("14", "--assume-units", "m") == (8, 400), "area in square metres")
        expect(left("14m", "--assume-units", "m") == (8, 400) and left("15m", "--assume-units", "m") == (0, 0), "m in m")
        expect(left("46ft", "--assume-units", "m")[0] == 8 and left("47ft", "--assume-units", "m")[0] == 0, "ft in m")
        expect(left("4.3m", "--assume-units", "ft")[0] == 8 and left("4.32m", "--assume-units", "ft")[0] == 0, "m in ft")
        # The two feet: 10 us survey feet are 10.00002 feet. A line of three and one beside: edges of 10 exactly.
        with open(base + "/edge.xyz", "w") as f:
            f.write("0 0 0\n1000000 0 0\n0 1 0\n")
        edge = base + "/edge.xyz"
        for unit, length, count in (("ftUS", "1000001ft", 1), ("ft", "1000001ft", 0), ("ft", "999999ftUS", 0),
                                    ("ftUS", "999999ftUS", 1), ("ft", "304801m", 0), ("ftUS", "304800m", 1)):
            j = d.ctl("mesh", edge, "-o", base + "/e.ply", "--json", "--max-edge", length, "--assume-units", unit).ok().json()
            expect(j["left_out"]["triangles"] == count, "%s of %s: %s" % (length, unit, j["left_out"]))
        r = d.ctl("mesh", nine, "-o", base + "/m.ply", "--max-edge", "14", "--assume-units", "ftUS").ok()
        expect("an area of 400 square US survey feet" in r.out + r.err, r.out + r.err)
        r = d.ctl("mesh", nine, "-o", base + "/m.ply", "--max-edge", "14").ok()
        expect("were left out" in r.out + r.err and "area" not in r.out + r.err, r.out + r.err)
        for length, words, parts in [
            ("14m", [], ["--max-edge is in metre, but the unit of x and y is unknown", "--assume-units"]),
            ("14yd", [], ["--max-edge is not a length", "14yd", "ftUS"]),
            ("m", [], ["--max-edge is not a length"]),
            ("0m", [], ["--max-edge is not a length"]),
            ("1e-30m", ["--assume-units", "ftUS"], ["--max-edge has too many digits"]),
        ]:
            r = d.ctl("mesh", nine, "-o", base + "/x.ply", "--max-edge", length, *words)
            expect(r.status == 2 and not os.path.exists(base + "/x.ply"), "%s: %d %s" % (length, r.status, r.err))
            said(r, *parts)
        lonlat = las(base + "/lonlat.las", DEGREES, x0=8)
        r = d.ctl("mesh", lonlat, "--planar", "-o", base + "/x.ply", "--max-edge", "14m")
        expect(r.status == 2, r.err)
        said(r, "the unit of x and y is degree")
        j = d.ctl("mesh", lonlat, "--planar", "-o", base + "/x.ply", "--max-edge", "14", "--json").ok().json()
        expect(j["left_out"]["area"] is None, "an area of degrees")
        # --thin takes the same lengths.
        j = d.ctl("mesh", nine, "-o", base + "/m.ply", "--thin", "1000m", "--assume-units", "m", "--json").ok().json()
        expect(j["used"] <= 4, str(j["used"]))
        r = d.ctl("mesh", nine, "-o", base + "/m.ply", "--thin", "15m")
        expect(r.status != 0, "a metric cell on unknown units")
        said(r, "--thin", "--assume-units")


def info():
    """One line each for plane, CRS, units, number and datum; null where nothing is said."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        f = files(base)
        for name, want in (("feet", ("plane projected", "crs EPSG:25832 + EPSG:6360 (ETRS89 / UTM zone 32N + NAVD88 height (ftUS))", "epsg 25832, heights 6360", "datum ETRS89",
                                     "units metre, heights us-survey-foot")),
                           ("none", ("plane unknown", "crs unknown", "epsg unknown", "datum unknown",
                                     "units unknown, heights unknown"))):
            text = d.ctl("info", f[name]).ok().out
            lines = [" ".join(line.split()) for line in text.splitlines()]
            for line in want:
                expect(line in lines, "%r is not in\n%s" % (line, text))
        j = d.ctl("info", f["feet"], "--json").ok().json()
        expect((j["plane"], j["epsg"], j["epsg_z"], j["datum"]) == ("projected", 25832, 6360, "ETRS89"), str(j))
        j = d.ctl("info", f["text"], "--json").ok().json()
        expect((j["plane"], j["epsg"], j["epsg_z"], j["datum"]) == (None, None, None, None), str(j))


def created():
    """A created dataset keeps its system over a restart, before and after its first push."""
    with e2e.Folder() as base:
        with e2e.Daemon(base) as d:
            f = files(base)
            d.ctl("dataset", "create", "d", "--scale", ".001,.01", "--crs", "EPSG:25832").ok()
            d.ctl("dataset", "create", "heights", "--crs", "EPSG:25832 + EPSG:6360").ok()
            d.ctl("dataset", "create", "plain").ok()
            for status, words, parts in [
                (1, ["d"], ["there is a dataset d already"]),
                (2, ["e", "--scale", "0"], ["--scale"]),
                (2, ["e", "--crs", "PROJCS[\"p\""], ["no WKT"]),
                (2, ["e", "--crs", "99999"], ["EPSG:99999 is no system"]),
                (2, ["-e"], ["-e"]),
                (2, [".e"], ["cannot name a dataset"]),
            ]:
                r = d.ctl("dataset", "create", *words)
                expect(r.status == status, "%s: %d %s" % (words, r.status, r.err))
                said(r, *parts)
            expect(d.stop() == 0, "stop")
        with e2e.Daemon(base) as d:
            j = d.ctl("dataset", "show", "d", "--json").ok().json()
            expect((j["crs"], j["points"], j["generation"]) == ("EPSG:25832", 0, 0), str(j))
            expect(len(d.ctl("datasets", "--json").ok().out.splitlines()) == 3, "three are listed")
            r = d.ctl("submit", "d", "--wait")
            expect(r.status != 0, "a mesh of nothing")
            for name, file, parts in [("d", "n32", ["EPSG:32632", "the dataset d was created with EPSG:25832", "n32.las"]),
                                      ("d", "none", ["unknown", "EPSG:25832", "--assume-crs"]),
                                      ("d", "ftus", ["us-survey-foot", "metre"]),
                                      ("heights", "height", ["EPSG:7837", "EPSG:6360"])]:
                r = d.ctl("push", name, f[file])
                expect(r.status == 1, "%s into %s: %d %s" % (file, name, r.status, r.err))
                said(r, *parts)
            r = d.ctl("push", "d", f["utm"], "--scale", "0.01")
            expect(r.status == 2, r.err)
            said(r, "created with the scale 0.001")
            expect(d.ctl("dataset", "show", "d", "--json").ok().json()["generation"] == 0, "still empty")
            d.ctl("push", "d", f["height"]).ok()
            j = d.ctl("dataset", "show", "d", "--json").ok().json()
            expect((j["crs"], j["points"], j["generation"]) == ("EPSG:25832 + EPSG:7837", 9, 1), str(j))
            expect(j["lattice"]["scale_xy"] == 0.001 or j["lattice"]["scale_xy"] == "0.001", str(j["lattice"]))
            d.ctl("push", "heights", f["feet"]).ok()
            d.ctl("push", "plain", f["none"]).ok()


def units_by_number():
    """A unit that a dataset or an input lacks is looked up by its EPSG number: older tables lacked some of them."""
    number = [(1024, 0, 1, 1), (3072, 0, 1, 2229)]
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        shown = lambda: d.ctl("dataset", "show", "k", "--json").ok().json()
        # a unit of the file's own that has no name here: what an older daemon stored of the number alone
        unknown = [las("%s/unknown%d.las" % (base, i), keys=number + [(3076, 0, 1, 32767)], x0=500000 + i * 200) for i in (1, 2)]
        feet = [las("%s/feet%d.las" % (base, i), keys=number, x0=501000 + i * 200) for i in (1, 2)]
        metres = las(base + "/metres.las", keys=number + [(3076, 0, 1, 9001)], x0=502000)
        d.ctl("push", "k", unknown[0]).ok()
        expect(shown()["crs"] == "EPSG:2229" and shown()["units"]["xy"] is None, shown())
        r = d.ctl("push", "k", metres)
        expect(r.status == 1, "metres beside US survey feet: %s" % r.err)
        said(r, "the unit of its x and y is metre", "us-survey-foot")
        d.ctl("push", "k", feet[0]).ok()
        expect(shown()["crs"] == "EPSG:2229" and shown()["units"]["xy"] == "us-survey-foot", shown())
        d.ctl("push", "k", unknown[1]).ok()
        d.ctl("push", "k", feet[1]).ok()
        expect(shown()["points"] == 36 and shown()["units"]["xy"] == "us-survey-foot", shown())
        expect(d.ctl("push", "k", metres).status == 1, "metres beside US survey feet")


if __name__ == "__main__":
    e2e.main(created, info, z_unit, lengths, mixing, across_pushes, unknown, assumed, assumed_wrongly, overridden, numbers, units_by_number)
