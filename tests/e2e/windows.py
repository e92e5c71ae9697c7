"""Windows: --bbox and --polygon give the triangles of the whole mesh that meet an area. CGAL's whole triangulation is compared
triangle by triangle; reading is counted in cells and records, not in time."""
import os
import random
import struct
import subprocess

import e2e
from e2e import expect

ORACLE = os.environ.get("CGAL_DIGEST")
ALL = ("--keep-withheld", "--keep-noise")


def synth(base, distribution, points, *options):
    path = os.path.join(base, distribution + ".las")
    e2e.run([e2e.SYNTH, "--distribution", distribution, "--points", points, "--seed", 5, "--origin", "0,0", *options, path]).ok()
    return path


def box_of(path):
    """Raw numbers of a file whose offsets are zero, and the scale."""
    with open(path, "rb") as f:
        head = f.read(227)
    scale = struct.unpack_from("<d", head, 131)[0]
    x1, x0, y1, y0 = struct.unpack_from("<4d", head, 179)
    return [round(v / scale) for v in (x0, y0, x1, y1)], scale


def decimal(n, scale):
    """Exact: scales are powers of ten."""
    digits = round(-__import__("math").log10(scale))
    sign, n = ("-" if n < 0 else ""), str(abs(n)).rjust(digits + 1, "0")
    return sign + (n[:-digits] + "." + n[-digits:] if digits else n)


def geojson(path, rings, scale):
    with open(path, "w") as f:
        f.write('{"type": "Polygon", "coordinates": [%s]}' % ", ".join(
            "[" + ", ".join("[%s, %s]" % (decimal(x, scale), decimal(y, scale)) for x, y in ring + ring[:1]) + "]" for ring in rings))
    return path


def corners(box):
    x0, y0, x1, y1 = box
    points = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return [p for i, p in enumerate(points) if p not in points[:i]]


