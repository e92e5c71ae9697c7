"""Compressed files: chunks decoded by several workers at once give what one gives, and fail as one would."""
import os
import shutil

import e2e
from e2e import expect

DATA = e2e.data_dir()
if not DATA:
    e2e.skip("no test data: set ACUT_TEST_DATA")
LIDAR = os.path.join(DATA, "lidar")

# 13 chunks of 50,000 points, compressor 2, LAS 1.2.
LARGE = os.path.join(LIDAR, "las12_pdrf1_ahn3_641k.laz")


def mesh(d, base, path, *more):
    out = os.path.join(base, "out.ply")
    got = d.ctl("mesh", "--planar", "--keep-withheld", "--keep-noise", "--json", "-o", out, *more, path).ok().json()
    os.unlink(out)
    return got


def threads_and_memory_change_nothing():
    results = set()
    with e2e.Folder() as base:
        for i, (threads, memory) in enumerate(((1, "64M"), (2, "64M"), (4, "64M"), (4, "512M"))):
            with e2e.Daemon(base, memory=memory, threads=threads, name=str(i)) as d:
                got = mesh(d, base, LARGE)
                expect(got["points"] == 640510, "%d points with %d threads" % (got["points"], threads))
                results.add((got["digest"], got["triangles"]))
    expect(len(results) == 1, "results differ with threads and memory: %s" % results)
    expect(results.pop()[1] == 1280961, "not the golden number of triangles")


def compressed_or_not():
    for laz, las in (("las12_pdrf3_autzen_ft.laz", "las12_pdrf3_autzen_ft.las"),
                     ("las10_pdrf0_ft_pointwise.laz", "las10_pdrf0_ft.las"),
                     ("las13_pdrf4.laz", "las13_pdrf4.las")):
        with e2e.Folder() as base, e2e.Daemon(base, threads=4) as d:
            a, b = (mesh(d, base, os.path.join(LIDAR, name)) for name in (laz, las))
            expect(a["digest"] == b["digest"], "%s is not %s" % (laz, las))


def cut_off(base, name, *damages):
    """A copy of LARGE with bytes turned over."""
    path = os.path.join(base, name)
    shutil.copyfile(LARGE, path)
    os.chmod(path, 0o644)
    with open(path, "r+b") as f:
        for at in damages:
            f.seek(at)
            b = f.read(1)
            f.seek(at)
            f.write(bytes([b[0] ^ 0x55]))
    return path


def the_first_damage_is_told():
    # In the third and the second last chunk: whoever comes first, the lower one is the file's error.
    size = os.path.getsize(LARGE)
    told = set()
    with e2e.Folder() as base:
        path = cut_off(base, "bad.laz", size * 5 // 26, size * 22 // 26)
        for i, threads in enumerate((1, 2, 4, 4, 4)):
            with e2e.Daemon(base, threads=threads, name=str(i)) as d:
                run = d.ctl("push", "s", path)
                expect(run.status == 1, "ended with %d" % run.status)
                line = [text for text in run.err.splitlines() if "bad.laz" in text][0]
                told.add((run.status, line))
                expect(d.ctl("push", "s", LARGE).status == 0, "the dataset takes no good file afterwards")
                got = d.ctl("dataset", "show", "s", "--json").ok().json()
                expect(got["points"] == 640510, "the dataset has %s points" % got["points"])
    expect(len(told) == 1, "errors differ: %s" % told)
    print(told.pop())


e2e.main(threads_and_memory_change_nothing, compressed_or_not, the_first_damage_is_told)
