#!/usr/bin/env python3
"""Volumes of random pairs of small meshes against exact fractions.

usage: volumes.py VOLUME_SUMS [SETS [SEED]]

The meshes are not Delaunay: points split triangles and edges of a square, edges flip at random, triangles are left out at random.
Ranges go from tiny ones, where most corners and edges coincide, to nearly all of 32 bits. Polygons are cut into trapezoids here, and
clipped as everything else by fractions: another way than that of the code.
"""
import random
import subprocess
import sys
from fractions import Fraction as F

PART, ERROR_PART = 1 << 20, 1 << 40


# ---- meshes

def turn(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def split(tris, p):
    """Puts p into the triangle that has it, or into two at an edge."""
    for t in list(tris):
        s = [turn(t[i], t[(i + 1) % 3], p) for i in range(3)]
        if min(s) < 0 or p[:2] in [v[:2] for v in t]:
            continue
        tris.remove(t)
        for i in range(3):
            if s[i]:
                tris.append((t[i], t[(i + 1) % 3], p))
        for i in range(3):
            if not s[i]:
                split(tris, p)  # the triangle on the other side of this edge
        return


def flip(rng, tris):
    a = rng.choice(tris)
    i = rng.randrange(3)
    p, q, r = a[i], a[(i + 1) % 3], a[(i + 2) % 3]
    for b in tris:
        for k in range(3):
            if b[k] == q and b[(k + 1) % 3] == p:
                o = b[(k + 2) % 3]
                if turn(p, o, r) > 0 and turn(o, q, r) > 0:
                    tris.remove(a)
                    tris.remove(b)
                    tris += [(p, o, r), (o, q, r)]
                return


def mesh(rng, low, size, points, relief, shape):
    z = lambda: rng.randrange(-relief, relief + 1)
    x0, y0 = low
    a, b, c, d = ((x, y, z()) for x, y in ((x0, y0), (x0 + size, y0), (x0 + size, y0 + size), (x0, y0 + size)))
    tris = [(a, b, c), (a, c, d)]
    for _ in range(points):
        p = (x0 + rng.randrange(size + 1), y0 + rng.randrange(size + 1), z())
        if shape == 'sliver':
            p = (p[0], y0 + min(size, rng.randrange(4)), p[2])
        split(tris, p)
    for _ in range(points if shape != 'flat' else 0):
        flip(rng, tris)
    if shape == 'holes':
        tris = [t for t in tris if rng.randrange(4)] or tris
    rng.shuffle(tris)
    return [tuple(t[(k + r) % 3] for k in range(3)) for t in tris for r in [rng.randrange(3)]]


# ---- exact integrals

def clip(poly, a, b):
    out = []
    for i, p in enumerate(poly):
        q = poly[(i + 1) % len(poly)]
        sp, sq = turn(a, b, p), turn(a, b, q)
        if sp >= 0:
            out.append(p)
        if sp * sq < 0:
            t = F(sp) / (sp - sq)
            out.append((p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])))
    return out


def clip_to(poly, other):
    for i in range(len(other)):
        poly = clip(poly, other[i], other[(i + 1) % len(other)])
        if len(poly) < 3:
            return []
    return poly


def boxes_apart(s, t):
    return any(max(v[k] for v in s) <= min(v[k] for v in t) or max(v[k] for v in t) <= min(v[k] for v in s) for k in (0, 1))


def plane(t):
    (x0, y0, z0), (x1, y1, z1), (x2, y2, z2) = t
    d = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    a = F((z1 - z0) * (y2 - y0) - (z2 - z0) * (y1 - y0), d)
    b = F((x1 - x0) * (z2 - z0) - (x2 - x0) * (z1 - z0), d)
    return a, b, z0 - a * x0 - b * y0


def area(poly):
    return sum(turn(poly[0], poly[i], poly[i + 1]) for i in range(1, len(poly) - 1)) * F(1, 2) if len(poly) > 2 else F(0)


def integral(poly, f):
    s = F(0)
    for i in range(1, len(poly) - 1):
        tri = (poly[0], poly[i], poly[i + 1])
        s += turn(*tri) * sum(f[0] * v[0] + f[1] * v[1] + f[2] for v in tri) / 6
    return s


