"""--tile: every triangle of the mesh is in exactly one file, and all files joined by position are the mesh again, with heights.
The tiles do not depend on the memory. The index comes last. Nothing appears after a failure."""
import json
import os
import signal
import struct
import subprocess
import time
from fractions import Fraction

import e2e
from e2e import Daemon, Folder, expect

POINTS = 40000


def survey(base, points=POINTS, name="survey.las", seed=3):
    path = os.path.join(base, name)
    e2e.run([e2e.SYNTH, "--points", str(points), "--seed", str(seed), path]).ok()
    return path


def rotated(t):
    return min(t, t[1:] + t[:1], t[2:] + t[:2])


def read_ply(path):
    """Positions as their 24 bytes, triangles as three of them from the smallest on."""
    with open(path, "rb") as f:
        data = f.read()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    head = data[:end].decode()
    nv, nf = (int(l.split()[2]) for l in head.split("\n") if l.startswith("element"))
    vertex = [data[end + 24 * i:end + 24 * i + 24] for i in range(nv)]
    at = end + 24 * nv
    faces = struct.iter_unpack("<Biii", data[at:at + 13 * nf])
    expect(len(data) == at + 13 * nf, path + ": size")
    triangles = [rotated((vertex[a], vertex[b], vertex[c])) for n, a, b, c in faces if n == 3]
    digest = [l.split()[2:] for l in head.split("\n") if l.startswith("comment acut-digest")]
    return vertex, triangles, digest[0]


def read_obj(path):
    vertex, triangles = [], []
    with open(path) as f:
        for line in f:
            word = line.split()
            if word[0] == "v":
                vertex.append(tuple(word[1:]))
            elif word[0] == "f":
                triangles.append(rotated(tuple(vertex[int(w) - 1] for w in word[1:])))
    return vertex, triangles, None


def index_of(folder):
    with open(os.path.join(folder, "index.geojson")) as f:
        return json.load(f, parse_float=Fraction)


def sum_of(digests):
    values = [int(d, 16) for d in digests]
    mask = (1 << 64) - 1
    return "%016x%016x" % (sum(v >> 64 for v in values) & mask, sum(v & mask for v in values) & mask)


def check_tiles(folder, whole, read, exact=None):
    """The index names all files, and together they have each triangle of the mesh once. `exact` turns a corner into Fractions."""
    index = index_of(folder)
    files = sorted(n for n in os.listdir(folder) if n != "index.geojson")
    listed = [f["properties"] for f in index["features"]]
    expect(files == sorted(p["file"] for p in listed), "%s: not the files of the index" % folder)
    size, seen, positions = Fraction(index["acut"]["size"]), set(), set()
    for p in listed:
        vertex, triangles, digest = read(os.path.join(folder, p["file"]))
        expect(len(set(vertex)) == len(vertex) == p["vertices"], "%s: vertices" % p["file"])
        expect(len(triangles) == p["triangles"] > 0, "%s: triangles" % p["file"])
        expect(digest is None or digest == [p["digest"], p["vertex_digest"]], "%s: digest" % p["file"])
        expect(os.path.getsize(os.path.join(folder, p["file"])) == p["bytes"], "%s: bytes" % p["file"])
        for t in triangles:
            expect(t not in seen, "%s: a triangle is in two tiles" % p["file"])
            seen.add(t)
        positions.update(vertex)
        for t in triangles if exact else ():
            corner = [exact(v) for v in t]
            for axis, number in ((0, p["column"]), (1, p["row"])):
                total = sum(c[axis] for c in corner)
                expect(3 * number * size <= total < 3 * (number + 1) * size, "%s: not its tile" % p["file"])
    vertex, triangles, digest = whole
    expect(seen == set(triangles) and len(seen) == len(triangles), "%s: %d triangles of %d" % (folder, len(seen), len(triangles)))
    # Tiles have the vertices of their triangles: a mesh of collinear positions has vertices and no tile.
    cornered = index["acut"]["left_out"] or not triangles
    expect(positions == (set(c for t in triangles for c in t) if cornered else set(vertex)), "%s: the welded vertices are not those of the mesh" % folder)
    expect(digest is None or sum_of(p["digest"] for p in listed) == digest[0] == index["acut"]["digest"], "sum of digests")
    return index


