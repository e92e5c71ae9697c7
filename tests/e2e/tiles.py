"""The same points give the same mesh in any files: the same records, compressed or not, and six abutting tiles as one dataset,
pushed together or one by one, in any order."""
import itertools
import os
import re

import e2e
from e2e import expect

DATA = e2e.data_dir()
if not DATA:
    e2e.skip("no test data: set ACUT_TEST_DATA")
LIDAR = os.path.join(DATA, "lidar")
FOLDER = os.path.join(LIDAR, "tiles_ign_pdrf8")
VIEW = ["--planar", "--keep-withheld", "--keep-noise"]

POINTS, TRIANGLES, TRIANGLES_2 = 405937, 807473, 327523  # of all six tiles; of all points, of class 2


def identity(got):
    return got["digest"], got["vertex_digest"], got["triangles"]


def hashes():
    """(file, hash of its raw records) of the table in the README beside the data."""
    with open(os.path.join(DATA, "README.md")) as f:
        for line in f:
            m = re.match(r"\| `([^`]+\.la[sz])` \| `([0-9a-f]{16})` \|", line)
            if m and os.path.exists(os.path.join(LIDAR, m.group(1))):
                yield m.groups()


def twins():
    groups, pairs = {}, 0
    for name, value in hashes():
        groups.setdefault(value, []).append(name)
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M", threads=3) as daemon:
        for names in groups.values():
            seen = {}
            for name in names if len(names) > 1 else ():
                out = os.path.join(base, "out.ply")
                got = daemon.ctl("mesh", *VIEW, "--json", "-o", out, os.path.join(LIDAR, name)).ok().json()
                seen.setdefault(identity(got), []).append(name)
                os.unlink(out)
            expect(len(seen) <= 1, "same records, other meshes: %s" % seen)
            pairs += len(names) > 1
    expect(pairs >= 12, "only %d twins were found" % pairs)
    print("%d groups of files with the same records" % pairs)


def meshes(daemon, dataset):
    """Both golden views of a dataset."""
    results = []
    for view, triangles in (([], TRIANGLES), (["--class", "2"], TRIANGLES_2)):
        job = daemon.ctl("submit", dataset, *VIEW[1:], *view, "--wait").ok().out.split()[0]
        got = daemon.ctl("show", job, "--json").ok().json()
        expect(got["triangles"] == triangles, "%s %s: %s" % (dataset, view, got))
        results.append(identity(got))
    return tuple(results)


def tiles_in_any_order():
    tiles = sorted(os.path.join(FOLDER, n) for n in os.listdir(FOLDER) if n.endswith(".laz"))
    expect(len(tiles) == 6, "%d tiles" % len(tiles))
    results = {}
    with e2e.Folder() as base:
        orders = [tiles, tiles[::-1], tiles[3:] + tiles[:3], [tiles[i] for i in (2, 5, 0, 3, 1, 4)]]
        for k, (order, single, threads) in enumerate(zip(orders * 2, [False] * 4 + [True] * 4, itertools.cycle((1, 3)))):
            with e2e.Daemon(base, memory="64M", threads=threads, name=str(k)) as daemon:
                for push in [[t] for t in order] if single else [order]:
                    daemon.ctl("push", "tiles", *push).ok()
                shown = daemon.ctl("dataset", "show", "tiles", "--json").ok().json()
                expect(shown["points"] == POINTS, "%d points" % shown["points"])
                results.setdefault(meshes(daemon, "tiles"), []).append(k)
    expect(len(results) == 1, "orders differ: %s" % results)
    print("%d orders, pushed at once and one by one: %s" % (len(orders), next(iter(results))))


e2e.main(twins, tiles_in_any_order)
