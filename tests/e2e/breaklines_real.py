"""Real shores and outlines on real points, against CGAL: the lake of a survey, and the roof of a building as a closed line."""
import os
import struct
from decimal import Decimal

import breakline_model
import e2e
from e2e import expect

ALL = ("--keep-withheld", "--keep-noise")
CASES = (
    # points, lines, kind, options: the scale of both lattices is 0.01
    ("las12_pdrf1_lake_103k.laz", "lake_breakline.shp", "lakes", ("--lake-level", "min")),
    ("las10_pdrf1_pointwise_213k.laz", "TO_city_hall.shp", "breaklines", ()),
)


def find(name):
    for folder, _, files in os.walk(e2e.data_dir()):
        if name in files:
            return os.path.join(folder, name)
    return None


def positions(path):
    """Of a PLY, on a lattice of 0.01."""
    with open(path, "rb") as f:
        data = f.read()
    head, body = data.split(b"end_header\n", 1)
    n = int(head.split(b"element vertex ")[1].split()[0])
    return [(round(x * 100), round(y * 100)) for x, y, _ in struct.iter_unpack("<3d", body[:24 * n])]


def on_lattice(v):
    """The shortest decimal of the double, rounded to 0.01, halves upwards."""
    return int((Decimal(repr(v)) * 100 + Decimal("0.5")).to_integral_value(rounding="ROUND_FLOOR"))


def shapes(path):
    """[(is a ring, positions)] of a Shapefile of PolyLineZ (13) or PolygonZ (15)."""
    with open(path, "rb") as f:
        data = f.read()
    out, at = [], 100
    while at < len(data):
        size = struct.unpack_from(">i", data, at + 4)[0] * 2
        kind = struct.unpack_from("<i", data, at + 8)[0]
        parts, points = struct.unpack_from("<2i", data, at + 44)
        first = list(struct.unpack_from("<%di" % parts, data, at + 52)) + [points]
        xy = list(struct.iter_unpack("<2d", data[at + 52 + 4 * parts:at + 52 + 4 * parts + 16 * points]))
        for a, b in zip(first, first[1:]):
            line = [(on_lattice(x), on_lattice(y)) for x, y in xy[a:b]]
            out.append((kind == 15, line[:-1] if kind == 15 else line))
        at += 8 + size
    return out


def against_cgal(points, lines, kind, options):
    def run():
        points_path, lines_path = find(points), find(lines)
        expect(points_path and lines_path, "%s or %s is missing" % (points, lines))
        with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
            plain = os.path.join(base, "plain.ply")
            d.ctl("mesh", points_path, "-o", plain, "--quiet", *ALL).ok()
            parts = shapes(lines_path)
            if kind == "lakes":
                model = breakline_model.Model(positions(plain), (), [[r] for _, r in parts])
            else:
                model = breakline_model.Model(positions(plain), parts)
            out = os.path.join(base, "lines.ply")
            got = d.ctl("mesh", points_path, "--" + kind, lines_path, *options, "-o", out, "--json", *ALL).ok().json()
            want = model.cgal()
            expect(want is None or [got["triangles"], got["digest"]] == want, "%d triangles %s, CGAL has %s" % (got["triangles"], got["digest"], want))
            expect(got["line_set"]["edges"] == len(model.pieces), "%s, %d pieces" % (got["line_set"], len(model.pieces)))
            checked = e2e.run([e2e.VERIFY, "--json", "--" + kind, lines_path, *options, *ALL, out, points_path]).ok().json()
            expect(checked["lines"]["found"] == len(model.pieces) and checked["removed"]["area"] == model.in_area, str(checked))
            print("     %d triangles, %d edges of lines, %d positions on lines, %d in areas" % (
                got["triangles"], len(model.pieces), model.on_line, model.in_area))
    run.__name__ = lines.split(".")[0]
    return run


if __name__ == "__main__":
    if not e2e.data_dir():
        e2e.skip("there is no test data: set ACUT_TEST_DATA")
    e2e.main(*[against_cgal(*case) for case in CASES])
