"""Degrees that are projected, heights that a geoid shifts, the store of geoid grids, and the output of `info`. The projection is
checked against Krueger's series, written here (Karney, "Transverse Mercator with an accuracy of a few nanometers", 2011,
equations 7 to 12 and 35), and the polar stereographic of EPSG's guidance note 7-2."""
import json
import math
import os
import random
import struct
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import e2e
from e2e import expect

DATA = e2e.data_dir()
A, F = 6378137.0, 1 / 298.257223563


# ---- the earth ----

def utm(zone, lat, lon, north=True):
    n = F / (2 - F)
    alpha = (n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16 + 41 * n**4 / 180 - 127 * n**5 / 288 + 7891 * n**6 / 37800,
             13 * n**2 / 48 - 3 * n**3 / 5 + 557 * n**4 / 1440 + 281 * n**5 / 630 - 1983433 * n**6 / 1935360,
             61 * n**3 / 240 - 103 * n**4 / 140 + 15061 * n**5 / 26880 + 167603 * n**6 / 181440,
             49561 * n**4 / 161280 - 179 * n**5 / 168 + 6601661 * n**6 / 7257600,
             34729 * n**5 / 80640 - 3418889 * n**6 / 1995840,
             212378941 * n**6 / 319334400)
    radius = A / (1 + n) * (1 + n**2 / 4 + n**4 / 64 + n**6 / 256)
    e = math.sqrt(F * (2 - F))
    d, phi = math.radians((lon - (6 * zone - 183) + 180) % 360 - 180), math.radians(lat)
    tau = math.sinh(math.atanh(math.sin(phi)) - e * math.atanh(e * math.sin(phi)))
    xi, eta = math.atan2(tau, math.cos(d)), math.asinh(math.sin(d) / math.hypot(tau, math.cos(d)))
    y = xi + sum(a * math.sin(2 * k * xi) * math.cosh(2 * k * eta) for k, a in enumerate(alpha, 1))
    x = eta + sum(a * math.cos(2 * k * xi) * math.sinh(2 * k * eta) for k, a in enumerate(alpha, 1))
    return 500000 + 0.9996 * radius * x, (0 if north else 1e7) + 0.9996 * radius * y


def ups_north(lat, lon):
    e = math.sqrt(F * (2 - F))
    s = math.sin(math.radians(lat))
    t = math.tan(math.radians(90 - lat) / 2) * ((1 + e * s) / (1 - e * s)) ** (e / 2)
    rho = 2 * A * 0.994 * t / math.sqrt((1 + e) ** (1 + e) * (1 - e) ** (1 - e))
    return 2e6 + rho * math.sin(math.radians(lon)), 2e6 - rho * math.cos(math.radians(lon))


# ---- files ----

def geographic(code=4326, metres=True):
    return [(1024, 0, 1, 2), (2048, 0, 1, code)] + ([(4099, 0, 1, 9001)] if metres else [])


def projected(code):
    return [(1024, 0, 1, 1), (3072, 0, 1, code), (4099, 0, 1, 9001)]


def las(path, points, keys=None, scale=(1e-7, 1e-7, 1e-3), box=None, returns=None, tail=b""):
    """Points (x, y, z) in coordinates, or with a class, return number and count of returns behind."""
    raw = [tuple(round(v / s) for v, s in zip(p, scale)) for p in points]
    records = b""
    if keys:
        body = struct.pack("<%dH" % (4 + 4 * len(keys)), 1, 1, 0, len(keys), *[v for k in keys for v in k])
        records = struct.pack("<H16sHH32s", 0, b"LASF_Projection", 34735, len(body), b"") + body
    box = box or [f(p[k] for p in points) for k in range(3) for f in (max, min)] if points else [0] * 6
    if returns is None:
        returns = [sum((p[4] if len(p) > 4 else 1) == k for p in points) for k in range(1, 6)]
    head = struct.pack("<4sHH16sBB32s32sHHHIIBHI5I3d3d6d", b"LASF", 0, 0, b"", 1, 2, b"", b"", 1, 2026, 227,
                       227 + len(records), bool(keys), 0, 20, len(points), *returns, *scale, 0, 0, 0, *box)
    out = bytearray()
    for p, r in zip(points, raw):
        cls, ret, of = (tuple(p[3:6]) + (0, 1, 1)[len(p) - 3:])[:3]
        out += struct.pack("<iiiHBBbBH", *r, 0, ret | of << 3, cls, 0, 0, 0)
    with open(path, "wb") as f:
        f.write(head + records + bytes(out) + tail)
    return path


