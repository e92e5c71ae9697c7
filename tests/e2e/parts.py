"""Files with a part of a mesh (--max-edge, --trim-hull, --mask, --erase, --tile, --bbox, --changed-since) say so, their digest is that of their triangles, and
acut-verify accepts them as such."""
import glob
import os
import random
import struct

import e2e
from e2e import expect, main, run


def comments(path):
    with open(path, "rb") as f:
        head = f.read(16384).split(b"end_header")[0].decode(errors="replace")
    return dict(line.split(" ", 2)[1:] for line in head.splitlines() if line.startswith("comment acut-"))


def verified(path, *points):
    got = run([e2e.VERIFY, "--json", path, *points]).ok().json()
    digest = comments(path)["acut-digest"].split()
    expect(got["good"] and got["digest_in_file"] and got["digest"] == digest[0] and got["vertex_digest"] == digest[1], str(got))
    return got


def survey(base, seed, name):
    """Clusters far from each other, so that some edges are long."""
    rng, path = random.Random(seed), os.path.join(base, name)
    with open(path, "w") as f:
        for _ in range(60):
            x, y = rng.randrange(100000), rng.randrange(100000)
            f.writelines("%d.%d %d.%d %d.5\n" % (x + rng.randrange(300), rng.randrange(10), y + rng.randrange(300), rng.randrange(10), i)
                         for i in range(40))
    return path


def says_what_it_is():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = survey(base, 1, "a.xyz")
        whole, part, obj = base + "/whole.ply", base + "/part.ply", base + "/part.obj"
        d.ctl("mesh", path, "-o", whole).ok()
        expect("acut-trimmed" not in comments(whole) and not verified(whole, path)["trimmed"], "the whole mesh")
        for limit, words in (("900.5", "max-edge=900.5"), ("1e9", "max-edge=1e9"), ("0.001", "max-edge=0.001")):
            got = d.ctl("mesh", path, "--max-edge", limit, "-o", part, "-o", obj, "--json").ok().json()
            expect(comments(part)["acut-trimmed"].replace("1000000000", "1e9") == words, comments(part)["acut-trimmed"])
            v = verified(part, path)
            expect(v["trimmed"] and v["digest"] == got["left_out"]["written_digest"], "%s %s" % (v, got["left_out"]))
            expect(v["triangles"] == got["triangles"] - got["left_out"]["triangles"] and v["vertices"] == got["vertices"], str(v))
            with open(obj) as f:
                lines = [l for l in f if l.startswith("#")]
            expect(any("acut-trimmed " + comments(part)["acut-trimmed"] in l for l in lines)
                   and any("acut-digest " + comments(part)["acut-digest"] in l for l in lines), str(lines))
        expect(v["triangles"] == 0, "all edges are longer")
        # Without the comment it would be called wrong, and with the digest of the whole mesh, too.
        d.ctl("mesh", path, "--max-edge", "900.5", "-o", part).ok()
        with open(part, "rb") as f:
            data = f.read()
        for old, new in ((b"acut-trimmed", b"acut-tr-mmed"), (comments(part)["acut-digest"].encode(), comments(whole)["acut-digest"].encode())):
            with open(base + "/bad.ply", "wb") as f:
                f.write(data.replace(old, new))
            expect(run([e2e.VERIFY, base + "/bad.ply"]).status == 1, "%s is not missed" % old)


