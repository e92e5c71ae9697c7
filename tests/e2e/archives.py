"""gzip files, zip archives and PTX through daemon and client: the mesh of the plain files, members by name, damaged members among
good ones, the same archive pushed again, drop folders, lists of checksums, and archives that unpack to too much."""
import gzip
import hashlib
import io
import json
import os
import random
import resource
import signal
import struct
import subprocess
import tarfile
import zipfile

import e2e
from e2e import ACUTCTL, expect, main
from protocol import some_points, write_las

BASE = D = None


def path_of(*names):
    path = os.path.join(BASE, *names)
    os.makedirs(os.path.dirname(path), exist_ok=True)
    return path


def write(name, data):
    with open(path_of(name), "wb") as f:
        f.write(data if isinstance(data, bytes) else data.encode())
    return path_of(name)


def read(path):
    with open(path, "rb") as f:
        return f.read()


def text(seed, n=300, left=0):
    r = random.Random(seed)
    return "".join("%.3f %.3f %.3f\n" % (left + r.uniform(0, 50), r.uniform(0, 50), r.uniform(0, 5)) for _ in range(n))


def packed(name, members, method=zipfile.ZIP_DEFLATED):
    path = path_of(name)
    with zipfile.ZipFile(path, "w", method) as z:
        for member, data in members:
            z.writestr(member, data)
    return path


def changed(name, path, old, new, count=-1):
    """A copy of a file, with bytes in place of others."""
    data = read(path)
    expect(old in data, "%r is not in %s" % (old, path))
    return write(name, data.replace(old, new, count))


def mesh(*inputs, status=0, args=(), env=None):
    out = path_of("out.ply")
    r = D.ctl("mesh", "--json", "-o", out, *inputs, *args, env=env)
    expect(r.status == status, "%s: %d\n%s%s" % (" ".join(inputs), r.status, r.out, r.err))
    return r.json() if status in (0, 3) else json.loads(r.out)["error"]


def same_mesh():
    a, b = text(1), text(2, left=60)
    plain = mesh(write("a.xyz", a), write("b.xyz", b))["digest"]
    las = path_of("c.las")
    write_las(las, some_points(400, 3))
    plain_las = mesh(las)["digest"]
    write("folder/a.xyz.gz", gzip.compress(a.encode()))
    packed("folder/rest.zip", [("deep/b.xyz", b), ("notes.txt", "none")])
    packed("folder/other.zip", [("notes.pdf", "none"), ("more.pdf", "none")])
    half = len(a) // 2
    for inputs in ([packed("ab.zip", [("b.xyz", b), ("deep/er/a.XYZ", a)])], [packed("stored.zip", [("b.xyz", b), ("a.xyz", a)], zipfile.ZIP_STORED)],
                   [write("a.xyz.gz", gzip.compress(a[:half].encode()) + gzip.compress(a[half:].encode())), path_of("b.xyz")],
                   [packed("one.zip", [("points.dat", a)]), path_of("b.xyz")], [write("unnamed", gzip.compress(b.encode())), path_of("a.xyz")],
                   [path_of("folder")]):
        expect(mesh(*inputs)["digest"] == plain, "%s" % inputs)
    for inputs in ([write("c.las.gz", gzip.compress(read(las)))], [packed("c.zip", [("c.las", read(las)), ("__MACOSX/._c.las", "x"), (".c.las", "x")])]):
        expect(mesh(*inputs)["digest"] == plain_las, "%s" % inputs)
    names = [json.loads(line)["file"] for line in D.ctl("info", "--json", "--header", path_of("ab.zip")).ok().out.splitlines()]
    expect(names == [path_of("ab.zip") + "/b.xyz", path_of("ab.zip") + "/deep/er/a.XYZ"], names)
    r = D.ctl("mesh", "-o", path_of("out.ply"), path_of("folder")).ok()
    expect("rest.zip: left out, it is no survey file: notes.txt" in r.err and "other.zip: left out" in r.err, r.err)