def add(row, poly, f):
    """Both sides of the line where f is zero."""
    if len(poly) < 3:
        return
    row['shared'] += area(poly)
    v = [f[0] * p[0] + f[1] * p[1] + f[2] for p in poly]
    for sign, volume, place in ((1, 'fill', 'filled'), (-1, 'cut', 'lowered')):
        part = []
        for i, p in enumerate(poly):
            k = (i + 1) % len(poly)
            if sign * v[i] >= 0:
                part.append(p)
            if v[i] * v[k] < 0:
                t = v[i] / (v[i] - v[k])
                part.append((p[0] + t * (poly[k][0] - p[0]), p[1] + t * (poly[k][1] - p[1])))
        if len(part) > 2 and any(v):
            row[volume] += sign * integral(part, f)
            row[place] += area(part)


def trapezoids(rings):
    """The even-odd inside of rings, by horizontal slabs between corners; edges do not cross."""
    ys = sorted({p[1] for r in rings for p in r})
    out = []
    for low, high in zip(ys, ys[1:]):
        middle = (low + high) / F(2)
        cross = []
        for r in rings:
            for i, p in enumerate(r):
                q = r[(i + 1) % len(r)]
                if min(p[1], q[1]) <= low and max(p[1], q[1]) >= high and p[1] != q[1]:
                    at = lambda y: p[0] + (q[0] - p[0]) * F(y - p[1]) / (q[1] - p[1])
                    cross.append((at(middle), at(low), at(high)))
        cross.sort()
        for l, r in zip(cross[::2], cross[1::2]):
            quad = [(l[1], low), (r[1], low), (r[2], high), (l[2], high)]
            out.append([p for i, p in enumerate(quad) if p != quad[i - 1]])
    return [t for t in out if len(t) > 2]


def exact(a, b, level, polygons):
    parts = [None] if polygons is None else [trapezoids([[(F(x), F(y)) for x, y in c] for _, c in p]) for p in polygons]
    rows = [dict.fromkeys(('fill', 'cut', 'shared', 'filled', 'lowered', 'cover0', 'cover1'), F(0)) for _ in parts]
    pairs = []
    if level is None:
        for s in a:
            for t in b:
                if boxes_apart(s, t):
                    continue
                poly = clip_to([(F(v[0]), F(v[1])) for v in s], t)
                if poly:
                    pairs.append((poly, tuple(v - w for v, w in zip(plane(t), plane(s)))))
    else:
        pairs = [([(F(v[0]), F(v[1])) for v in s], tuple(v - w for v, w in zip(plane(s), (0, 0, level)))) for s in a]
    for row, part in zip(rows, parts):
        for poly, f in pairs:
            for q in [None] if part is None else part:
                add(row, poly if q is None else clip_to(poly, q), f)
        for key, m in (('cover0', a), ('cover1', b)):
            for t in m:
                flat = [(F(v[0]), F(v[1])) for v in t]
                row[key] += area(flat) if part is None else sum((area(clip_to(flat, q)) for q in part), F(0))
    return rows


# ---- polygons

def star(rng, cx, cy, radius, corners):
    """Corners around a place, in sixteenths, in the order of their angles: it does not cross itself."""
    import math
    angles = sorted(rng.random() * 2 * math.pi for _ in range(corners))
    if any((y - x) > 3 for x, y in zip(angles, angles[1:] + [angles[0] + 2 * math.pi])):
        angles = [2 * math.pi * i / corners for i in range(corners)]
    out = []
    for w in angles:
        r = radius * (0.3 + 0.7 * rng.random())
        p = (F(round((cx + r * math.cos(w)) * 16), 16), F(round((cy + r * math.sin(w)) * 16), 16))
        if p not in out:
            out.append(p)
    return out


def simple(ring):
    """No two edges meet but neighbours in their corner."""
    n = len(ring)
    for i in range(n):
        for k in range(i + 1, n):
            p, q, r, s = ring[i], ring[(i + 1) % n], ring[k], ring[(k + 1) % n]
            if k == i + 1 or (i == 0 and k == n - 1):
                if turn(p, q, s if k == i + 1 else r) == 0:
                    return False
            elif turn(p, q, r) * turn(p, q, s) <= 0 and turn(r, s, p) * turn(r, s, q) <= 0:
                return False
    return n > 2


