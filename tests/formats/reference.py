"""A mesh in whole numbers, from a PLY: heights and sections by fractions."""
import math
import os
import re
import sys
from collections import defaultdict
from fractions import Fraction

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
from e2e import expect  # noqa: E402
from foreign import read_ply  # noqa: E402


class Reference:
    """A mesh in whole numbers, from a PLY."""

    CELL = 400  # lattice steps

    def __init__(self, path):
        with open(path, "rb") as f:
            lattice = re.search(rb"comment acut-lattice (\S+) (\S+)", f.read(4000))
        self.scale = [Fraction(lattice[1].decode())] * 2 + [Fraction(lattice[2].decode())]
        vertices, self.faces = read_ply(path)
        # Division of whole numbers is rounded once, so it tells whether a double is the nearest to a lattice number.
        (a, d), (m, e) = (s.as_integer_ratio() for s in self.scale[1:])
        self.vertices = [(round(x * d / a), round(y * d / a), round(z * e / m)) for x, y, z in vertices]
        expect(all((i * a / d, j * a / d, k * m / e) == v for (i, j, k), v in zip(self.vertices, vertices)), "the PLY is not on its lattice")
        self.edges = {(min(e), max(e)) for a, b, c in self.faces for e in ((a, b), (b, c), (c, a))}
        self.cells = defaultdict(list)
        for face in self.faces:
            xs, ys = ([self.vertices[i][axis] // self.CELL for i in face] for axis in (0, 1))
            for cx in range(min(xs), max(xs) + 1):
                for cy in range(min(ys), max(ys) + 1):
                    self.cells[cx, cy].append(face)

    def place(self, x, y):
        """A place in parts of a lattice step, all whole, and how many these are."""
        px, py = Fraction(x) / self.scale[0], Fraction(y) / self.scale[1]
        parts = math.lcm(px.denominator, py.denominator)
        return (int(px * parts), int(py * parts)), parts

    def height(self, x, y):
        """At coordinates (doubles), as a fraction, and the slope there; None outside."""
        p, parts = self.place(x, y)
        for face in self.cells.get((p[0] // parts // self.CELL, p[1] // parts // self.CELL), ()):
            a, b, c = (tuple(n * parts for n in self.vertices[i]) for i in face)
            weights = [orient(b, c, p), orient(c, a, p), orient(a, b, p)]
            if min(weights) >= 0:
                height = Fraction(sum(w * v[2] for w, v in zip(weights, (a, b, c))), sum(weights) * parts)
                return height * self.scale[2], slope(a, b, c)
        return None

    def lattice_height(self, x, y):
        """At lattice numbers, whole or fractions, as one; None outside."""
        found = self.height(Fraction(x) * self.scale[0], Fraction(y) * self.scale[1])
        return found and found[0] / self.scale[2]

    def section(self, p, q):
        """Where the leg between places p and q (lattice numbers) crosses edges: [(part of the leg, height), ...]."""
        parts = math.lcm(*(Fraction(n).denominator for place in (p, q) for n in place[:2]))
        p, q = ([int(n * parts) for n in place[:2]] for place in (p, q))
        vertices = [(x * parts, y * parts, z) for x, y, z in self.vertices]
        side = [orient(p, q, v) for v in vertices]
        crossings = {}
        for i, j in self.edges:
            if side[i] * side[j] < 0:
                u, v = vertices[i], vertices[j]
                sp, sq = orient(u, v, p), orient(u, v, q)
                if sp * sq < 0:
                    crossings[Fraction(sp, sp - sq)] = (u[2] + Fraction(side[i], side[i] - side[j]) * (v[2] - u[2])) * self.scale[2]
        return sorted(crossings.items())


def orient(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def slope(a, b, c):
    area = orient(a, b, c)
    if not area:
        return 0
    east = ((b[2] - a[2]) * (c[1] - a[1]) - (c[2] - a[2]) * (b[1] - a[1])) / area
    north = ((c[2] - a[2]) * (b[0] - a[0]) - (b[2] - a[2]) * (c[0] - a[0])) / area
    return abs(east) + abs(north)