def cloud(lat, lon, n=400, side=0.002, z=400.0, seed=1):
    r = random.Random(seed)
    return [(round(lon + side * r.random(), 7), round(lat + side * r.random(), 7), round(z + 5 * r.random(), 3))
            for _ in range(n)]


def pgm(path, height=lambda lat, lon: 40.0, width=36, rows=19, extra=b""):
    with open(path, "wb") as f:
        f.write(b"P5\n# Description made up\n# DateTime 2020-01-01 00:00:00\n# Offset -108\n# Scale 0.003\n"
                b"%d %d\n65535\n" % (width, rows))
        for i in range(rows):
            for k in range(width):
                v = height(90 - i * 180 / (rows - 1), k * 360 / width)
                f.write(struct.pack(">H", round((v + 108) / 0.003)))
        f.write(extra)
    return path


def read_las(path):
    """Coordinates of a LAS file, formats 0 to 5."""
    with open(path, "rb") as f:
        b = f.read()
    start, = struct.unpack_from("<I", b, 96)
    length, count = struct.unpack_from("<HI", b, 105)
    s, o = struct.unpack_from("<3d", b, 131), struct.unpack_from("<3d", b, 155)
    return [tuple(v * k + q for v, k, q in zip(struct.unpack_from("<iii", b, start + i * length), s, o))
            for i in range(count)]


def read_ply(path):
    """Header lines and vertices."""
    with open(path, "rb") as f:
        b = f.read()
    end = b.index(b"end_header\n") + 11
    head = b[:end].decode().split("\n")
    n = next(int(line.split()[2]) for line in head if line.startswith("element vertex"))
    return head, [struct.unpack_from("<3d", b, end + 24 * i) for i in range(n)]


def mesh(d, base, *args, **kw):
    out = os.path.join(base, "out.ply")
    r = d.ctl("mesh", "-o", out, "--json", "--keep-withheld", "--keep-noise", *args, **kw)
    if r.status:
        return r, None, None
    head, vertices = read_ply(out)
    return r.json(), head, vertices


def meshed(d, base, *args):
    r, head, vertices = mesh(d, base, *args)
    expect(head is not None, "%s\n%s" % (args, getattr(r, "err", "")))
    return r, head, vertices


def refused(r, status, *words):
    expect(r.status == status, "ended with %d, not %d: %s" % (r.status, status, r.err + r.out))
    for w in words:
        expect(w in r.err + r.out, "%r is not in\n%s" % (w, r.err + r.out))


def same_places(points, project, vertices, scale, z=lambda p: p[2], far=0.0):
    """Every vertex is one of the points, projected and rounded to the lattice."""
    want = {}
    for p in points:
        x, y = project(p[1], p[0])
        want.setdefault((math.floor(x / scale + 0.5), math.floor(y / scale + 0.5)), []).append((x, y, z(p)))
    worst = 0
    for v in vertices:
        key = (round(v[0] / scale), round(v[1] / scale))
        near = [w for dx in (-1, 0, 1) for dy in (-1, 0, 1) for w in want.get((key[0] + dx, key[1] + dy), [])]
        expect(near, "%s is no point" % (v,))
        off = min(max(abs(v[0] - w[0]), abs(v[1] - w[1])) for w in near if abs(w[2] - v[2]) < 1e-3 + far)
        worst = max(worst, off)
    expect(worst <= scale / 2 + 1e-6, "off by %g m on a lattice of %g" % (worst, scale))
    return worst


# ---- projecting ----

def real_files_projected():
    if not DATA:
        print("     no real files (ACUT_TEST_DATA)")
        return
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        for name, zone, crs in (("las12_pdrf0_lonlat_epsg4326.las", 15, "EPSG:32615"),
                                ("las12_pdrf3_lonlat_epsg4326.las", 10, "EPSG:32610")):
            path = os.path.join(DATA, "lidar", name)
            points = read_las(path)
            r, head, vertices = meshed(d, base, path)
            expect(r["crs"] == crs and r["projection"] == {"zone": "%dN" % zone, "datum": "WGS 84"}, r)
            expect("comment acut-crs " + crs in head, head)
            expect(r["lattice"]["scale_xy"] == 0.001, r["lattice"])
            expect(len(vertices) == r["vertices"] and r["points"] == len(points), r)
            worst = same_places(points, lambda lat, lon: utm(zone, lat, lon), vertices, 0.001)
            print("     %s: %d vertices, at most %.6f m from the formula" % (name, len(vertices), worst))
            r = d.ctl("mesh", path, "-o", os.path.join(base, "t.ply")).ok()
            text = r.out + r.err
            expect("WGS 84" in text and "UTM zone %dN" % zone in text, text)