def scans():
    """Scans with a quarter turn and a shift; the expected points are written as text, with integers."""
    r = random.Random(5)
    cells = [(r.randrange(-9000, 9000), r.randrange(-9000, 9000), r.randrange(-900, 900)) for _ in range(200)]
    head = "%d\n%d\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n1000 2000.5 -3 1\n"
    lines = ["%d.%04d %s 0.5 1 2 3\n" % (0, 0, "0 0")] * 25 + ["%.4f %.4f %.4f 0.5 1 2 3\n" % (x / 1e4, y / 1e4, z / 1e4) for x, y, z in cells]
    scan = head % (15, 15) + "".join(lines)
    points = "".join("%.4f %.4f %.4f\n" % ((10000000 - y) / 1e4, (20005000 + x) / 1e4, (z - 30000) / 1e4) for x, y, z in cells)
    want = mesh(write("scan.xyz", points), args=["--assume-units", "m"])["digest"]
    for path in (write("scan.ptx", scan), write("scan.ptx.gz", gzip.compress(scan.encode())), packed("scan.zip", [("s/scan.ptx", scan)]), write("scan.pts", scan),
                 write("twice.ptx", scan + scan)):
        expect(mesh(path)["digest"] == want, path)
    info = D.ctl("info", "--json", path_of("twice.ptx")).ok().json()
    expect(info["format"] == "ptx" and "2 scans, 450 cells, 50 empty" in info["variant"] and info["units"]["xy"] == "metre", info)
    short = write("short.ptx", scan[:-100])
    error = mesh(short, status=1)
    expect(error["code"] == "truncated" and "scan 1" in error["message"] and "--accept-truncated" in error["hint"], error)
    expect(mesh(short, args=["--accept-truncated"])["points"] in (196, 197), "cells that are there")


