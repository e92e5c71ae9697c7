"""What breaklines make of points, written a second time with fractions: snap rounding, points on lines and in lakes, and CGAL's
constrained triangulation of what is left (docs/design/constraints.md). Coordinates are whole numbers."""
import os
import subprocess
from fractions import Fraction

ORACLE = os.environ.get("CGAL_DIGEST")


def rounded(f):
    return (f + Fraction(1, 2)).__floor__()


def turn(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def crossing(a, b, c, d):
    """Where two segments cross between their ends, rounded; else None."""
    s, t, u, v = turn(a, b, c), turn(a, b, d), turn(c, d, a), turn(c, d, b)
    if s * t >= 0 or u * v >= 0:
        return None
    part = Fraction(u, u - v)
    return rounded(a[0] + part * (b[0] - a[0])), rounded(a[1] + part * (b[1] - a[1]))


def meets_pixel(a, b, c):
    """Whether a segment meets the square of half a unit around c, without its upper sides."""
    low, high, low_open, high_open = Fraction(0), Fraction(1), False, False
    for k in range(2):
        d = b[k] - a[k]
        if not d:
            if a[k] != c[k]:
                return False
            continue
        f, t = Fraction(2 * (c[k] - a[k]) - 1, 2 * d), Fraction(2 * (c[k] - a[k]) + 1, 2 * d)
        f_open, t_open = False, True
        if f > t:
            f, t, f_open, t_open = t, f, True, False
        if f > low or (f == low and f_open):
            low, low_open = f, f_open
        if t < high or (t == high and t_open):
            high, high_open = t, t_open
    return low < high or (low == high and not low_open and not high_open)


def snap(segments):
    """Pieces of segments (pairs of positions), by snap rounding: a set of pairs, the lower end first."""
    segments = [(a, b) for a, b in segments if a != b]
    hot = {p for s in segments for p in s}
    for i, (a, b) in enumerate(segments):
        for c, d in segments[:i]:
            at = crossing(a, b, c, d)
            if at:
                hot.add(at)
    pieces = set()
    for a, b in segments:
        up = (1 if b[0] >= a[0] else -1, 1 if b[1] >= a[1] else -1)
        x0, x1, y0, y1 = min(a[0], b[0]), max(a[0], b[0]), min(a[1], b[1]), max(a[1], b[1])
        line = sorted((p for p in hot if x0 <= p[0] <= x1 and y0 <= p[1] <= y1 and meets_pixel(a, b, p)),
                      key=lambda p: (up[0] * p[0], up[1] * p[1]))
        pieces.update((min(p, q), max(p, q)) for p, q in zip(line, line[1:]))
    return pieces


def segments_of(parts):
    """Of lines and rings, [(ring, positions)]."""
    out = []
    for ring, at in parts:
        out += list(zip(at, at[1:] + at[:1] if ring else at[1:]))
    return out


def on(piece, p):
    a, b = piece
    return turn(a, b, p) == 0 and min(a[0], b[0]) <= p[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= p[1] <= max(a[1], b[1])


def is_in(ring, p):
    """Even-odd; p is on no side."""
    inside = False
    for a, b in zip(ring, ring[1:] + ring[:1]):
        if (a[1] > p[1]) != (b[1] > p[1]):
            t = turn(a, b, p)
            inside ^= t > 0 if b[1] > a[1] else t < 0
    return inside


class Model:
    """points: positions. hard: [(ring, positions)]. lakes: features, each a list of rings. boundary, holes: rings. Rings do not cross."""

    def __init__(self, points, hard=(), lakes=(), boundary=(), holes=()):
        parts = list(hard) + [(True, r) for f in lakes for r in f] + [(True, r) for r in list(boundary) + list(holes)]
        self.pieces = snap(segments_of(parts))
        self.boundary, self.holes = boundary, holes
        ends = {p for piece in self.pieces for p in piece}
        by_row = {}
        for piece in self.pieces:
            for y in range(min(piece[0][1], piece[1][1]), max(piece[0][1], piece[1][1]) + 1):
                by_row.setdefault(y, []).append(piece)
        self.on_line = self.in_area = 0
        self.vertices = set(ends)
        for p in set(points):
            if any(on(piece, p) for piece in by_row.get(p[1], ())):
                self.on_line += 1
            elif self.is_out(p) or any(sum(is_in(r, p) for r in f) % 2 for f in lakes):
                self.in_area += 1
            else:
                self.vertices.add(p)

    def is_out(self, p):
        return bool(self.boundary and not any(is_in(r, p) for r in self.boundary)) or any(is_in(r, p) for r in self.holes)

    def cgal(self, metric=None):
        """[triangles, digest], or None where CGAL is not there. metric: (P, Q, K)."""
        if not ORACLE:
            return None
        at = sorted(self.vertices)
        number = {p: i for i, p in enumerate(at)}
        rows = ["metric %d %d %d" % metric] if metric else []
        rows += ["v %d %d" % p for p in at] + ["p %d %d" % (number[a], number[b]) for a, b in sorted(self.pieces)]
        for word, rings in (("in", self.boundary), ("out", self.holes)):
            rows += [word + " " + " ".join("%d %d" % p for p in r) for r in rings]
        count, digest = subprocess.run([ORACLE, "pieces"], input="\n".join(rows), stdout=subprocess.PIPE, check=True, text=True).stdout.split()
        return [int(count), digest]