def twenty_by_twenty():
    with Folder() as base, Daemon(base, memory="24M", threads=2) as d:
        path = survey(base)
        d.ctl("push", "s", path).ok()
        d.ctl("submit", "s", "--wait").ok()
        ply, obj = os.path.join(base, "m.ply"), os.path.join(base, "m.obj")
        d.ctl("fetch", "1", "-o", ply, "-o", obj).ok()
        whole = read_ply(ply)
        xs = [struct.unpack("<d", v[:8])[0] for v in whole[0]]
        side = "%.2f" % ((max(xs) - min(xs)) / 19.5)
        tiles, texts = os.path.join(base, "tiles"), os.path.join(base, "texts")
        got = d.ctl("fetch", "1", "--tile", side, "-o", tiles, "--json").ok().json()
        index = check_tiles(tiles, whole, read_ply)
        columns = {f["properties"]["column"] for f in index["features"]}
        expect(len(columns) >= 20 and got["tiles"]["files"] == len(index["features"]) >= 380, got["tiles"])
        expect(got["tiles"]["index"] == os.path.join(tiles, "index.geojson") and got["tiles"]["size"] == side, got["tiles"])
        expect(index["acut"]["job"] == 1 and index["acut"]["generation"] == 1 and index["acut"]["dataset"] == "s", index["acut"])
        expect(got["output_bytes"] == sum(os.path.getsize(os.path.join(tiles, n)) for n in os.listdir(tiles)), got)
        # Text says the lattice numbers exactly: here the rule of the border is checked too.
        d.ctl("fetch", "1", "--tile", "17.7", "--format", "obj", "-o", texts + "/").ok()
        check_tiles(texts, read_obj(obj), read_obj, exact=lambda v: (Fraction(v[0]), Fraction(v[1])))
        # The same mesh from other domains: the same bytes, and in one step too; what is there is replaced.
        before = {n: open(os.path.join(tiles, n), "rb").read() for n in os.listdir(tiles)}
        other = os.path.join(base, "other")
        os.mkdir(other)
        for name in list(before)[:5]:
            open(os.path.join(other, name), "w").write("old")
        e2e.run([e2e.ACUTCTL, "mesh", "--memory", "256M", path, "--canonical", "--tile=" + side, "-o", other]).ok()
        for name, data in before.items():
            with open(os.path.join(other, name), "rb") as f:
                expect(name == "index.geojson" or f.read() == data, "%s depends on how it was made" % name)
        expect(sorted(os.listdir(other)) == sorted(before), "other files")


def small_ones(d, base, text, *options, read=read_obj, form="obj"):
    small_ones.n += 1
    path, out, whole = (os.path.join(base, "%s%d" % (n, small_ones.n)) for n in ("in.xyz.", "tiles", "whole"))
    path = path.replace(".xyz.", "") + ".xyz"
    with open(path, "w") as f:
        f.write(text)
    whole += "." + form
    d.ctl("mesh", path, "-o", whole, *[o for o in options if not o.startswith("--tile")]).ok()
    run = d.ctl("mesh", path, "-o", out, "--format", form, "--json", *options)
    run.ok()
    return check_tiles(out, read(whole), read, exact=lambda v: (Fraction(v[0]), Fraction(v[1]))), run.json()


small_ones.n = 0