def places_of_the_earth():
    places = [(47.0, 8.0, "32N"), (-33.5, 151.2, "56S"), (60.5, 5.0, "32N"), (78.0, 15.0, "33N"), (-17.0, 179.99, "60S"), (-17.0, 179.9995, "1S"),
              (-17.0, -180.0, "1S"), (0.0, -0.01, "30N"), (-0.01, 0.01, "31S"), (83.9, -35.0, "25N")]
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        for i, (lat, lon, zone) in enumerate(places):
            points = cloud(lat, lon)
            f = las(base + "/p%d.las" % i, points, geographic())
            r, _, vertices = meshed(d, base, f)
            expect(r["projection"]["zone"] == zone, "%s %s: %s, not %s" % (lat, lon, r["projection"], zone))
            number, north = int(zone[:-1]), zone[-1] == "N"
            same_places(points, lambda a, o: utm(number, a, o, north), vertices, 0.001)
        points = cloud(89.999, 0, side=0.0009) + cloud(89.9, 90, 50)
        f = las(base + "/pole.las", points, geographic())
        r, _, vertices = meshed(d, base, f)
        expect(r["projection"]["zone"] == "UPS-N" and r["crs"] == "EPSG:5041", r)
        same_places(points, ups_north, vertices, 0.001)
        f = las(base + "/etrs.las", cloud(52, 5), geographic(4258))
        r, _, _ = meshed(d, base, f)
        expect(r["crs"] == "EPSG:25831" and r["projection"]["datum"] == "ETRS89", r)