def polygon(rng, low, size):
    kind = rng.randrange(4)
    x0, y0 = low
    if kind == 0:  # on lattice lines, so that edges lie on those of the meshes
        xs = sorted(rng.randrange(-1, size + 2) for _ in range(2))
        ys = sorted(rng.randrange(-1, size + 2) for _ in range(2))
        if xs[0] < xs[1] and ys[0] < ys[1]:
            x, X, y, Y = x0 + xs[0], x0 + xs[1], y0 + ys[0], y0 + ys[1]
            return [(1, [(x, y), (X, y), (X, Y), (x, Y)][::rng.choice((1, -1))])]
    for _ in range(20):
        cx, cy = x0 + rng.random() * size, y0 + rng.random() * size
        shell = star(rng, cx, cy, size * (0.2 + rng.random()), rng.randrange(3, 9))
        if kind == 1:  # on lattice corners: slanted edges pass through corners of the boxes of pairs
            shell = list(dict.fromkeys((F(round(x)), F(round(y))) for x, y in shell))
        if not simple(shell):
            continue
        rings = [(1, shell[::rng.choice((1, -1))])]
        if kind == 3:  # the shell, smaller, is a hole of it
            hole = [(F(round((F(cx) + (x - F(cx)) / 3) * 16), 16), F(round((F(cy) + (y - F(cy)) / 3) * 16), 16)) for x, y in shell]
            if len(set(hole)) == len(hole) and simple(hole) and all(
                    turn(shell[i], shell[(i + 1) % len(shell)], p) > 0 for p in hole for i in range(len(shell))):
                rings.append((0, hole))
        return rings
    return [(1, [(x0, y0), (x0 + size, y0), (x0 + size, y0 + size)])]