def damaged():
    good, other = text(1), text(2)
    whole = packed("whole.zip", [("a.xyz", good), ("b.xyz", other)])
    alone = mesh(write("a.xyz", good))["digest"]
    with zipfile.ZipFile(whole) as z:
        entry = z.getinfo("b.xyz")
    crc = struct.pack("<I", entry.CRC)
    # of b.xyz: the bit for encrypted, another method, another checksum, both in its own head and in the directory
    local, central = (lambda flag, method: struct.pack("<HHH", 20, flag, method)), (lambda flag, method: struct.pack("<HHHH", 788, 20, flag, method))
    data = read(whole)
    at, dir_at = entry.header_offset, data.rindex(b"PK\1\2")

    def patched(name, flag, method):
        d = bytearray(data)
        d[at + 4:at + 10] = local(flag, method)
        d[dir_at + 4:dir_at + 12] = central(flag, method)
        return write(name, bytes(d))

    for path, says in ((patched("secret.zip", 1, 8), "encrypted"), (patched("deflate64.zip", 0, 9), "Deflate64"), (patched("lzma.zip", 0, 14), "a method that is not read"),
                       (changed("crc.zip", whole, crc, b"\1\2\3\4"), "checksum"), (packed("twice.zip", [("a.xyz", good), ("b.xyz", "e 2 3\n")]), "not a number")):
        got = mesh(path, status=3)
        expect(got["digest"] == alone, "%s" % got)
        r = D.ctl("mesh", "-o", path_of("out.ply"), path)
        expect(r.status == 3 and path + "/b.xyz" in r.err and says in r.err, r.err)
        expect(mesh(path, status=1, args=["--strict"])["file"].endswith("/b.xyz"), "--strict")
    cut = write("cut.zip", data[:len(data) * 2 // 3])
    got = mesh(cut, status=1)
    expect(got["code"] == "truncated" and got["file"] == cut, "%s" % got)
    expect(mesh(cut, path_of("a.xyz"), status=3)["digest"] == alone, "a good file beside an archive that is none")
    for name, members, says in (("none.zip", [("a.pdf", "x"), ("b.pdf", "x")], "no survey files"), ("empty.zip", [], "no files"), ("hidden.zip", [("in/.DS_Store", "x"), ("__MACOSX/c.xyz", "1 2 3\n")], "only hidden files")):
        expect(says in mesh(packed(name, members), status=1)["message"], name)
    packed_text = gzip.compress(text(4, 3000).encode())
    cut = write("cut.xyz.gz", packed_text[:len(packed_text) // 2])
    got = mesh(cut, status=1)
    expect(got["code"] == "truncated" and got["file"] == cut + "/cut.xyz" and "--accept-truncated" in got["hint"], "%s" % got)
    points = text(4, 3000).splitlines()
    got = mesh(cut, args=["--accept-truncated"])
    expect(mesh(write("begin.xyz", "".join(p + "\n" for p in points[:got["points"]])))["digest"] == got["digest"], "a line that is cut was taken")
    flipped = bytearray(packed_text)
    flipped[len(flipped) // 2] ^= 0x40
    expect("damaged" in mesh(write("flip.xyz.gz", bytes(flipped)), status=1)["message"], "a flipped bit")
    for name, end in (("crc", b"abcd" + packed_text[-4:]), ("length", packed_text[-8:-4] + b"abcd")):
        expect("damaged" in mesh(write(name + ".xyz.gz", packed_text[:-8] + end), status=1)["message"], "another " + name)
    r = D.ctl("mesh", "-o", path_of("out.ply"), write("tail.xyz.gz", gzip.compress(good.encode()) + b"garbage")).ok()
    expect("7 bytes after its end" in r.err, r.err)
    for name in ("none.gz", "none.zip", "none.laz", "none.xyz.gz"):
        got = mesh(write(name, b""), status=1)
        expect((got["code"], got["message"], got["file"]) == ("truncated", "the file is empty (0 bytes)", path_of(name)), got)
    for r in (D.ctl("mesh", "-o", path_of("out.ply"), write("none.xyz", b"")).ok(), D.ctl("push", "none", path_of("none.xyz")).ok()):
        expect("none.xyz: the file is empty (0 bytes)" in r.err, r.err)
    expect("one of the inputs" in mesh(path_of("a.xyz"), whole, status=2, args=["-o", whole, "--format", "ply"])["message"], "the archive as output")


def packed_twice():
    """One layer of packing is unpacked. A second layer is refused by name, with a command that unpacks it."""
    points, tar = text(1).encode(), io.BytesIO()
    with tarfile.open(fileobj=tar, mode="w") as t:
        t.addfile(tarfile.TarInfo("a.xyz"))
    for path, says, todo in ((write("a.xyz.gz.gz", gzip.compress(gzip.compress(points))), "a gzip file within a gzip file", "gunzip -k a.xyz.gz.gz"),
                             (packed("gz.zip", [("a.xyz.gz", gzip.compress(points))]), "a gzip file within a zip archive", "unzip gz.zip"),
                             (write("a.zip.gz", gzip.compress(read(packed("in.zip", [("a.xyz", points)])))), "a zip archive within a gzip file", "gunzip -k a.zip.gz"),
                             (write("t.tgz", gzip.compress(tar.getvalue())), "a tar archive", "tar -xzf t.tgz"),
                             (write("t.tar.gz", gzip.compress(tar.getvalue())), "a tar archive", "tar -xzf t.tar.gz"),
                             (write("my t.tgz", gzip.compress(tar.getvalue())), "a tar archive", "tar -xzf FILE")):
        got = mesh(path, status=1)
        expect(says in got["message"] and todo + "," in got["hint"], "%s: %s" % (path, got))


def everything(folder):
    return {os.path.join(root, n) for root, dirs, files in os.walk(folder) for n in dirs + files}


def names_that_lead_away():
    """Names of members with dots: they hide no file, and nothing is written outside of the folder."""
    points, place = text(1), path_of("deep", "er", "x")[:-2]
    temp = path_of("deep", "temp", "x")[:-2]
    names = ["./a.xyz", "../x/a.xyz", "../../../../../../" + BASE + "/deep/b.xyz", BASE + "/deep/c.xyz", "d/../../../e.xyz", "d\\..\\..\\f.xyz"]
    archive = packed("deep/er/away.zip", [(n, points) for n in names])
    before = everything(BASE + "/deep")
    expect(mesh(archive, env={"TMPDIR": temp})["points"] == 300 * len(names), "not all members")
    expect(everything(BASE + "/deep") == before, "a mesh wrote: %s" % (everything(BASE + "/deep") ^ before))
    D.ctl("ingest", "away", place, "--settle", "0", env={"TMPDIR": temp}).ok()
    expect(everything(BASE + "/deep") == before - {archive} | {place + "/" + n for n in ("done", "failed", "done/away.zip")}, "%s" % everything(BASE + "/deep"))
    for name in ("./a.xyz", "../x/a.xyz"):
        expect(mesh(packed("dot.zip", [(name, points)]))["points"] == 300, name)


def without_descriptors():
    """A program that is started without standard input, output or error does not mistake its files for these."""
    path = write("closed.xyz.gz", gzip.compress(text(1).encode()))
    for closed in ([0], [0, 1], [0, 1, 2]):
        out = path_of("closed.ply")
        command = [ACUTCTL, "mesh", "--private", path, "-o", "closed.ply"]
        env = dict(os.environ, XDG_CACHE_HOME=path_of("private", "x")[:-2])
        p = subprocess.run(["sh", "-c", '"$@" ' + " ".join("%d>&-" % n for n in closed), "sh"] + command, cwd=BASE, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        # what cannot be told is an error, and the mesh is there
        expect(p.returncode == (74 if 1 in closed else 0) and b"300" in read(out), "%s: %d %s" % (closed, p.returncode, p.stderr))
        os.unlink(out)


def pushed(dataset, *args, status=0):
    r = D.ctl("push", dataset, "--json", *args)
    expect(r.status == status, "%d\n%s%s" % (r.status, r.out, r.err))
    return [json.loads(line) for line in r.out.splitlines()]


def pushed_again():
    a, b = text(1), text(2, left=60)
    path = packed("push/ab.zip", [("a.xyz", a), ("in/b.xyz", b)])
    packed_a = write("push/a.xyz.gz", gzip.compress(a.encode()))
    expect([f["state"] for f in pushed("again", path)] == ["staged"] * 2, "first")
    expect([f["state"] for f in pushed("again", path)] == ["known"] * 2, "the same archive")
    expect([f["state"] for f in pushed("again", packed_a, "--checksum")] == ["known"], "the same content")
    os.utime(path, (1, 1))
    r = D.ctl("push", "again", path)
    expect(r.status == 1 and "--checksum" in r.err, r.err)
    expect([f["state"] for f in pushed("again", path, "--checksum")] == ["known"] * 2, "written again")
    files = D.ctl("dataset", "log", "again", "--files").ok().out
    expect(path + "/in/b.xyz" in files, files)
    expect(len(pushed("twice", path, path)) == 2, "named twice")


def dropped():
    folder = path_of("drop", "x")[:-2]
    packed("drop/good.zip", [("a.xyz", text(1)), ("b.xyz", text(2))])
    packed("drop/mixed.zip", [("c.xyz", text(3)), ("d.xyz", "1 2\n")])
    write("drop/e.xyz.gz", gzip.compress(text(5).encode()))
    write("drop/plain.xyz", text(6))
    write("drop/bad.zip", b"PK\3\4 and nothing else")
    for again in (False, True):
        r = D.ctl("ingest", "dropped", folder, "--settle", "0", "--json")
        expect(r.status == (3 if not again else 0), "%d %s%s" % (r.status, r.out, r.err))
        if not again:
            lines = {os.path.relpath(f["file"], "good.zip") if f["file"].startswith("good.zip") else f["file"]: f for f in map(json.loads, r.out.splitlines()) if "file" in f}
            expect(lines["a.xyz"]["moved_to"] == "done/good.zip" and lines["mixed.zip/c.xyz"]["moved_to"] == "failed/mixed.zip", "%s" % lines)
            expect(sorted(os.listdir(folder + "/done")) == ["e.xyz.gz", "good.zip", "plain.xyz"], os.listdir(folder + "/done"))
            expect("bad.zip" in os.listdir(folder + "/failed") and "mixed.zip.error" in os.listdir(folder + "/failed"), os.listdir(folder + "/failed"))
            expect("d.xyz" in json.loads(read(folder + "/failed/mixed.zip.error"))["error"]["file"], "the reason")
        points = D.ctl("dataset", "show", "dropped", "--json").ok().json()["points"]
        expect(points == 1500, points)
        os.rename(folder + "/done/good.zip", folder + "/delivered-twice.zip") if not again else None


def sums():
    a, b = text(1), text(2)
    path = packed("sums/ab.zip", [("a.xyz", a), ("b.xyz", b)])
    sha = [hashlib.sha256(x).hexdigest() for x in (a.encode(), b.encode(), read(path))]
    members = write("sums/members", "%s  ab.zip/a.xyz\n%s  ab.zip/b.xyz\n" % (sha[0], sha[1]))
    whole = write("sums/whole", "%s *ab.zip\n" % sha[2])
    for good in (members, whole):
        mesh(path, args=["--manifest", good])
    for bad, says in ((write("sums/bad", "%s  ab.zip/a.xyz\n%s  ab.zip/b.xyz\n" % (sha[0], sha[0])), "its SHA-256 is " + sha[1]),
                      (write("sums/half", "%s  ab.zip/a.xyz\n" % sha[0]), "does not list it"), (write("sums/other", "%s  ab.zip\n" % sha[0]), "its SHA-256 is " + sha[2])):
        expect(says in mesh(path, status=1, args=["--manifest", bad])["message"], bad)


def too_much():
    """400 MB of blanks in 400 KB: limited in memory and on the disk."""
    bomb = path_of("bomb.xyz.gz")
    with gzip.open(bomb, "wb", 9) as f:
        for _ in range(400):
            f.write(b" \n" * (1 << 19))

    def limits():
        resource.setrlimit(resource.RLIMIT_FSIZE, (20 << 20, 20 << 20))

    env = dict(os.environ, ACUT_SOCKET=D.socket, TMPDIR=BASE)
    p = subprocess.Popen([ACUTCTL, "mesh", "--json", bomb, "-o", path_of("out.ply")], env=env, preexec_fn=limits, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    out = p.stdout.read()
    p.stderr.read()
    _, status, used = os.wait4(p.pid, 0)
    got = json.loads(out)["error"]
    expect(os.WEXITSTATUS(status) == 74 and got["code"] == "no-space" and BASE in got["message"] and "TMPDIR" in got["hint"], "%s %s" % (status, got))
    expect(e2e.sanitized() or used.ru_maxrss < 64 << 10, "%d KB of memory" % used.ru_maxrss)
    expect("can be made in" in mesh(bomb, status=77 if os.geteuid() else 74, env={"TMPDIR": "/nonexistent"})["message"], "no TMPDIR")
    expect(not [n for n in os.listdir(BASE) if n.startswith("acut-input")], "a file was left")


def interrupted():
    """A signal while a file is unpacked: its status, and no file stays."""
    temp, gate = path_of("temp", "x")[:-2], e2e.Gate(BASE)
    env = dict(os.environ, ACUT_SOCKET=D.socket, TMPDIR=temp, **gate.env)
    for number in (signal.SIGINT, signal.SIGTERM):
        for words in (["mesh", "-o", path_of("out.ply")], ["info"], ["push", "interrupted"]):
            gate.close("pwrite", temp, 1)
            p = subprocess.Popen([ACUTCTL] + words + [path_of("bomb.xyz.gz")], env=env, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
            expect(gate.wait(lambda: p.poll() is not None), "no file is made")
            p.send_signal(number)
            gate.open()
            said = p.communicate()[1].decode()
            expect(p.returncode == 128 + number and "interrupted" in said, "%s: %d %s" % (words, p.returncode, said))
            expect(not os.listdir(temp), "a file was left")


def others():
    """Commands that open files themselves give the error of the daemon."""
    grid = write("grid.asc", "ncols 2\nnrows 1\n1 2\n")
    got = mesh(grid, status=1)
    expect("an ESRI ASCII grid" in got["message"] and "gdal2xyz.py" in got["hint"], "%s" % got)
    rows = [json.loads(line) for line in D.ctl("formats", "--json").ok().out.splitlines()]
    expect({"gz", "zip", "ptx"} <= {r["format"] for r in rows if r["direction"] == "in"}, rows)


def run():
    global BASE, D
    with e2e.Folder() as BASE, e2e.Daemon(BASE) as D:
        main(same_mesh, scans, damaged, packed_twice, names_that_lead_away, without_descriptors, pushed_again, dropped, sums, too_much, interrupted, others)


if __name__ == "__main__":
    run()