def windows_tiles_changes():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, more = survey(base, 2, "a.xyz"), survey(base, 3, "b.xyz")
        out = base + "/out.ply"
        d.ctl("push", "d", path).ok()
        first = d.ctl("submit", "d", "--wait", "--json").ok().json()
        d.ctl("fetch", first["job"], "-o", out, "--bbox", "20000,20000,60000,60000").ok()
        expect(comments(out)["acut-trimmed"] == "window" and verified(out, path)["trimmed"], "a window")
        d.ctl("fetch", first["job"], "-o", out, "--bbox", "20000,20000,60000,60000", "--max-edge", "5000").ok()
        expect(comments(out)["acut-trimmed"] == "max-edge=5000 window" and verified(out, path), str(comments(out)))
        d.ctl("fetch", first["job"], "-o", base + "/tiles", "--tile", "25000", "--max-edge", "9000").ok()
        tiles = glob.glob(base + "/tiles/*.ply")
        expect(len(tiles) > 4 and all(comments(t)["acut-trimmed"] == "max-edge=9000 tile=25000" and verified(t, path) for t in tiles),
               str(tiles))
        d.ctl("push", "d", more).ok()
        second = d.ctl("submit", "d", "--wait", "--json").ok().json()
        d.ctl("fetch", second["job"], "-o", out, "--changed-since", first["generation"]).ok()
        expect(comments(out)["acut-trimmed"] == "changes" and verified(out, path, more), "changes")


def read_ply(path):
    """Lattice numbers (hundredths) of the vertices, and the triangles."""
    with open(path, "rb") as f:
        data = f.read()
    end = data.index(b"end_header\n") + 11
    count = {w[1]: int(w[2]) for w in (l.split() for l in data[:end].decode().splitlines()) if w[0] == "element"}
    at = end + 24 * count["vertex"]
    v = struct.unpack("<%dd" % (3 * count["vertex"]), data[end:at])
    points = [(round(v[i] * 100), round(v[i + 1] * 100)) for i in range(0, len(v), 3)]
    return points, [struct.unpack_from("<B3I", data, at + 13 * i)[1:] for i in range(count["face"])]


def trimmed(points, faces, limit):
    """The faces that no path from outside reaches that crosses only edges longer than `limit` hundredths."""
    beside = {}
    for n, t in enumerate(faces):
        for a, b in zip(t, t[1:] + t[:1]):
            (ax, ay), (bx, by) = points[a], points[b]
            if (ax - bx) ** 2 + (ay - by) ** 2 > limit ** 2:
                beside.setdefault((min(a, b), max(a, b)), []).append(n)
    ways = {}
    for pair in beside.values():
        for n in pair:
            ways.setdefault(n, []).extend(m for m in pair if m != n)
    todo = [pair[0] for pair in beside.values() if len(pair) == 1]
    gone = set(todo)
    while todo:
        for m in ways[todo.pop()]:
            if m not in gone:
                gone.add(m)
                todo.append(m)
    return [t for n, t in enumerate(faces) if n not in gone]


def places(points, faces):
    return sorted(tuple(sorted(points[v] for v in t)) for t in faces)