def number(v):
    return str(v) if isinstance(v, int) or v.denominator == 1 else '%d.%04d' % (v // 1, (v % 1) * 10000) if v >= 0 else '-' + number(-v)


# ---- sets

def text(a, b, sizes, level, polygons):
    whole, part = (0, -1) if level is None else (level // 1, float(level % 1))
    out = ['set %d %d %d %d %d %d %d %r %d' % (len(a), len(b), *sizes, whole, part, len(polygons or []))]
    out += [' '.join(str(c) for v in t for c in v) for t in a + b]
    for p in polygons or []:
        out.append(str(len(p)))
        out += ['%d %d %s' % (shell, len(c), ' '.join(number(v) for q in c for v in q)) for shell, c in p]
    return '\n'.join(out)


def run(program, sets):
    out = subprocess.run([program], input='\n'.join(sets), capture_output=True, text=True)
    if out.returncode:
        sys.exit('volume_sums: ' + out.stderr)
    return [[int(v) for v in line.split()] if line != 'refused' else line for line in out.stdout.splitlines()]


def sum6(m):
    """Six times the volume below it."""
    return sum(turn(*t) * sum(v[2] for v in t) for t in m)


class Judge:
    def __init__(self):
        self.worst = {'fill': 0, 'cut': 0, 'shared': 0, 'cover0': 0, 'cover1': 0}
        self.share = self.same = self.identities = self.rows = 0

    def row(self, where, got, want):
        error, area_error = F(got[7], ERROR_PART), F(got[8], ERROR_PART)
        for key, value, bound in (('fill', got[0], error), ('cut', got[1], error), ('shared', got[2], area_error),
                                  ('cover0', got[5], area_error), ('cover1', got[6], area_error)):
            off = abs(F(value, PART) - want[key])
            self.worst[key] = max(self.worst[key], float(off))
            if bound:
                self.share = max(self.share, float(off / bound))
            if off > bound:
                sys.exit('%s: %s is %s, must be %s, bound %s' % (where, key, float(F(value, PART)), float(want[key]), float(bound)))
        net = F(got[0] - got[1], PART) - (want['fill'] - want['cut'])
        if abs(net) > error:
            sys.exit('%s: net is wrong by %s, bound %s' % (where, float(net), float(error)))
        for key, value in (('filled', got[3]), ('lowered', got[4])):
            if abs(F(value, PART) - want[key]) > area_error + F(1, 1000) * want['shared']:
                sys.exit('%s: %s is %s, must be %s' % (where, key, float(F(value, PART)), float(want[key])))


def sliver(rng, span, heading):
    """Much longer than wide, across the middle."""
    wide = rng.choice((1, 3, 50))
    at = [-span + rng.randrange(9), span - rng.randrange(9), rng.randrange(-span // 2, span)]
    t = []
    for v in at:
        x, y = v, (v * heading[1] // heading[0] if heading[0] else v) + rng.randrange(-wide, wide + 1)
        t.append(((x, y) if heading[0] else (y - v, x)) + (rng.choice((0, 1000, 10**6)) + rng.randrange(50),))
    return [tuple(t)] if turn(*t) > 0 else [(t[0], t[2], t[1])] if turn(*t) else sliver(rng, span, heading)


def slivers(rng):
    """Two that cross, the same plan twice, or one against a level: the doubles lose most where edges are longer than what is common."""
    span = rng.choice((10**3, 10**5, 10**6, 5 * 10**8, 10**9))
    heading = rng.sample(((1, 0), (0, 1), (3, 2), (3, -2), (7, 5)), 2)
    a, b = (sliver(rng, span, h) for h in heading)
    kind = rng.choice(('crossing', 'crossing', 'plan', 'level'))
    if kind == 'plan':
        b = [tuple((x, y, z + rng.randrange(1000)) for x, y, z in a[0])]
    polygons = [polygon(rng, (-8, -8), 16)] if span < 10**6 and rng.randrange(3) == 0 else None
    return span, a, [] if kind == 'level' else b, kind, F(rng.randrange(-8000, 8000), 8) if kind == 'level' else None, polygons, (1, 3, 5)


def make(rng):
    if rng.randrange(4) == 0:
        return slivers(rng)
    size = rng.choice((2, 3, 5, 12, 100, 1000, 10**6, 2 * 10**9))
    low = (rng.randrange(-size // 2 - 1, 1), rng.randrange(-size // 2 - 1, 1))
    if size > 10**9:
        low = (-10**9, -10**9)
    relief = rng.choice((0, 1, 3, 50, 10**6))
    shape = rng.choice(('any', 'any', 'sliver', 'holes', 'flat'))
    a = mesh(rng, low, size, rng.randrange(8), relief, shape)
    b = mesh(rng, low, size, rng.randrange(8), relief, shape)
    kind = rng.choice(('same', 'lifted', 'nearly', 'beside', 'other', 'other'))
    if kind == 'same':
        b = list(a)
    elif kind == 'lifted':
        lift = rng.randrange(-5, 6)
        b = [tuple((x, y, z + lift) for x, y, z in t) for t in a]
    elif kind == 'nearly':
        b = mesh(rng, low, size, 3, relief, 'any')
        a = list(b)
        flip(rng, a)
    elif kind == 'beside':
        move = rng.randrange(size + 1) if size < 10**9 else 0
        b = [tuple((x + move, y, z) for x, y, z in t) for t in b]
    level = F(rng.randrange(-8 * relief - 8, 8 * relief + 9), 8) if rng.randrange(8) == 0 else None
    polygons = [polygon(rng, low, size) for _ in range(rng.randrange(1, 4))] if rng.randrange(3) == 0 and size < 10**6 else None
    if level is not None:
        b = []
    small = (rng.choice((1, 2, 5)), rng.choice((1, 2, 3, 7, 1000)), rng.choice((1, 2, 5)))
    return size, a, b, kind, level, polygons, small


def judge_set(judge, where, made, got):
    """`got` has the rows of six runs: large cells; small ones; exchanged; another order; slabs; small cells of slabs, exchanged."""
    size, a, b, kind, level, polygons, small = made
    n = len(polygons or [0])
    for i, want in enumerate(exact(a, b, level, polygons)):
        row, cells, exchanged, order, slabs, slabs_exchanged = (got[k * n + i] for k in range(6))
        at = '%s, row %d' % (where, i)
        judge.row(at, row, want)
        if row != cells:
            sys.exit('%s: other cells, another result: %s %s' % (at, row, cells))
        if row != order:
            sys.exit('%s: another order, another result: %s %s' % (at, row, order))
        if row != slabs or exchanged != slabs_exchanged:
            sys.exit('%s: with slabs another result: %s %s, %s %s' % (at, row, slabs, exchanged, slabs_exchanged))
        fill, cut, shared, filled, lowered, c0, c1, e0, e1 = exchanged
        if level is None and [cut, fill, shared, lowered, filled, c1, c0, e0, e1] != row:
            sys.exit('%s: exchanged, it is not: %s %s' % (at, row, exchanged))
        if kind == 'same' and level is None:
            judge.same += 1
            if row[0] or row[1] or row[3] or row[4] or (polygons is None and row[2] != row[5]):
                sys.exit('%s: the same mesh differs: %s' % (at, row))

    def full(m):
        return sum(turn(*t) for t in m) == 2 * size * size

    if level is None and polygons is None and kind not in ('beside', 'crossing', 'plan') and full(a) and full(b):
        judge.identities += 1
        error, area_error = F(got[0][7], ERROR_PART), F(got[0][8], ERROR_PART)
        if abs(F(got[0][0] - got[0][1], PART) - F(sum6(b) - sum6(a), 6)) > error:
            sys.exit('%s: the identity does not hold' % where)
        if abs(F(got[0][2], PART) - size * size) > area_error:
            sys.exit('%s: the area is wrong' % where)
    judge.rows += n


def fan(rng, n, radius, apex):
    """Slivers around a vertex, once around, or one side of it."""
    import math
    begin, angle = rng.random(), rng.choice((2 * math.pi, 2, 0.01, 1e-6))
    rim = []
    for i in range(n + 1):
        w = begin + angle * (i % n if angle > 6 else i) / n
        p = (apex[0] + round(radius * math.cos(w)), apex[1] + round(radius * math.sin(w)))
        if not rim or p != rim[-1][:2]:
            rim.append((*p, rng.randrange(1000)))
    hub = (*apex, rng.randrange(1000))
    return [t for t in ((hub, p, q) for p, q in zip(rim, rim[1:])) if turn(*t) > 0] or fan(rng, n, radius, apex)


def fans(program, rng, count):
    """Many slivers: the same sums by cells, by slabs, and by slabs of parts."""
    for k in range(count):
        radius, n = rng.choice((50, 1000, 10**6, 10**9)), rng.choice((40, 150, 400))
        a = fan(rng, n, radius, (0, 0))
        b = fan(rng, n, radius, rng.choice(((0, 0), (0, 0), (rng.randrange(radius // 5), 3))))
        if rng.randrange(4) == 0:
            b = mesh(rng, (-radius // 2, -radius // 2), radius, 12, 1000, 'any')
        ways = [(2048, 32768, 5, 10**9), (2048, 32768, 5, 0), (50, 70, 5, 0), (50, 70, 5, 2), (2048, 32768, 5, 1)]
        got = run(program, [text(a, b, w, None, None) for w in ways] + [text(b, a, w, None, None) for w in ways])
        for w, row, exchanged in zip(ways, got, got[len(ways):]):
            fill, cut, shared, filled, lowered, c0, c1, e0, e1 = exchanged
            if row != got[0] or [cut, fill, shared, lowered, filled, c1, c0, e0, e1] != row:
                sys.exit('fan %d: with %s another result: %s, exchanged %s, by cells %s' % (k, w, row, exchanged, got[0]))


def main():
    program = sys.argv[1]
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 300
    rng = random.Random(int(sys.argv[3]) if len(sys.argv) > 3 else 1)
    judge = Judge()
    fans(program, rng, 6 + count // 10)
    for first in range(0, count, 100):
        made = [make(rng) for _ in range(min(100, count - first))]
        texts = []
        for size, a, b, kind, level, polygons, small in made:
            texts += [text(a, b, (2048, 32768, 5, 64), level, polygons), text(a, b, (*small, 64), level, polygons),
                      text(b, a, (*small, 64), level, polygons), text([t[1:] + t[:1] for t in reversed(a)], b, (1, 1, 3, 64), level, polygons),
                      text(a, b, (2048, 32768, 5, 0), level, polygons), text(b[::-1], a, (*small, 0), level, polygons)]
        got = run(program, texts)
        if 'refused' in got:
            sys.exit('a polygon was refused')
        for i, m in enumerate(made):
            n = 6 * len(m[5] or [0])
            judge_set(judge, 'set %d' % (first + i), m, got[:n])
            got = got[n:]
    print('%d sets, %d rows, 0 wrong; %d of one mesh twice exactly 0, %d identities; largest error %s; %.2g of the bound' %
          (count, judge.rows, judge.same, judge.identities, ', '.join('%s %.3g' % i for i in judge.worst.items()), judge.share))


main()
