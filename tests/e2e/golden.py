"""Every real file, with all points and with class 2: the triangle counts of the data's tables, and a checker that shares no code
with the engine. The tables are read from the README beside the data."""
import os
import re

import e2e
from e2e import expect

DATA = e2e.data_dir()
if not DATA:
    e2e.skip("no test data: set ACUT_TEST_DATA")

VIEW = ["--planar", "--keep-withheld", "--keep-noise"]


def number(text):
    return int(text.replace(",", ""))


def rows():
    """(file, points, distinct, class 2, triangles, class-2 triangles) of the LAS and LAZ files."""
    with open(os.path.join(DATA, "README.md")) as f:
        for line in f:
            cells = [c.strip() for c in line.strip().strip("|").split("|")]
            m = re.fullmatch(r"`([^`]+\.la[sz])`", cells[0])
            if m and len(cells) == 12:
                yield (m.group(1),) + tuple(number(cells[i]) for i in (5, 6, 7, 9, 10))


def mesh(daemon, base, path, view, points, distinct, triangles):
    out = os.path.join(base, "out.ply")
    got = daemon.ctl("mesh", *VIEW, *view, "--json", "-o", out, path).ok().json()
    what = "%s %s" % (os.path.basename(path), " ".join(view))
    expect(got["triangles"] == triangles, "%s: %d triangles, not %d" % (what, got["triangles"], triangles))
    expect(got["points"] == points, "%s: %d points, not %d" % (what, got["points"], points))
    expect(distinct is None or got["used"] == distinct, "%s: %d used, not %s" % (what, got["used"], distinct))
    if triangles:
        expect(got["triangles"] == 2 * got["vertices"] - 2 - got["hull"], what + ": Euler's count")
        e2e.run([e2e.VERIFY, *[v for v in VIEW if v != "--planar"], "--planar", *view, out, path]).ok()
    os.unlink(out)


def golden_counts():
    n = 0
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as daemon:
        for name, points, distinct, class2, triangles, triangles2 in rows():
            path = os.path.join(DATA, "lidar", name)
            mesh(daemon, base, path, [], points, distinct, triangles)
            mesh(daemon, base, path, ["--class", "2"], points, None, triangles2)
            n += 2
    expect(n >= 104, "only %d cases were found in the table" % n)
    print("%d meshes" % n)


def xyz_files():
    # 242 and 400 points; the 20 x 20 grid has 19 * 19 * 2 triangles.
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as daemon:
        for name, points, triangles in (("grid_60m.xyz", 400, 722), ("s400.xyz", 400, None), ("rect1.xyz", 242, None)):
            path, out = os.path.join(DATA, "lidar/xyz", name), os.path.join(base, "out.ply")
            got = daemon.ctl("mesh", "--json", "-o", out, path).ok().json()
            expect(got["points"] == points, "%s: %d points" % (name, got["points"]))
            expect(triangles in (None, got["triangles"]), "%s: %d triangles" % (name, got["triangles"]))
            e2e.run([e2e.VERIFY, out, path]).ok()


e2e.main(golden_counts, xyz_files)