def nothing_left():
    """An area in degrees beside a mesh in metres leaves nothing: that is said."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "s", survey(base, 1, "s.xyz")).ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        with open(base + "/degrees.geojson", "w") as f:
            f.write('{"type": "Polygon", "coordinates": [[[14, 48], [16, 48], [16, 49], [14, 48]]]}')
        for words in (("--mask", base + "/degrees.geojson"), ("--max-edge", "0.0001")):
            r = d.ctl("fetch", job, "-o", base + "/none.ply", *words).ok()
            expect("no triangle is left" in r.err and ("in degrees" in r.err) == (words[0] == "--mask"), r.err)
        r = d.ctl("fetch", job, "--format", "null", "--erase", base + "/degrees.geojson", "--json").ok()
        expect("no triangle" not in r.out and r.json()["left_out"]["triangles"] == 0, r.out)


def hull_is_trimmed():
    """A survey around a bay, with a lake and a roof: the bay opens, lake and roof stay closed; whatever the memory, threads, order."""
    with e2e.Folder() as base:
        rng, names = random.Random(7), [base + "/%d.xyz" % i for i in range(4)]
        files = [open(n, "w") for n in names]
        for i in range(150000):
            x, y = rng.randrange(100000), rng.randrange(100000)
            bay = x > 40000 and 35000 < y < 65000
            lake = (x - 20000) ** 2 + (y - 80000) ** 2 < 10000 ** 2
            roof = 10000 < x < 14000 and 10000 < y < 13000
            if not bay and not lake and not roof:
                files[i % 4].write("%d.%02d %d.%02d 5\n" % (x // 100, x % 100, y // 100, y % 100))
        for f in files:
            f.close()
        got, part, whole = [], base + "/part.ply", base + "/whole.ply"
        for memory, threads, order in (("24M", 1, names), ("1G", 4, names[::-1])):
            with e2e.Daemon(base, memory=memory, threads=threads) as d:
                j = d.ctl("mesh", *order, "-o", part, "--canonical", "--trim-hull", "20", "--json").ok().json()
                d.ctl("mesh", *order, "-o", whole, "--canonical", "--json").ok()
                expect(memory != "24M" or j["domains"] > 3, "%d domains" % j["domains"])
                with open(part, "rb") as f:
                    got.append(f.read())
        expect(got[0] == got[1], "other bytes with other memory, threads and order")
        points, faces = read_ply(whole)
        kept = trimmed(points, faces, 2000)
        expect(read_ply(part)[1] == kept, "not what flooding from outside leaves")
        expect(j["left_out"]["triangles"] == len(faces) - len(kept) and j["left_out"]["area"] is None, str(j["left_out"]))
        left = set(faces) - set(kept)
        expect(all(not 0 < (sum(points[v][0] for v in t) / 3 - 20000) ** 2 + (sum(points[v][1] for v in t) / 3 - 80000) ** 2 < 9000 ** 2
                   for t in left), "the lake is open")
        expect(comments(part)["acut-trimmed"] == "trim-hull=20" and verified(part, *names), "the file")
        with e2e.Daemon(base) as d:
            # With --max-edge, both rules hold; tiles together are the whole; without an output it is counted.
            d.ctl("mesh", *names, "-o", part, "--canonical", "--trim-hull", "20", "--max-edge", "60").ok()
            short = [t for t in kept if all((points[a][0] - points[b][0]) ** 2 + (points[a][1] - points[b][1]) ** 2 <= 6000 ** 2
                                            for a, b in zip(t, t[1:] + t[:1]))]
            expect(read_ply(part)[1] == short and len(short) < len(kept) and verified(part), "with --max-edge")
            d.ctl("mesh", *names, "-o", base + "/d.tif", "--cell", "5", "--trim-hull", "20", "--max-edge", "60").ok()
            with open(base + "/d.tif", "rb") as f:
                said = f.read(8192).decode(errors="replace")
            expect("acut-trimmed max-edge=60 trim-hull=20\nacut-digest " + comments(part)["acut-digest"] in said, "the raster's description")
            d.ctl("mesh", *names, "-o", base + "/tiles", "--tile", "300", "--trim-hull", "20").ok()
            tiles = [read_ply(t) for t in glob.glob(base + "/tiles/*.ply")]
            expect(sorted(x for t in tiles for x in places(*t)) == places(points, kept), "the tiles together")
            null = d.ctl("mesh", *names, "--format", "null", "--trim-hull", "20", "--json").ok().json()
            expect(null["left_out"] == j["left_out"], str(null["left_out"]))
            d.ctl("push", "d", *names).ok()
            job = d.ctl("submit", "d", "--wait", "--json").ok().json()["job"]
            for words, said in ((["--bbox", "0,0,500,500"], "needs a whole mesh"), (["--changed-since", "1"], "needs a whole mesh"),
                                (["--resume"], "--trim-hull decides at the end")):
                r = d.ctl("fetch", job, "-o", base + "/no.ply", "--trim-hull", "20", *words)
                expect(r.status == 2 and said in r.err, "%s: %d %s" % (words, r.status, r.err))
            window = d.ctl("submit", "d", "--wait", "--json", "--bbox", "0,0,500,500").ok().json()["job"]
            r = d.ctl("fetch", window, "-o", base + "/no.ply", "--trim-hull", "20")
            expect(r.status == 2 and "a window of a mesh does not have" in r.err, r.err)


AREAS = {  # hundredths; the corners are near enough to the points that centroids are on edges
    "a.geojson": [[[(10000, 10000), (70000, 12000), (70000, 70000), (40000, 50000), (10000, 70000)],
                   [(20000, 20000), (30000, 20000), (30000, 30000), (20000, 30000)]], [[(80000, 80000), (99000, 80000), (90000, 99000)]]],
    "b.wkt": [[[(50000, 5000), (95000, 5000), (95000, 60000), (50000, 60000)]]],
    "c.geojson": [[[(60000, 20000), (85000, 45000), (60000, 70000), (35000, 45000)]]],
}


def write_areas(base):
    def text(x, y, between):
        return "%d.%02d%s%d.%02d" % (x // 100, x % 100, between, y // 100, y % 100)

    for name, polygons in AREAS.items():
        with open(os.path.join(base, name), "w") as f:
            if name.endswith(".wkt"):
                f.writelines("POLYGON (%s)\n" % ",".join("(%s)" % ",".join(text(x, y, " ") for x, y in ring + ring[:1]) for ring in rings)
                             for rings in polygons)
            else:
                f.write('{"type":"FeatureCollection","features":[%s]}' % ",".join(
                    '{"type":"Feature","properties":null,"geometry":{"type":"Polygon","coordinates":[%s]}}' % ",".join(
                        "[%s]" % ",".join("[%s]" % text(x, y, ",") for x, y in ring + ring[:1]) for ring in rings) for rings in polygons))


def inside(name, x3, y3):
    """x3 and y3 are three times a centroid: an area has its borders to the left and below."""
    def ring_has(ring):
        odd = False
        for (ax, ay), (bx, by) in zip(ring, ring[1:] + ring[:1]):
            if (3 * ay <= y3) != (3 * by <= y3):
                side = (x3 - 3 * ax) * (by - ay) - (bx - ax) * (y3 - 3 * ay)  # both sides times by - ay
                odd ^= side < 0 if by > ay else side > 0
        return odd
    return any(ring_has(rings[0]) and not any(map(ring_has, rings[1:])) for rings in AREAS[name])


def masks_and_erasures():
    """What lies inside or outside of polygons, whatever the memory, threads and order, with tiles and the other rules."""
    with e2e.Folder() as base:
        write_areas(base)
        rng, names = random.Random(8), [base + "/%d.xyz" % i for i in range(3)]
        files = [open(n, "w") for n in names]
        for i in range(60000):
            # a coarse grid in one corner, where centroids lie on borders
            x, y = (250 * rng.randrange(400), 250 * rng.randrange(400)) if i % 2 else (rng.randrange(100000), rng.randrange(100000))
            files[i % 3].write("%d.%02d %d.%02d 5\n" % (x // 100, x % 100, y // 100, y % 100))
        for f in files:
            f.close()
        cut = ["--mask", base + "/a.geojson", "--mask", base + "/b.wkt", "--erase", base + "/c.geojson"]
        got, part, whole, rest = [], base + "/part.ply", base + "/whole.ply", base + "/rest.ply"
        for memory, threads, order in (("24M", 1, names), ("1G", 4, names[::-1])):
            with e2e.Daemon(base, memory=memory, threads=threads) as d:
                j = d.ctl("mesh", *order, "-o", part, "--canonical", *cut, "--json", "--assume-units", "m").ok().json()
                d.ctl("mesh", *order, "-o", whole, "--canonical").ok()
                expect(memory != "24M" or j["domains"] > 1, "%d domains" % j["domains"])
                with open(part, "rb") as f:
                    got.append(f.read())
        expect(got[0] == got[1], "other bytes with other memory, threads and order")
        points, faces = read_ply(whole)
        middle = {t: (sum(points[v][0] for v in t), sum(points[v][1] for v in t)) for t in faces}
        of = {name: {t for t in faces if inside(name, *middle[t])} for name in AREAS}
        kept = [t for t in faces if (t in of["a.geojson"] or t in of["b.wkt"]) and t not in of["c.geojson"]]
        expect(all(of.values()) and read_ply(part)[1] == kept, "not what is inside of a or b and outside of c")
        expect(any(x == 60000 * 3 or y == 60000 * 3 for x, y in middle.values()), "no centroid is on a border")
        left = set(faces) - set(kept)
        area = sum(abs((points[b][0] - points[a][0]) * (points[c][1] - points[a][1]) - (points[c][0] - points[a][0]) * (points[b][1] - points[a][1]))
                   for a, b, c in left) / 2e4
        expect(j["left_out"]["triangles"] == len(left) and abs(j["left_out"]["area"] - area) < 1e-6 * area, str(j["left_out"]))
        expect(j["left_out"]["mask"]["files"] == cut[1:4:2] and j["left_out"]["erase"]["files"] == cut[5:], str(j["left_out"]))
        said = "mask=%s erase=%s" % (j["left_out"]["mask"]["digest"], j["left_out"]["erase"]["digest"])
        expect(comments(part)["acut-trimmed"] == said and verified(part, *names)["trimmed"], comments(part)["acut-trimmed"])
        with e2e.Daemon(base) as d:
            # One area as mask and as erasure: the whole.
            d.ctl("mesh", *names, "-o", part, "--canonical", "--mask", base + "/a.geojson").ok()
            r = d.ctl("mesh", *names, "-o", rest, "--canonical", "--erase", base + "/a.geojson").ok()
            expect("triangles inside of " + base + "/a.geojson were left out" in r.out + r.err, r.out + r.err)
            expect(set(read_ply(part)[1]) == of["a.geojson"] and sorted(read_ply(part)[1] + read_ply(rest)[1]) == sorted(faces), "two parts")
            expect(comments(part)["acut-trimmed"][5:] == comments(rest)["acut-trimmed"][6:], "one area, two digests")
            # Tiles together; the other rules, which see the whole mesh.
            d.ctl("mesh", *names, "-o", base + "/tiles", "--tile", "300", *cut).ok()
            tiles = glob.glob(base + "/tiles/*.ply")
            expect(sorted(x for t in tiles for x in places(*read_ply(t))) == places(points, kept) and all(verified(t) for t in tiles), "tiles")
            d.ctl("mesh", *names, "-o", part, "--canonical", "--trim-hull", "7", "--max-edge", "9", *cut).ok()
            hull = set(trimmed(points, faces, 700))
            want = [t for t in kept if t in hull and all((points[a][0] - points[b][0]) ** 2 + (points[a][1] - points[b][1]) ** 2 <= 900 ** 2
                                                         for a, b in zip(t, t[1:] + t[:1]))]
            expect(read_ply(part)[1] == want and 0 < len(want) < len(kept) and verified(part), "with the other rules")
            expect(comments(part)["acut-trimmed"] == "max-edge=9 trim-hull=7 " + said, comments(part)["acut-trimmed"])
            # Windows and changes are cut as well.
            d.ctl("push", "d", *names[:2]).ok()
            d.ctl("submit", "d", "--wait").ok()
            d.ctl("push", "d", names[2]).ok()
            job = d.ctl("submit", "d", "--wait", "--json").ok().json()["job"]
            d.ctl("fetch", job, "-o", part, "--canonical", "--bbox", "300,300,500,500", *cut).ok()
            expect(set(places(*read_ply(part))) < set(places(points, kept)) and verified(part), "a window")
            d.ctl("fetch", job, "-o", part, "--changed-since", "1", *cut).ok()
            expect(set(places(*read_ply(part))) <= set(places(points, kept)) and read_ply(part)[1] and verified(part), "changes")
            for words, status, said in ((["--mask", base + "/none"], 74, "the area cannot be read"),
                                        (["--erase", names[0]], 1, "where POLYGON or MULTIPOLYGON should be"),
                                        (["--mask", base], 1, "not a file"), (["--mask"], 2, "--mask needs a value")):
                r = d.ctl("fetch", job, "-o", base + "/no.ply", *words)
                expect(r.status == status and said in r.err and not os.path.exists(base + "/no.ply"), "%s: %d %s" % (words, r.status, r.err))


main(says_what_it_is, nothing_left, masks_and_erasures, windows_tiles_changes, hull_is_trimmed)