def edges_of_the_rule():
    grid = "".join("%g %g %g\n" % (x, y, x * y) for x in range(-4, 5) for y in range(-4, 5))
    with Folder() as base, Daemon(base, memory="24M", threads=2) as d:
        index, _ = small_ones(d, base, grid, "--tile=3")
        expect({f["properties"]["column"] for f in index["features"]} == {-2, -1, 0, 1}, "negative columns")
        square = next(f for f in index["features"] if f["properties"]["file"] == "tile_-1_0.obj")
        expect(square["geometry"]["coordinates"][0][0] == [-3, 0] and square["geometry"]["coordinates"][0][2] == [0, 3], square)
        index, _ = small_ones(d, base, grid, "--tile=1000000")  # at the corner of four
        expect(len(index["features"]) == 4, "four tiles")
        index, got = small_ones(d, base, "1 1 0\n9 1 0\n1 9 0\n9 9 0.5\n", "--tile=1e1")
        expect(len(index["features"]) == 1 and got["tiles"]["files"] == 1, "one tile")
        index, _ = small_ones(d, base, "0 0 0\n100 0 0\n0 100 0\n100 100.5 1\n", "--tile=0.75")  # smaller than triangles
        expect(len(index["features"]) == 2, "two small tiles")
        # A centroid on the border belongs to the tile above it: (3, 3) of (0, 0), (9, 0), (0, 9).
        index, _ = small_ones(d, base, "0 0 0\n9 0 0\n0 9 0\n", "--tile=3")
        expect([f["properties"]["file"] for f in index["features"]] == ["tile_1_1.obj"], index["features"])
        # Thirds: 100/3 is between 33.3 and 33.4, which doubles of the centroid also say; 1/3 of a millimetre off here.
        index, _ = small_ones(d, base, "0 0 0\n100 0 0\n0 100 0\n", "--tile=33.333333333333333")
        expect([f["properties"]["file"] for f in index["features"]] == ["tile_1_1.obj"], index["features"])
        index, _ = small_ones(d, base, "0 0 0\n100 0 0\n0 100 0\n", "--tile=33.333333333333334")
        expect([f["properties"]["file"] for f in index["features"]] == ["tile_0_0.obj"], index["features"])
        # A point far away, and one that no triangle has: thousands of millions of squares in the box, and few with a triangle.
        index, _ = small_ones(d, base, grid + "9000000.5 9000000 7\n", "--tile=3")
        expect(16 < len(index["features"]) < 60, "%d tiles" % len(index["features"]))
        index, _ = small_ones(d, base, grid + "9000000.5 9000000 7\n", "--tile=3", "--crop=-9,-9,9,9")
        expect(len(index["features"]) == 16, "%d tiles" % len(index["features"]))
        # No point, and points on a line only.
        index, got = small_ones(d, base, "0 0 0\n1 1 1\n2 2 2\n", "--tile=1")
        expect(index["features"] == [] and got["tiles"]["files"] == 0 and index["type"] == "FeatureCollection", index)
        index, got = small_ones(d, base, grid, "--tile=3", "--max-edge=1.2")
        expect(got["left_out"]["triangles"] == 128 == index["acut"]["left_out"] and not index["features"], got["left_out"])
        # Pictures.
        out = os.path.join(base, "pictures")
        with open(os.path.join(base, "g.xyz"), "w") as f:
            f.write(grid)
        d.ctl("mesh", os.path.join(base, "g.xyz"), "--tile=4", "--format=png", "--width=64", "-o", out).ok()
        pictures = [n for n in os.listdir(out) if n.endswith(".png")]
        expect(len(pictures) == 4 == len(index_of(out)["features"]), pictures)
        for n in pictures:
            with open(os.path.join(out, n), "rb") as f:
                expect(f.read(8) == b"\x89PNG\r\n\x1a\n", n)


def refused(run, status, *texts):
    expect(run.status == status, "%d, not %d: %s" % (run.status, status, run.err))
    for text in texts:
        expect(text in run.err, "no %r in %s" % (text, run.err))


