"""Compressed files: several workers that decode chunks at once give the same result as one, and fail in the same way."""
import os
import shutil
import struct

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


def in_compatibility_mode(path, out):
    """LAS 1.4 points of format 6 with extra bytes, as LASzip writes them for older readers: LAS 1.2, format 1, five bytes
    more."""
    with open(path, "rb") as f:
        data = f.read()
    at, = struct.unpack("<I", data[96:100])
    length, = struct.unpack("<H", data[105:107])
    n, = struct.unpack("<Q", data[247:255])
    vlrs = struct.pack("<H16sHH32s", 0, b"lascompatible", 22204, 156, b"") + struct.pack("<HHIQQI", 1, 3, 0, 0, 0, 0) + data[247:375]
    vlrs += struct.pack("<H16sHH32s", 0, b"LASF_Spec", 4, 5 * 192, b"")
    vlrs += struct.pack("<HBB32s156s", 0, 0, length - 30, b"of before", b"")
    for kind, name in ((4, b"scan angle"), (1, b"extended returns"), (1, b"classification"), (1, b"flags and channel")):
        vlrs += struct.pack("<HBB32s156s", 0, kind, 0, b"LAS 1.4 " + name, b"")
    records = b""
    for i in range(at, at + length * n, length):
        r = data[i:i + length]
        number, of, cls = r[14] & 15, r[14] >> 4, r[16]
        old = (number if number <= 7 else 7) if of <= 7 else number if number <= 4 else max(4, min(7, 7 - of + number))
        old_of = min(of, 7)
        records += r[:14] + bytes((old | old_of << 3 | r[15] & 0xc0, (cls if cls < 32 else 0) | (r[15] & 7) << 5, 0)) + r[17:18] + r[20:]
        records += struct.pack("<HBBB", 0, number - old << 4 | of - old_of, cls if cls > 31 else 0, (r[15] >> 4 & 3) << 1 | r[15] >> 3 & 1)
    head = bytearray(data[:227])
    head[24:26], head[94:96] = b"\1\2", struct.pack("<H", 227)
    head[96:111] = struct.pack("<IIBHI", 227 + len(vlrs), 2, 1, length + 3, n)
    with open(out, "wb") as f:
        f.write(head + vlrs + records)


def compatibility_mode():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, old = os.path.join(LIDAR, "las14_pdrf6.las"), os.path.join(base, "old.las")
        in_compatibility_mode(path, old)
        a, b = (d.ctl("info", p, "--json").ok().json() for p in (path, old))
        expect("LAS 1.4 point format 6 in compatibility mode" in b["variant"] and not b["warning"], b)
        high = [c for c in a["classes"] if int(c) > 31]
        expect(high and a["classes"] == b["classes"] and a["returns"] == b["returns"], (a, b))
        for view in (["--class", high[0]], ["--drop-overlap"], ["--returns", "last"]):
            a, b = (d.ctl("mesh", p, "--planar", "--json", "-o", os.path.join(base, "o.ply"), *view).ok().json() for p in (path, old))
            expect(a["digest"] == b["digest"] and a["used"] == b["used"], (view, a, b))


def cut_off(base, name, *damages):
    """A copy of LARGE with flipped bytes."""
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


e2e.main(threads_and_memory_change_nothing, compressed_or_not, compatibility_mode, the_first_damage_is_told)
