"""acut-verify --breaklines and the like: it has snap rounding, areas and the rules of points of its own, and finds the meshes of random
lines good, with every view, window and kind of line; and each damage of such a mesh or of its lines is found, with its place."""
import math
import os
import random
import re
import struct

import breaklines
import e2e
from e2e import expect

ALL = breaklines.ALL


def verify(*args, fault=None):
    """The report; `fault`: the one that must be found."""
    r = e2e.run([e2e.VERIFY, "--json", *args])
    expect(r.status == (1 if fault else 0), "status %d\n%s%s" % (r.status, r.out, r.err))
    got = r.json()
    expect(got["fault"] == fault, "fault %s in place of %s" % (got, fault))
    return got


KIND = {"--breaklines": "hard", "--lakes": "lake", "--boundary": "boundary", "--holes": "hole"}


def push(d, name, path, lines, *options):
    """`lines`: pairs of option and file, as acut-verify takes them."""
    for kind, file in lines:
        d.ctl("push", name, file, "--lines-as", KIND[kind], "--scale", "1", *options).ok()
    d.ctl("push", name, path).ok()


def check(d, name, path, lines, *view, more=()):
    """The mesh of a view, verified with its points and lines."""
    out = os.path.join(d.base, "v.ply")
    if os.path.exists(out):
        os.unlink(out)
    job = d.ctl("submit", name, "--wait", "--json", *ALL, *view).ok().json()["job"]
    made = d.ctl("show", job, "--json").ok().json()
    d.ctl("fetch", job, "-o", out).ok()
    got = verify(*[w for l in lines for w in l], *more, "--view", made["view"], out, path)
    whole = "--bbox" not in view
    expect(not whole or all(got["removed"][k] == made["removed"].get(k, 0) for k in ("line", "area")), "%s %s" % (got, made))
    return got