def one_zone_a_dataset():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        tiles = [las(base + "/t%d.las" % i, cloud(50, 5.9 + i * 0.09, seed=i), geographic()) for i in range(4)]
        seen = set()
        for k, order in enumerate(([0, 1, 2, 3], [3, 1, 0, 2])):
            d.ctl("push", "all%d" % k, *[tiles[i] for i in order]).ok()
            r = d.ctl("submit", "all%d" % k, "--wait", "--json").ok()
            job = json.loads(r.out.splitlines()[-1])
            shown = json.loads(d.ctl("show", str(job.get("id", job.get("job"))), "--json").ok().out)
            seen.add((shown["report"]["digest"], shown["report"]["vertex_digest"], shown["crs"]) if "report" in shown
                     else (shown["digest"], shown["vertex_digest"], shown["crs"]))
        expect(len(seen) == 1 and list(seen)[0][2] == "EPSG:32632", seen)
        # One by one: the first decides, the others follow, in that zone only.
        for k, order in enumerate(([0, 1, 2, 3], [0, 3, 2, 1])):
            for i in order:
                d.ctl("push", "one%d" % k, tiles[i]).ok()
            crs = json.loads(d.ctl("dataset", "show", "one%d" % k, "--json").ok().out)["crs"]
            expect(crs == "EPSG:32631", crs)
        refused(d.ctl("push", "one0", "--utm", "32N", las(base + "/u.las", cloud(50, 6, seed=9), geographic())), 2, "31N")
        # A projected file of that zone goes with degrees, exactly; one of another does not.
        x, y = utm(32, 50, 6.2)
        flat = las(base + "/flat.las", [(x + i % 3, y + i // 3, 400.5 + i % 2) for i in range(9)], projected(32632),
                   scale=(0.01,) * 3)
        r, _, vertices = meshed(d, base, flat, tiles[3])
        expect(r["crs"] == "EPSG:32632" and r["points"] == 409, r)
        for p in read_las(flat):
            expect(any(max(abs(a - b) for a, b in zip(p, v)) < 1e-9 for v in vertices), p)
        # If a projected file is in another zone of their datum, degrees are projected to that zone; two such zones are refused.
        far = las(base + "/far.las", [(x + i, y + i * i, 1) for i in range(9)], projected(32633), scale=(0.01,) * 3)
        r, _, _ = meshed(d, base, far, tiles[3])
        expect(r["crs"] == "EPSG:32633" and r["projection"]["zone"] == "33N", r)
        for order in ([far, flat, tiles[3]], [tiles[3], flat, far]):
            refused(d.ctl("mesh", *order, "-o", base + "/x.ply"), 1, "EPSG:32632", "EPSG:32633")
        expect(not os.path.exists(base + "/x.ply"), "two zones went together")
        # The same tiles on one or several workers, and through a pipe.
        big = las(base + "/big.las", cloud(50, 8, 150000, side=0.4), geographic())
        digests = set()
        for memory, threads in (("64M", "1"), ("256M", "2"), ("256M", "4")):
            r = e2e.run([e2e.ACUTCTL, "mesh", big, "-o", base + "/b.ply", "--json", "--memory", memory, "--threads", threads],
                        env={"XDG_CACHE_HOME": base, "XDG_RUNTIME_DIR": base, "ACUT_DAEMON": e2e.ACUTD})
            digests.add((r.ok().json()["digest"], r.json()["vertex_digest"]))
        with open(big, "rb") as f:
            r = d.ctl("mesh", "-", "--input-format", "las", "-o", base + "/b.ply", "--json", stdin=f)
        digests.add((r.ok().json()["digest"], r.json()["vertex_digest"]))
        expect(len(digests) == 1, digests)


def zone_of_a_created_dataset():
    """Degrees are projected to the plane of the created dataset, and stay degrees if it has degrees."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        tile = las(base + "/t.las", cloud(50, 5.9), geographic())
        for name, crs in (("next", "EPSG:32632"), ("degrees", "EPSG:4326")):
            d.ctl("dataset", "create", name, "--crs", crs).ok()
            d.ctl("push", name, tile).ok()
            shown = json.loads(d.ctl("dataset", "show", name, "--json").ok().out)
            expect(shown["crs"] == crs and shown["points"] == 400, shown)
        refused(d.ctl("push", "next", las(base + "/u.las", cloud(50, 5.91), geographic()), "--utm", "31N"), 2, "zone 32N")
        d.ctl("dataset", "create", "other", "--crs", "EPSG:2154").ok()
        refused(d.ctl("push", "other", tile), 2, "cannot be brought to the plane", "EPSG:2154")


def zones_asked_for():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        points = cloud(47, 8)
        f = las(base + "/a.las", points, geographic())
        r, _, vertices = meshed(d, base, "--utm", "33n", f)
        expect(r["crs"] == "EPSG:32633" and r["projection"]["zone"] == "33N", r)
        same_places(points, lambda a, o: utm(33, a, o), vertices, 0.001)
        refused(d.ctl("mesh", f, "-o", base + "/x.ply", "--utm", "61N"), 2, "61N", "no zone")
        refused(d.ctl("mesh", f, "-o", base + "/x.ply", "--utm", "32N", "--planar"), 2, "--planar")
        # Too far from the zone: the file and the point are named, and nothing comes out.
        r = d.ctl("mesh", f, "-o", base + "/x.ply", "--utm", "40N")
        refused(r, 1, "a.las", "point 0", "zone 40N", "--utm")
        expect(not os.path.exists(base + "/x.ply"), "a mesh of wrong numbers")
        refused(d.ctl("mesh", f, "-o", base + "/x.ply", "--utm", "UPS-N"), 1, "a.las", "UPS-N")
        flat = las(base + "/flat.las", [(5e5 + i % 3, 5e6 + i // 3, 1) for i in range(9)], projected(32632), scale=(0.01,) * 3)
        refused(d.ctl("mesh", flat, "-o", base + "/x.ply", "--utm", "32N"), 2, "--utm", "degrees")
        # As they are.
        r, _, vertices = meshed(d, base, "--planar", f)
        expect(r["crs"] == "EPSG:4326" and r["units"]["xy"] == "degree" and r["projection"] is None, r)
        expect(all(8 <= v[0] <= 8.01 for v in vertices), "planar degrees moved")


def degrees_refused():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        out = ["-o", base + "/x.ply"]
        good = las(base + "/good.las", cloud(47, 8), geographic())
        swapped = las(base + "/swapped.las", [(p[1], p[0] - 101, p[2]) for p in cloud(47, 8)], geographic())
        refused(d.ctl("mesh", swapped, *out), 1, "swapped.las", "swapped")
        metres = las(base + "/metres.las", [(5e5 + i % 3, 5e6 + i // 3, 1) for i in range(9)], geographic(), scale=(0.01,) * 3)
        refused(d.ctl("mesh", metres, *out), 1, "metres.las", "degrees")
        # The header tells a tale, the points do not fit it.
        liar = las(base + "/liar.las", [(p[1], p[0] - 101, p[2]) for p in cloud(47, 8)], geographic(),
                   box=[8.1, 8, 47.1, 47, 9, 8])
        refused(d.ctl("mesh", liar, *out), 1, "liar.las", "point 0", "swapped")
        # Among good ones it is left out.
        r = d.ctl("mesh", good, swapped, "-o", base + "/y.ply", "--json")
        expect(r.status == 3 and r.json()["projection"]["zone"] == "32N" and len(r.json()["refused"]) == 1, r.out + r.err)
        refused(d.ctl("mesh", las(base + "/nad27.las", cloud(40, -90), geographic(4267)), *out), 2, "NAD27", "--planar")
        refused(d.ctl("mesh", las(base + "/odd.las", cloud(40, -90), [(1024, 0, 1, 2)]), *out), 2, "datum", "--assume-crs")
        refused(d.ctl("mesh", las(base + "/geocentric.las", [(4e6 + i, 6e5 + i * i, 4.9e6) for i in range(9)],
                                  [(1024, 0, 1, 3), (2048, 0, 1, 4978)], scale=(0.01,) * 3), *out), 2, "geocentric")
        # The messages about them.
        r, _, _ = meshed(d, base, "--assume-crs", "EPSG:4326", las(base + "/none.las", cloud(47, 8)))
        expect(r["crs"] == "EPSG:32632", r)


# ---- geoids ----

def store_of_grids():
    with e2e.Folder() as base:
        flat, other = pgm(base + "/flat.pgm"), pgm(base + "/other.pgm", lambda lat, lon: -7.5)
        with e2e.Daemon(base) as d:
            expect(d.ctl("geoid", "list", "--json").ok().out == "", "a grid from nowhere")
            g = json.loads(d.ctl("geoid", "add", flat, "--json").ok().out)
            expect(g["name"] == "flat" and g["width"] == 36 and g["height"] == 19 and abs(g["min"] - 40) < 2e-3 and
                   g["rms_error"] is None and g["bytes"] == os.path.getsize(flat), g)
            try:
                import xxhash
                with open(flat, "rb") as f:
                    expect(xxhash.xxh3_128(f.read()).hexdigest() == g["hash"], g)
            except ImportError:
                print("     no python3-xxhash: hashes are not compared")
            d.ctl("geoid", "add", flat).ok()
            refused(d.ctl("geoid", "add", other, "--name", "flat"), 1, "another geoid grid flat")
            d.ctl("geoid", "add", other, "--name", "low").ok()
            d.ctl("geoid", "add", flat, "--name", "twin").ok()
            expect([json.loads(s)["name"] for s in d.ctl("geoid", "list", "--json").out.splitlines()] ==
                   ["flat", "low", "twin"], "list")
            d.ctl("geoid", "rm", "flat").ok()
            refused(d.ctl("geoid", "rm", "flat"), 4, "flat", "geoid add")
            grids = sorted(os.listdir(d.state + "/geoids"))
            expect(len(grids) == 4 and g["hash"] + ".pgm" in grids, grids)
            for name, what in (("cut", b"x"), ("no", b"")):
                bad = pgm(base + "/%s.pgm" % name, extra=what)
                if name == "no":
                    with open(bad, "r+b") as f:
                        f.write(b"P6")
                refused(d.ctl("geoid", "add", bad), 1, name + ".pgm")
            refused(d.ctl("geoid", "add", base), 1, "regular file")
            refused(d.ctl("geoid", "add", base + "/absent.pgm"), 1, "absent.pgm")
            refused(d.ctl("geoid", "add", flat, "--name", "../up"), 2, "cannot name")
            for words in (["frobnicate"], ["add"], ["list", "x"], ["rm", "low", "--name", "y"]):
                refused(d.ctl("geoid", *words), 2, "geoid")
            expect(sorted(os.listdir(d.state + "/geoids")) == grids, "leftovers")
            d.stop(9)
        # After a crash temporary files are removed, and the added grid is there.
        open(d.state + "/geoids/7.tmp", "w").close()
        open(d.state + "/geoids/" + "0" * 32 + ".pgm", "w").close()
        with e2e.Daemon(base) as d:
            expect(sorted(os.listdir(d.state + "/geoids")) == grids, os.listdir(d.state + "/geoids"))
            expect([json.loads(s)["name"] for s in d.ctl("geoid", "list", "--json").out.splitlines()] == ["low", "twin"], "list")
            expect("-7.5" in d.ctl("geoid", "list").ok().out, "list for people")


def heights_shifted():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        points = cloud(47, 8)
        f = las(base + "/a.las", points, geographic())
        d.ctl("geoid", "add", pgm(base + "/flat.pgm")).ok()
        d.ctl("geoid", "add", pgm(base + "/slope.pgm", lambda lat, lon: 30 + lat / 10)).ok()
        for way, sign in ((), -1), (("--geoid-way", "orthometric"), -1), (("--geoid-way", "ellipsoidal"), 1):
            r, head, vertices = meshed(d, base, f, "--geoid", "flat", *way)
            g = r["geoid"]
            kind = "ellipsoidal" if sign > 0 else "orthometric"
            expect(g["name"] == "flat" and g["way"] == kind and g["points"] == len(points), g)
            for key in ("min", "mean", "max"):
                expect(abs(g[key] - sign * 40) < 2e-3, g)
            expect(r["crs"] == "EPSG:32632 + %s height (flat)" % kind, r["crs"])
            expect("comment acut-crs " + r["crs"] in head and "comment acut-geoid %s %s flat" % (kind, g["hash"]) in head, head)
            same_places(points, lambda a, o: utm(32, a, o), vertices, 0.001, lambda p: p[2] + sign * 40, far=2e-3)
        r, _, _ = meshed(d, base, f, "--geoid", "slope")
        expect(r["geoid"]["min"] < r["geoid"]["mean"] < r["geoid"]["max"] and abs(r["geoid"]["mean"] + 34.7001) < 2e-3, r)
        # Heights only, degrees as they are; a plane that is known; feet.
        r, _, vertices = meshed(d, base, f, "--geoid", "flat", "--planar")
        expect(r["units"]["xy"] == "degree" and r["projection"] is None and all(v[2] < 366 for v in vertices), r)
        x, y = utm(32, 47, 8)
        plane = [(x + i % 20, y + i // 20, 400 + i % 7) for i in range(400)]
        flat = las(base + "/flat.las", plane, projected(32632), scale=(0.01,) * 3)
        r, _, vertices = meshed(d, base, flat, "--geoid", "flat")
        expect(abs(r["geoid"]["mean"] + 40) < 2e-3 and r["lattice"]["scale_z"] == 0.001, r)
        feet = las(base + "/feet.las", plane, projected(32632)[:2] + [(4099, 0, 1, 9002)], scale=(0.01,) * 3)
        r, _, vertices = meshed(d, base, feet, "--geoid", "flat")
        expect(abs(min(v[2] for v in vertices) - (400 - 40 / 0.3048)) < 0.02, min(v[2] for v in vertices))
        t = d.ctl("mesh", flat, "-o", base + "/t.ply", "--geoid", "flat").ok()
        expect("made orthometric by flat" in t.out + t.err and r["geoid"]["hash"] in t.out + t.err, t.out + t.err)
        # A file named in place of a kept grid, and a daemon that is fresh.
        r = e2e.run([e2e.ACUTCTL, "mesh", f, "-o", base + "/own.ply", "--json", "--memory", "64M", "--geoid",
                     base + "/slope.pgm"], env={"XDG_CACHE_HOME": base, "XDG_RUNTIME_DIR": base}).ok().json()
        expect(r["geoid"]["name"] == "slope" and abs(r["geoid"]["mean"] + 34.7001) < 2e-3, r)


def heights_refused():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        out = ["-o", base + "/x.ply"]
        f = las(base + "/a.las", cloud(47, 8), geographic())
        g = las(base + "/b.las", cloud(47, 8.01), geographic())
        refused(d.ctl("mesh", f, "--geoid", "egm96-5", *out), 4, "egm96-5", "acutctl geoid add")
        d.ctl("geoid", "add", pgm(base + "/flat.pgm")).ok()
        d.ctl("geoid", "add", pgm(base + "/low.pgm", lambda lat, lon: -3)).ok()
        refused(d.ctl("mesh", f, "--geoid", "flat", "--geoid-way", "up", *out), 2, "up")
        refused(d.ctl("mesh", f, "--geoid-way", "orthometric", *out), 2, "--geoid")
        unit = las(base + "/unit.las", cloud(47, 8), geographic(metres=False))
        refused(d.ctl("mesh", unit, "--geoid", "flat", *out), 2, "unit of the heights", "--assume-units ,m ")
        meshed(d, base, unit, "--geoid", "flat", "--assume-units", ",m")
        place = las(base + "/place.las", [(i % 3, i // 3, 1) for i in range(9)], scale=(0.01,) * 3)
        refused(d.ctl("mesh", place, "--geoid", "flat", "--assume-units", "m,m", *out), 2, "on the earth", "--assume-crs")
        ortho = las(base + "/ortho.las", cloud(47, 8), geographic() + [(4096, 0, 1, 5773)])
        refused(d.ctl("mesh", ortho, "--geoid", "flat", *out), 2, "5773", "already")
        # All pushes use the grid of the dataset.
        d.ctl("push", "shifted", f, "--geoid", "flat").ok()
        refused(d.ctl("push", "shifted", g), 2, "shifted", "orthometric")
        refused(d.ctl("push", "shifted", g, "--geoid", "low"), 2, "orthometric")
        refused(d.ctl("push", "shifted", g, "--geoid", "flat", "--geoid-way", "ellipsoidal"), 2, "ellipsoidal")
        rows = d.ctl("push", "shifted", g, "--geoid", "flat", "--json").ok().out.splitlines()
        row = json.loads(rows[0])
        expect(row["projection"] == {"zone": "32N", "datum": "WGS 84", "from": "EPSG:4326"} and row["geoid"]["points"] == 400, row)
        d.ctl("push", "plain", f).ok()
        refused(d.ctl("push", "plain", g, "--geoid", "flat"), 2, "not shifted")


def heights_of_a_real_grid():
    path = os.path.join(DATA, "geoid", "egm84-30.pgm") if DATA else ""
    if not os.path.exists(path):
        print("     no real grid (ACUT_TEST_DATA)")
        return
    # GeoidEval 2.1.2, cubic.
    known = [(38.6281550, -90.2208450, -32.2069), (-14.6212170, -54.9788860, -2.0504), (46.8743190, 102.4487290, -43.3753),
             (-23.6174460, 133.8747120, 17.9965), (27.988056, 86.925278, -30.4495), (52.0, 4.0, 43.7310)]
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("geoid", "add", path).ok()
        for lat, lon, n in known:
            points = [(lon, lat, 1000.0), (lon + 1e-5, lat, 1000.0), (lon, lat + 1e-5, 1000.0)]
            r, _, vertices = meshed(d, base, las(base + "/k.las", points, geographic()), "--geoid", "egm84-30")
            off = [abs(v[2] - (1000 - n)) for v in vertices]
            # On the border of two cells GeographicLib's cubics differ by some millimetres.
            expect(len(off) == 3 and min(off) < 0.0006 and max(off) < 0.006, (n, vertices))


# ---- info ----

def what_files_are():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        x, y = utm(32, 47, 9)
        points = [(x + i % 21 * 5, y + i // 21 * 5, 400 + i % 7, 2 if i % 3 else 6, 1 + i % 2, 2) for i in range(441)]
        points += points[:10]
        box = [x + 500, x, y + 100, y, 406, 400]
        f = las(base + "/a.las", points, projected(32632), scale=(0.01,) * 3, box=box, returns=[451, 0, 0, 0, 0], tail=b"rest")
        i = d.ctl("info", f, "--json").ok().json()
        expect(i["records"] == 451 and i["distinct"] == 441 and i["duplicates"] == 10, i)
        classes = {str(c): sum(p[3] == c for p in points) for c in (2, 6)}
        expect(i["classes"] == classes and i["returns"] == {"1": 226, "2": 225} and i["return_counts"] == {"2": 451}, i)
        expect(max(abs(a - b) for a, b in zip(i["record_max"], (x + 100, y + 100, 406))) < 0.0051, i)
        expect(len(i["differences"]) == 3 and "header has x" in i["differences"][0] and
               "returns 1: 451" in i["differences"][1] and "4 bytes" in i["differences"][2], i["differences"])
        # 100 m by 100 m at the scale 0.9996 of the meridian
        expect(i["hull"]["corners"] == 4 and abs(i["hull"]["area_units"] - 1e4) < 1e-3, i["hull"])
        expect(abs(i["hull"]["area_m2"] / (1e4 / 0.9996**2) - 1) < 1e-6, i["hull"])
        expect(abs(i["density"]["points_m2"] * i["hull"]["area_m2"] - 451) < 1e-6, i["density"])
        expect(abs(i["place"]["south"] - 47) < 1e-6 and abs(i["place"]["west"] - 9) < 1e-6, i["place"])
        expect(i["place"]["mgrs"].startswith("32T") and len(i["place"]["mgrs"]) == 9, i["place"])
        text = d.ctl("info", f).ok().out
        for w in ("451", "mgrs", "differs", "convex hull", "class"):
            expect(w in text, text)
        i = d.ctl("info", f, "--json", "--header").ok().json()
        expect(i["points"] == 451 and all(i[k] is None for k in ("records", "distinct", "classes", "place", "hull",
                                                                "differences", "density", "lattice")), i)
        # Unknown is unknown.
        i = d.ctl("info", las(base + "/none.las", points, scale=(0.01,) * 3), "--json").ok().json()
        expect(i["place"] is None and i["hull"]["area_m2"] is None and i["density"]["points_m2"] is None and
               abs(i["hull"]["area_units"] - 1e4) < 1e-3 and i["differences"] == [], i)
        expect("  place     unknown" in d.ctl("info", base + "/none.las").ok().out, "text of the unknown")
        i = d.ctl("info", las(base + "/zero.las", []), "--json").ok().json()
        expect(i["records"] == 0 and i["record_min"] == [None] * 3 and i["place"] is None, i)
        i = d.ctl("info", las(base + "/deg.las", cloud(-17, 179.9995), geographic()), "--json").ok().json()
        expect(i["place"]["west"] > 179.9 and i["place"]["mgrs"][:2] in ("60", "01"), i["place"])
        # Hulls that are none, and one with more corners than are kept.
        line = las(base + "/line.las", [(x + k, y + k, 1) for k in (2, 0, 1, 2)], projected(32632), scale=(0.01,) * 3)
        i = d.ctl("info", line, "--json").ok().json()
        expect(i["hull"]["corners"] == 2 and i["hull"]["area_m2"] == 0 and i["density"]["points_m2"] is None and
               i["distinct"] == 3, i)
        i = d.ctl("info", las(base + "/one.las", [(x, y, k) for k in range(9)], projected(32632), scale=(0.01,) * 3), "--json")
        expect(i.ok().json()["distinct"] == 1 and i.json()["hull"]["corners"] == 1, i.out)
        circle = [(x + 1e5 * math.cos(k * math.pi / 1e4), y + 1e5 * math.sin(k * math.pi / 1e4), 1) for k in range(20000)]
        i = d.ctl("info", las(base + "/circle.las", circle, projected(32632), scale=(0.01,) * 3), "--json").ok().json()
        expect(i["hull"]["thinned"] and i["hull"]["corners"] <= 4096 and
               abs(i["hull"]["area_units"] / (math.pi * 1e10) - 1) < 1e-5, i["hull"])
        # Files that are none of this: each is told about, and the daemon is still there.
        if DATA:
            bad = os.path.join(DATA, "malformed")
            files = sorted(os.path.join(bad, f) for f in os.listdir(bad) if f.endswith((".las", ".laz")))
            r = d.ctl("info", "--json", *files)
            expect(r.status == 3 and len(r.out.splitlines()) == len(files), r.out + r.err)
            d.ctl("ping").ok()
        # Nothing stays behind.
        expect(os.listdir(d.cache + "/tmp") == [], os.listdir(d.cache + "/tmp"))
        if DATA:
            real = os.path.join(DATA, "lidar")
            i = d.ctl("info", real + "/las12_pdrf3_autzen_ft.las", "--json").ok().json()
            expect(i["distinct"] == 109993 and i["place"]["mgrs"] == "10TDP9477" and i["differences"] == [], i)


if __name__ == "__main__":
    e2e.main(real_files_projected, places_of_the_earth, one_zone_a_dataset, zone_of_a_created_dataset, zones_asked_for, degrees_refused, store_of_grids,
             heights_shifted, heights_refused, heights_of_a_real_grid, what_files_are)
