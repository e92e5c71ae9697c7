"""Breaklines in views that select points: with crop, every, thin and a clearance the mesh is CGAL's constrained triangulation of the
points that are left and of the vertices of lines, which only the crop removes; a piece counts if both of its ends are there."""
import random
import struct

import breakline_model
import e2e
import xxhash
from breaklines import ALL, compare, lines_file, points_file, random_lines
from e2e import expect


def every_keeps(n, p):
    return xxhash.xxh3_64_intdigest(struct.pack("<qq", *p)) % n == 0


def thinned(points, cell, sign):
    best = {}
    for x, y in points:
        rank = (sign * ((x * 7 + y * 3) % 50), x, y)
        at = (x // cell, y // cell)
        best[at] = min(best.get(at, rank), rank)
    return {rank[1:] for rank in best.values()}


def near(piece, p, clear):
    (ax, ay), (bx, by) = piece
    dx, dy, x, y = bx - ax, by - ay, p[0] - ax, p[1] - ay
    along, length = x * dx + y * dy, dx * dx + dy * dy
    if along <= 0 or along >= length:
        bx, by = (p[0] - bx, p[1] - by) if along > 0 else (x, y)
        return bx * bx + by * by <= clear * clear
    return (x * dy - y * dx) ** 2 <= clear * clear * length


def selected(points, parts, box=None, every=1, thin=None, clear=0):
    inside = lambda p: not box or (box[0] <= p[0] <= box[2] and box[1] <= p[1] <= box[3])
    model = breakline_model.Model({p for p in points if inside(p)}, parts)
    ends = {p for piece in model.pieces for p in piece}
    kept = {p for p in model.vertices - ends if not clear or not any(near(piece, p, clear) for piece in model.pieces)}
    # The model adds the ends of pieces to its vertices, so a point that is one was counted as on a line.
    model.on_line += len(model.vertices - ends) - len(kept)
    kept = {p for p in kept if every_keeps(every, p)}
    if thin:
        kept = thinned(kept, *thin)
    model.vertices = {p for p in ends if inside(p)} | kept
    model.pieces = {piece for piece in model.pieces if all(inside(p) for p in piece)}
    return model


def views():
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        for seed in range(6):
            rng = random.Random(seed)
            size = 60 + 50 * seed
            points = {(rng.randrange(size), rng.randrange(size)) for _ in range(2000)}
            parts = random_lines(rng, size, 12) or [(False, [(0, 0), (9, 5)])]
            path, lines = points_file(base, points), lines_file(base, "lines.csv", parts)
            name = "d%d" % seed
            d.ctl("push", name, path).ok()
            d.ctl("push", name, lines, "--lines-as", "hard").ok()
            box = (size // 5, size // 4, size - 9, size - 7)
            for words, model in (
                    (["--every", "3"], {"every": 3}), (["--thin", "7"], {"thin": (7, 1)}), (["--breakline-clear", "2"], {"clear": 2}),
                    (["--thin", "5", "--thin-pick", "highest", "--breakline-clear", "3"], {"thin": (5, -1), "clear": 3}),
                    (["--crop", "%d,%d,%d,%d" % box], {"box": box}),
                    (["--crop", "%d,%d,%d,%d" % box, "--every", "2", "--thin", "4"], {"box": box, "every": 2, "thin": (4, 1)})):
                got = d.ctl("submit", name, "--wait", "--json", *words, *ALL).ok().json()
                compare(got, selected(points, parts, **model), "seed %d, %s" % (seed, " ".join(words)))
            # Without lines it is another mesh, and that of a dataset that never had any.
            plain = d.ctl("submit", name, "--wait", "--json", "--no-breaklines", "--every", "3", *ALL).ok().json()
            other = d.ctl("mesh", path, "--format", "null", "--json", "--every", "3", *ALL).ok().json()
            expect(plain["digest"] == other["digest"] and plain["removed"].get("line", 0) == 0, "%s %s" % (plain, other))
        # Selections are whole, although their pieces are in the dataset.
        r = d.ctl("cache", "verify", "--json").ok().json()
        expect(r["derived_damaged"] == r["damaged"] == 0, str(r))


if __name__ == "__main__":
    e2e.main(views)