def tiny():
    """Crossings everywhere, two heights, and views."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        for seed in range(20):
            rng = random.Random(1000 + seed)
            size = rng.choice([4, 7, 12, 30, 200])
            points = {(rng.randrange(size), rng.randrange(size)) for _ in range(rng.randrange(4, 120))} | {(0, 0), (size, 0), (0, size)}
            parts = breaklines.random_lines(rng, size, rng.randrange(2, 14))
            if len(parts) < 2:
                continue
            path = breaklines.points_file(base, points)
            lines = [("--breaklines", breaklines.lines_file(base, "%d.csv" % i, half, z=5 + 3 * i)) for i, half in enumerate((parts[::2], parts[1::2]))]
            push(d, "s%d" % seed, path, lines)
            for view in ((), ("--duplicates", "highest"), ("--breakline-clear", "1"), ("--crop", "0,0,%d,%d" % (size // 2, size)),
                         ("--thin", "3"), ("--every", "2"), ("--bbox", "%d,0,%d,%d" % (size // 3, size // 2, size // 2))):
                check(d, "s%d" % seed, path, lines, *view)


def ring(rng, x, y, r, n=7):
    """A ring around a place, which does not cross itself."""
    at = sorted((rng.random() for _ in range(n)))
    return [(round(x + r * rng.uniform(0.5, 1) * math.cos(6.2832 * t)), round(y + r * rng.uniform(0.5, 1) * math.sin(6.2832 * t))) for t in at]


def areas():
    """Lakes with islands, boundaries and holes that overlap each other, some of them at the hull or beyond all points."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        ends = 0
        for seed in range(20):
            rng = random.Random(2000 + seed)
            size = rng.choice([20, 60, 300])
            points = {(rng.randrange(size), rng.randrange(size)) for _ in range(rng.randrange(50, 400))} | {(0, 0), (size, 0), (0, size)}
            some = lambda most: ring(rng, rng.randrange(size), rng.randrange(size), rng.randrange(3, most))
            path = breaklines.points_file(base, points)
            lines = [("--breaklines", breaklines.lines_file(base, "hard.csv", breaklines.random_lines(rng, size, 6) or [(False, [(0, 0), (9, 9)])]))]
            lines.append(("--lakes", breaklines.lakes_file(base, "lakes.json", [[some(size // 2), some(size // 4)] for _ in range(3)])))
            if seed % 2:
                lines.append(("--boundary", breaklines.lines_file(base, "boundary.csv", [(True, some(size)) for _ in range(2)])))
            if seed % 4 > 1:
                lines.append(("--holes", breaklines.lines_file(base, "holes.csv", [(True, some(size // 3)) for _ in range(2)])))
            push(d, "a%d" % seed, path, lines)
            for view in ((), ("--duplicates", "highest"), ("--breakline-clear", "2"), ("--crop", "0,0,%d,%d" % (size // 2, size)),
                         ("--bbox", "%d,0,%d,%d" % (size // 3, size // 2, size // 2))):
                got = check(d, "a%d" % seed, path, lines, *view)
                ends += got["trimmed"]
        expect(ends > 50, "%d meshes that end at boundaries or holes" % ends)


def many_domains():
    """Enough positions for several domains, points along the lines, and lakes whose level is chosen."""
    rng = random.Random(31)
    size = 3000
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        path = breaklines.points_file(base, breaklines.survey(rng, size, 60000))
        hard = [(False, [(rng.randrange(size), rng.randrange(size)) for _ in range(3)]) for _ in range(40)]
        lines = [("--breaklines", breaklines.lines_file(base, "hard.csv", hard))]
        lakes = os.path.join(base, "lakes.csv")
        with open(lakes, "w") as f:
            f.write("x,y,z,name\n")
            for i in range(5):
                at = ring(rng, 300 + 500 * i, 1500, 200, 30)
                f.writelines("%d,%d,%d,%d\n" % (*p, 5 + k % 4, i) for k, p in enumerate(at + at[:1]))
        for level in ("min", "max", "mean"):
            push(d, level, path, lines, "--densify", "7.5")
            push(d, level, path, [("--lakes", lakes)], "--densify", "7.5", "--lake-level", level)
            got = check(d, level, path, lines + [("--lakes", lakes)], more=("--densify", "7.5", "--lake-level", level))
            expect(got["lines"]["found"] == got["lines"]["pieces"] > 8000, str(got["lines"]))


class Ply:
    """A mesh with marked edges, to be damaged."""

    def __init__(self, path):
        with open(path, "rb") as f:
            data = f.read()
        end = data.index(b"end_header\n") + 11
        self.head = data[:end].decode()
        count = lambda word: int(re.search("element %s (\\d+)" % word, self.head).group(1))
        n, self.n = count("vertex"), count("face")
        self.vertex = [struct.unpack_from("<3d", data, end + 24 * i) for i in range(n)]
        kind = "<B3iH" if "ushort edges" in self.head else "<B3i"
        self.face = [list(f[1:]) for f in struct.iter_unpack(kind, data[end + 24 * n:])]

    def sides(self):
        """Of both triangles of each inner edge: (number, corner across from it)."""
        seen = {}
        for t, f in enumerate(self.face):
            for k in range(3):
                seen.setdefault(frozenset((f[(k + 1) % 3], f[(k + 2) % 3])), []).append((t, k))
        return [s for s in seen.values() if len(s) == 2]

    def marked(self, side):
        return self.face[side[0]][3] >> side[1] & 1

    def write(self, path):
        with open(path, "wb") as f:
            f.write(self.head.replace("element face %d" % self.n, "element face %d" % len(self.face)).encode())
            f.write(b"".join(struct.pack("<3d", *v) for v in self.vertex) + b"".join(struct.pack("<B3iH", 3, *f) for f in self.face))


def in_a_part(ply):
    """Two vertices with an edge between them, which they do not share; a corner of a triangle and a place in it."""
    at = lambda v: tuple(map(round, ply.vertex[v][:2]))
    turn = breaklines.breakline_model.turn
    for t, f in enumerate(ply.face):
        a, b, c = map(at, f[:3])
        inside = next(((x, y) for x in range(200) for y in range(200) if turn(a, b, (x, y)) > 0 and turn(b, c, (x, y)) > 0 and turn(c, a, (x, y)) > 0), None)
        if inside:
            break
    for (t, k), (u, l) in ply.sides():
        p, q, a, b = map(at, (ply.face[t][(k + 1) % 3], ply.face[t][(k + 2) % 3], ply.face[t][k], ply.face[u][l]))
        if turn(a, b, p) * turn(a, b, q) < 0:
            return [a, b], [at(f[0]), inside]


def damage():
    """What is wrong is found, at the place where it is."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        rng = random.Random(5)
        path = breaklines.points_file(base, breaklines.survey(rng, 200, 2000))
        hard = [(False, [(10, 10), (60, 21), (150, 33)]), (False, [(20, 90), (21, 2)])]
        area = [(True, [(120, 120), (180, 125), (150, 170)])]
        lines = ("--breaklines", breaklines.lines_file(base, "hard.csv", hard))
        hole = ("--holes", breaklines.lines_file(base, "hole.csv", area))
        good, plain, holed, part, bad = (os.path.join(base, n + ".ply") for n in ("good", "plain", "holed", "part", "bad"))
        d.ctl("mesh", path, *lines, "-o", good).ok()
        d.ctl("mesh", path, *lines, *hole, "-o", holed).ok()
        d.ctl("mesh", path, "-o", plain).ok()
        d.ctl("mesh", path, "--bbox", "0,0,100,100", "-o", part).ok()
        expect(verify(*lines, good, path)["lines"]["found"] == 5, "a good mesh")
        verify(*lines, *hole, holed, path)

        def broken(change, fault, file=good, lines=lines):
            ply = Ply(file)
            change(ply)
            ply.write(bad)
            return verify(*lines, bad, fault=fault)

        def remark(ply, was):
            for t, k in next(s for s in ply.sides() if ply.marked(s[0]) == was):
                ply.face[t][3] ^= 1 << k

        def flip(ply):
            (t, k), (u, l) = next(s for s in ply.sides() if ply.marked(s[0]))
            a, b, c, e = ply.face[t][k], ply.face[t][(k + 1) % 3], ply.face[t][(k + 2) % 3], ply.face[u][l]
            ply.face[t], ply.face[u] = [a, b, e, 0], [a, e, c, 0]

        def raise_end(ply):
            v = next(v for v in ply.vertex if v[:2] == (150, 33))
            ply.vertex[ply.vertex.index(v)] = v[:2] + (v[2] + 1,)

        broken(lambda ply: None, None)
        got = broken(lambda ply: remark(ply, 1), "mark")
        expect("feature" in got["message"] and "hard.csv" in got["message"], str(got))
        broken(lambda ply: remark(ply, 0), "mark")
        broken(flip, "line")
        got = broken(raise_end, "height")
        expect(got["place"] == [150, 33, 6], str(got))
        inside = lambda ply: ply.face.pop(next(t for t, f in enumerate(ply.face) if not f[3] and all(20 < c < 180 for v in f[:3] for c in ply.vertex[v][:2])))
        broken(inside, "boundary", holed, (*lines, *hole))
        verify(*lines, plain, fault="line")
        verify(*lines, part, fault="line")
        verify(*lines, *hole, good, fault="area")
        crossed, inside = in_a_part(Ply(part))
        file = os.path.join(base, "crossed.csv")
        with open(file, "w") as f:
            f.write("x,y,z,name\n" + "".join("%d,%d,%d,a\n" % (x, y, (x * 7 + y * 3) % 50) for x, y in crossed))
        got = verify("--breaklines", file, part, fault="line")
        expect("crosses a triangle" in got["message"], str(got))
        file = breaklines.lines_file(base, "inside.csv", [(False, inside)], z=(inside[0][0] * 7 + inside[0][1] * 3) % 50)
        got = verify("--breaklines", file, part, fault="line")
        expect(got["message"].startswith("a vertex of a line is in a triangle") and got["place"][:2] == list(inside[1]), str(got))
        more = ("--breaklines", breaklines.lines_file(base, "more.csv", [(False, [(100, 50), (101, 90)])]))
        got = verify(*lines, *more, good, fault="line")
        expect(got["place"][:2] == [100, 50] and "101 90" in got["message"] and "more.csv" in got["message"], str(got))
        got = verify(*more, good, fault="mark")
        # The ring of a lake as a mere breakline leaves the points inside.
        lake = breaklines.lines_file(base, "lake.csv", area)
        ring = os.path.join(base, "ring.ply")
        d.ctl("mesh", path, "--breaklines", lake, "-o", ring).ok()
        verify("--breaklines", lake, ring, path)
        verify("--lakes", lake, ring)
        verify("--lakes", lake, ring, path, fault="extra")
        r = e2e.run([e2e.VERIFY, *lines, "--no-breaklines", good])
        expect(r.status == 2 and "leaves all lines out" in r.err, r.err)
        r = e2e.run([e2e.VERIFY, "--breaklines", path + "x", good])
        expect(r.status == 74 and "points.xyzx" in r.err, "%d %s" % (r.status, r.err))


if __name__ == "__main__":
    e2e.main(tiny, areas, many_domains, damage)