def what_cannot_be():
    with Folder() as base, Daemon(base, memory="24M", threads=2) as d:
        path, out = os.path.join(base, "a.xyz"), os.path.join(base, "tiles")
        with open(path, "w") as f:
            f.write("".join("%d %d 0\n" % (x, y) for x in range(30) for y in range(30)))
        d.ctl("push", "s", path).ok()
        d.ctl("submit", "s", "--wait").ok()
        fetch = ["fetch", "1", "--tile=10"]
        refused(d.ctl(*fetch, "-o", "-"), 2, "folder", "standard output")
        refused(d.ctl(*fetch, "-o", out, "-o", out + "2"), 2, "one folder")
        refused(d.ctl(*fetch), 2, "-o")
        refused(d.ctl(*fetch, "-o", out, "--resume"), 2, "sorted at the end", "--resume")
        refused(d.ctl(*fetch, "-o", path), 2, path, "folder")
        refused(d.ctl(*fetch, "-o", out, "--format=null"), 2, "nothing")
        refused(d.ctl(*fetch, "-o", out, "--format=nonsense"), 2, "nonsense")
        refused(d.ctl(*fetch, "-o", out, "--format=png", "--color=domain"), 2, "--color domain")
        refused(d.ctl("fetch", "1", "--tile=0", "-o", out), 2, "--tile")
        refused(d.ctl("fetch", "1", "--tile=-3", "-o", out), 2, "--tile")
        refused(d.ctl("fetch", "1", "--tile=10m", "-o", out), 2, "units of the dataset")
        refused(d.ctl("fetch", "1", "--tile=1e-9", "-o", out), 2, "--tile is too small")
        refused(d.ctl("fetch", "1", "--tile=1e-30", "-o", out), 2, "--tile")
        refused(d.ctl(*fetch, "-o", os.path.join(base, "no", "such")), 74, "cannot be opened")
        many = os.path.join(base, "many.xyz")
        with open(many, "w") as f:
            f.writelines("%d %d 0\n" % (i % 240, i // 240) for i in range(240 * 240))
        refused(d.ctl("mesh", many, "--tile=0.5", "-o", out), 2, "more than 100000 tiles of 0.5", "larger")
        expect(not os.path.exists(out), "a refused fetch made a folder")
        # No clobber: neither an index nor a tile is replaced.
        d.ctl(*fetch, "-o", out).ok()
        refused(d.ctl(*fetch, "-o", out, "--no-clobber"), 2, "--no-clobber")
        os.unlink(os.path.join(out, "index.geojson"))
        refused(d.ctl(*fetch, "-o", out, "--no-clobber"), 2, "--no-clobber", "tile_")
        expect(not os.path.exists(os.path.join(out, "index.geojson")), "an index after a refusal")
        d.ctl(*fetch, "-o", out + "new", "--no-clobber").ok()


def failing():
    with Folder() as base, Daemon(base, memory="24M", threads=2) as d:
        d.ctl("push", "s", survey(base)).ok()
        d.ctl("submit", "s", "--wait").ok()
        old, want = os.path.join(base, "old"), os.path.join(base, "want")
        d.ctl("fetch", "1", "--tile=6", "-o", want).ok()
        names = sorted(os.listdir(want))
        os.mkdir(old)
        for n in names[:3] + ["index.geojson"]:
            open(os.path.join(old, n), "w").write("old")

        def untouched(what, folder=old):
            got = {n: open(os.path.join(folder, n)).read() for n in os.listdir(folder)}
            expect(got == {n: "old" for n in names[:3] + ["index.geojson"]}, "%s: %s" % (what, sorted(got)))

        def start(*prefix, out=old):
            return subprocess.Popen(list(prefix) + [e2e.ACUTCTL, "fetch", "1", "--tile=6", "-o", out],
                                    env=dict(os.environ, ACUT_SOCKET=d.socket), stderr=subprocess.PIPE, text=True)
        # No room: for one file of them, and for what is sorted.
        largest = max(os.path.getsize(os.path.join(want, n)) for n in names)
        for limit in (4096, largest // 2):
            p = start("prlimit", "--fsize=%d" % limit)
            text = p.communicate()[1]
            expect(p.returncode == 74, "%d %s" % (p.returncode, text))
            untouched("no room")
            p = start("prlimit", "--fsize=%d" % limit, out=old + "2")
            p.communicate()
            expect(p.returncode == 74 and not os.path.exists(old + "2"), "a folder after a failure")
        if os.geteuid() == 0:
            small = os.path.join(base, "small")
            os.mkdir(small)
            if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "acut", small], capture_output=True).returncode:
                print("     skipped: no tmpfs can be mounted here")
            else:
                try:
                    inside = os.path.join(small, "tiles")
                    os.mkdir(inside)
                    for n in names[:3] + ["index.geojson"]:
                        open(os.path.join(inside, n), "w").write("old")
                    p = start(out=inside)
                    text = p.communicate()[1]
                    expect(p.returncode == 74, "%d %s" % (p.returncode, text))
                    untouched("full disk", inside)
                finally:
                    subprocess.run(["umount", small], check=True)
        # Interrupted, and killed at several instants.
        for delay, sig in ((0.05, signal.SIGINT), (0.25, signal.SIGTERM), (0.1, signal.SIGKILL), (0.3, signal.SIGKILL)):
            p = start()
            time.sleep(delay)
            p.send_signal(sig)
            p.communicate()
            if p.returncode == 0:
                continue
            left = sorted(os.listdir(old))
            expect(sig == signal.SIGKILL or ".tiles.part" not in left, "left behind by %d: %s" % (sig, left))
            if "index.geojson" in left and open(os.path.join(old, "index.geojson")).read() != "old":
                expect(set(left) - {".tiles.part"} == set(names), "an index without all tiles: %s" % left)
        d.ctl("fetch", "1", "--tile=6", "-o", old).ok()
        expect(sorted(os.listdir(old)) == names, "after a kill: %s" % sorted(os.listdir(old)))
        for n in names:
            with open(os.path.join(old, n), "rb") as a, open(os.path.join(want, n), "rb") as b:
                expect(a.read() == b.read(), n)


e2e.main(twenty_by_twenty, edges_of_the_rule, what_cannot_be, failing)