def boxes(rng, box):
    """Boxes in the data, small and large; a point; a segment; over the border; outside; all."""
    x0, y0, x1, y1 = box
    w, h = x1 - x0, y1 - y0

    def some(part):
        x, y = x0 + rng.randrange(w), y0 + rng.randrange(h)
        return [x, y, x + int(w * part), y + int(h * part)]

    out = [some(.02), some(.1), some(.1), some(.3), [x0 - 5, y0 + h // 3, x0 + w // 9, y0 + h // 2]]
    x, y = x0 + w // 2, y0 + h // 2
    return out + [[x, y, x, y], [x, y0 + h // 4, x, y], [x0 + w // 8, y, x, y], [x1 + 10, y1 + 10, x1 + 999, y1 + 999],
                  [x0 - 9, y0 - 9, x1 + 9, y1 + 9]]


def polygons(rng, box):
    x0, y0, x1, y1 = box
    w, h = x1 - x0, y1 - y0
    star = []
    for i in range(9):
        far = .35 if i % 2 else .08
        c, s = [(1, 0), (.77, .64), (.17, .98), (-.5, .87), (-.94, .34), (-.94, -.34), (-.5, -.87), (.17, -.98), (.77, -.64)][i]
        star.append((x0 + w // 2 + int(w * far * c), y0 + h // 2 + int(h * far * s)))
    strip = [(x0, y0), (x0 + w // 90, y0), (x1, y1 - h // 90), (x1, y1)]
    x, y = x0 + rng.randrange(w), y0 + rng.randrange(h)
    return [star, strip, [(x, y), (x + 3, y + 1), (x + 1, y + 4)]]


def against_cgal(distribution, points, *options):
    def run():
        if not ORACLE:
            return
        rng = random.Random(distribution)
        with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
            path = synth(base, distribution, points, *options)
            box, scale = box_of(path)
            d.ctl("push", "d", path).ok()
            whole = d.ctl("submit", "d", "--wait", "--json", *ALL).ok().json()
            windows = [(corners(b), ["--bbox=" + ",".join(decimal(v, scale) for v in b)]) for b in boxes(rng, box)]
            for i, p in enumerate(polygons(rng, box)):
                windows.append((p, ["--polygon", geojson(os.path.join(base, "%d.json" % i), [p], scale)]))
            lines = subprocess.run([ORACLE, path] + [",".join("%d,%d" % c for c in p) for p, _ in windows],
                                   stdout=subprocess.PIPE, check=True).stdout.decode().splitlines()
            expect(lines[0].split() == [str(whole["triangles"]), whole["digest"]], "the whole: %s" % lines[0])
            pieces = 0
            for (p, options_of), line in zip(windows, lines[1:]):
                got = d.ctl("submit", "d", "--wait", "--json", *ALL, *options_of).ok().json()
                expect(line.split() == [str(got["triangles"]), got["digest"]],
                       "%s: %d triangles %s, CGAL has %s" % (options_of, got["triangles"], got["digest"], line))
                again = d.ctl("fetch", whole["job"], "--json", "--format", "null", *options_of).ok().json()
                expect(again["digest"] == got["digest"] and again["vertex_digest"] == got["vertex_digest"], "fetched: %s" % again)
                expect(got["hull"] is None and got["used"] is None and again["removed"] is None, str(got))
                pieces = max(pieces, got["pieces"])
            print("     %d windows, %d pieces at most, %d triangles" % (len(windows), pieces, whole["triangles"]))
            expect(points < 80000 or pieces > 2, "%d pieces" % pieces)
            peak = d.vmhwm()
            expect(peak <= (24 + 32) << 20, "VmHWM %d with memory=24M" % peak)
    run.__name__ = "cgal_" + distribution.replace("-", "_")
    return run


def read_ply(path):
    """Triangles as sets of three positions, heights with them."""
    with open(path, "rb") as f:
        data = f.read()
    end = data.index(b"end_header\n") + 11
    count = {w[1]: int(w[2]) for w in (l.split() for l in data[:end].decode().splitlines()) if w[0] == "element"}
    at = end + 24 * count["vertex"]
    v = struct.unpack("<%dd" % (3 * count["vertex"]), data[end:at])
    out = set()
    for i in range(count["face"]):
        n, a, b, c = struct.unpack_from("<B3i", data, at + 13 * i)
        t = [v[3 * k:3 * k + 3] for k in (a, b, c)]
        k = t.index(min(t))
        out.add(tuple(t[k:] + t[:k]))
    expect(len(out) == count["face"], "a triangle twice in %s" % path)
    return out


def meets(t, box):
    """On doubles of whole numbers below 2^53: exact."""
    xs, ys = [p[0] for p in t], [p[1] for p in t]
    if max(xs) < box[0] or min(xs) > box[2] or max(ys) < box[1] or min(ys) > box[3]:
        return False
    for i in range(3):
        (ax, ay, _), (bx, by, _) = t[i], t[(i + 1) % 3]
        if all((bx - ax) * (y - ay) - (by - ay) * (x - ax) < 0 for x in box[::2] for y in box[1::2]):
            return False
    return True


def survey(base, n, seed=1, span=4096):
    """Whole numbers, with duplicates, classes and a lake."""
    rng = random.Random(seed)
    path = os.path.join(base, "s%d.xyz" % seed)
    with open(path, "w") as f:
        f.write("x y z c\n")
        for _ in range(n):
            x, y = rng.randrange(span), rng.randrange(span)
            if (x - 1500) ** 2 + (y - 2500) ** 2 > 900 ** 2:
                f.write("%d %d %d %d\n" % (x, y, rng.randrange(500), rng.choice((1, 2, 2, 5))))
    return path


def partition():
    """The windows of a partition of the plane, joined, are the whole mesh; each is a filter of the whole. Also for views with and
    without a selection, and after a second push: several segments, heights of duplicates."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        out = os.path.join(base, "m.ply")
        for seed in (1, 2):
            d.ctl("push", "d", survey(base, 9000, seed)).ok()
        for view in ([], ["--class", "2", "--duplicates", "highest"], ["--every", "3"], ["--crop", "300,200,3900,3000"],
                     ["--thin", "90"]):
            whole = d.ctl("submit", "d", "--wait", "--json", *view).ok().json()
            d.ctl("fetch", whole["job"], "-o", out).ok()
            triangles, seen = read_ply(out), set()
            cuts = [(-9, 1000), (1000, 1001), (1002, 2500), (2500, 9999)]
            for x0, x1 in cuts:
                for y0, y1 in cuts:
                    box = (x0, y0, x1, y1)
                    d.ctl("fetch", whole["job"], "--bbox=%d,%d,%d,%d" % box, "-o", out).ok()
                    part = read_ply(out)
                    expect(part == {t for t in triangles if meets(t, box)}, "%s of %s: %d triangles" % (box, view, len(part)))
                    seen |= part
            rest = [t for t in triangles - seen if not all(1001 < p[0] < 1002 or 1001 < p[1] < 1002 for p in t)]
            expect(seen == triangles, "%d of %d triangles, %s" % (len(seen), len(triangles), rest[:3]))


def reads():
    """The reading of a window depends on its size, not on that of the dataset: also over a lake, beside a corridor and far from
    all data."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d:
        d.ctl("push", "d", survey(base, 300000, span=40960)).ok()
        side, points = 40960, d.ctl("datasets", "--json").ok().json()["points"]
        for box, most in ([18000, 30000, 22096, 34096], .06), ([20000, 20000, 20000, 20000], .03), ([1400, 2400, 1600, 2600], .03):
            got = d.ctl("submit", "d", "--wait", "--json", "--bbox=" + ",".join(map(str, box))).ok().json()
            print("     %s: %d of %d records in %d cells, %d triangles" % (box, got["points_read"], points, got["cells_read"], got["triangles"]))
            expect(got["triangles"] and got["points_read"] < most * points, str(got))
            expect(got["cells_read"] < 2 * got["points_read"] / 256 + 4, "%d cells" % got["cells_read"])
        got = d.ctl("submit", "d", "--wait", "--json", "--bbox=%d,0,%d,50" % (side + 10, side + 90)).ok().json()
        expect(got["triangles"] == 0 and got["cells_read"] == 0 and "no triangle" in got["notes"][0], str(got))
        d.ctl("push", "c", synth(base, "corridor-diagonal", 60000)).ok()
        box, scale = box_of(os.path.join(base, "corridor-diagonal.las"))
        w, h = box[2] - box[0], box[3] - box[1]
        middle = [box[0] + w // 2 - w // 200, box[1] + h // 2 - h // 200, box[0] + w // 2 + w // 200, box[1] + h // 2 + h // 200]
        got = d.ctl("submit", "c", "--wait", "--json", "--bbox=" + ",".join(decimal(v, scale) for v in middle)).ok().json()
        print("     corridor: %d of 60000 records in %d cells" % (got["points_read"], got["cells_read"]))
        expect(got["triangles"], str(got))


def jobs():
    """The same area is the same job; a window of a job that waits; one step; refusals."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M", threads=1) as d:
        path, out = survey(base, 20000), os.path.join(base, "m.ply")
        d.ctl("push", "d", path).ok()
        one = d.ctl("submit", "d", "--wait", "--json", "--bbox=100,100,900,900").ok().json()
        expect(" window=box:100,100,900,900" in one["view"], one["view"])
        expect(d.ctl("submit", "d", "--bbox", "100.0,1e2,900,900").ok().out.split() == [str(one["job"])], "another job")
        expect(d.ctl("submit", "d", "--bbox", "100,100,900,901").ok().out.split() != [str(one["job"])], "the same job")
        expect(d.ctl("submit", "d", "--new", "--bbox", "100,100,900,900").ok().out.split() != [str(one["job"])], "the same job")
        same = d.ctl("mesh", path, "--bbox", "100,100,900,900", "--json", "-o", out).ok().json()
        expect((same["digest"], same["pieces"]) == (one["digest"], 1), str(same))
        wkt = os.path.join(base, "a.wkt")
        with open(wkt, "w") as f:
            f.write("POLYGON((100 100, 900 100, 900 900, 100 900, 100 100), (200 200, 300 200, 300 300, 200 200))")
        holed = d.ctl("mesh", path, "--polygon", wkt, "--crop", "0,0,2000,2000", "--json", "-o", out).ok().json()
        expect(0 < holed["triangles"] < one["triangles"], str(holed))
        for i in range(3):
            d.ctl("submit", "d", "--every", str(2 + i), "--priority", "low").ok()
        last = d.ctl("submit", "d", "--every", "9").ok().out.strip()
        got = d.ctl("fetch", last, "--bbox", "100,100,900,900", "--json", "-o", out).ok().json()
        expect(got["triangles"] > 0 and got["pieces"] == 1 and got["domains"] is None, str(got))
        plan = d.ctl("plan", "d", "--bbox", "100,100,900,900", "--json").ok().json()
        expect(plan["domains"] == 1 and plan["points"] < 20000 and plan["disk_bytes"] == 0, str(plan))
        for words, text in ((["--bbox", "9,9,1,1"], "empty"), (["--bbox", wkt], "--polygon takes a file"),
                            (["--bbox", "1,1,2,2", "--polygon", wkt], "two areas"), (["--polygon", out], "a.wkt" and "polygon")):
            r = d.ctl("submit", "d", *words)
            expect(r.status in (1, 2) and text in r.err, "%s: %d %s" % (words, r.status, r.err))
        r = d.ctl("fetch", one["job"], "--bbox", "1,1,2,2", "-o", out)
        expect(r.status == 2 and "window already" in r.err, r.err)
        r = d.ctl("fetch", one["job"], "-o", out)
        expect(r.status == 0 and len(read_ply(out)) == one["triangles"], r.err)


if __name__ == "__main__":
    e2e.main(against_cgal("swath", 80000), against_cgal("corridor-diagonal", 40000), against_cgal("gaussians", 30000),
             against_cgal("two-clusters", 20000), against_cgal("ring", 10000, "--range", 100000), against_cgal("grid", 10000), partition, reads, jobs)
