"""Surveys of many files: identity, refusals among good files, lattices, thousands of tiles."""
import itertools
import json
import os
import random
import shutil
import struct
import subprocess

import e2e
from e2e import expect


def las(path, points, scale=(.01, .01, .01), offset=(0, 0, 0), box=None, claim=None):
    """A LAS 1.2 file of raw numbers (x, y, z)."""
    h = bytearray(227)
    h[0:4] = b"LASF"
    h[24], h[25] = 1, 2
    struct.pack_into("<HII", h, 94, 227, 227, 0)
    struct.pack_into("<HI", h, 105, 20, len(points) if claim is None else claim)
    struct.pack_into("<3d", h, 131, *scale)
    struct.pack_into("<3d", h, 155, *offset)
    for k in range(3):
        at = [p[k] * scale[k] + offset[k] for p in points] or [0]
        low, high = box[k] if box else (min(at), max(at))
        struct.pack_into("<2d", h, 179 + 16 * k, high, low)
    with open(path, "wb") as f:
        f.write(bytes(h) + b"".join(struct.pack("<iiiHBBbBH", *p, 0, 9, 2, 0, 0, 0) for p in points))
    return path


def tile(base, i, n=20, side=100, **kw):
    """Tile i of a survey: other points for each i."""
    rng = random.Random(i)
    x, y = i % side * 1000, i // side * 1000
    points = [(x + rng.randrange(1000), y + rng.randrange(1000), rng.randrange(5000)) for _ in range(n)]
    return las(os.path.join(base, "t%05d.las" % i), points, **kw)


def says(run, status, *texts):
    expect(run.status == status, "%s ended with %d, not %d\n%s%s" % (" ".join(run.args[:8]), run.status, status, run.out, run.err))
    for t in texts:
        expect(t in run.out + run.err, "%s does not say '%s':\n%s%s" % (" ".join(run.args[:8]), t, run.out, run.err))
    return run


def states(run):
    return [json.loads(line)["state"] for line in run.out.splitlines()]


def gone(d, name):
    """Waits until the dataset of a failed push is removed: with its connection, soon after its client has ended."""
    e2e.until(lambda: d.ctl("dataset", "show", name).status == 4, "the dataset %s stays" % name)


def show(d, name):
    return d.ctl("dataset", "show", name, "--json").ok().json()


def the_same_file_again():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        a, b = tile(base, 1), tile(base, 2)
        os.chdir(base)
        os.mkdir("sub")
        os.symlink(a, "sub/link.las")
        says(d.ctl("push", "s", a), 0, "20 points", "room left on the lattice")
        got = d.ctl("push", "s", a, "./t00001.las", ".//sub/../t00001.las", b, "--json").ok()
        # ".." may lead through a link, so it is another path.
        expect(states(got) == ["known", "known", "staged", "staged"], got.out)
        before = show(d, "s")
        says(d.ctl("push", "s", a, b), 0, "there already, skipped")
        expect(show(d, "s") == before, "a push of nothing new changed the dataset")
        # The same content under another name is another file, unless contents are compared.
        shutil.copy(a, "c.las")
        expect(states(d.ctl("push", "s", "c.las", "--checksum", "--json").ok()) == ["known"], "--checksum reads")
        expect(show(d, "s") == before, "--checksum changed the dataset")
        # Another time: refused, but the same to --checksum.
        os.utime(a, ns=(0, 1))
        says(d.ctl("push", "s", a), 1, "time of change", "--checksum", "--add", "--replace")
        says(d.ctl("push", "s", a, b), 3, "time of change")
        expect(states(d.ctl("push", "s", a, "--checksum", "--json").ok()) == ["known"], "--checksum and another time")
        # Another content: refused, whatever is compared; --checksum does not believe times.
        old = os.stat(b)
        tile(base, 3)
        shutil.copy("t00003.las", b)
        says(d.ctl("push", "s", b), 1, "--add")
        says(d.ctl("push", "s", b, "--checksum"), 1, "with other content", "--add")
        os.utime(b, ns=(old.st_atime_ns, old.st_mtime_ns))
        expect(states(d.ctl("push", "s", b, "--json").ok()) == ["known"], "size and time are believed")
        says(d.ctl("push", "s", b, "--checksum"), 1, "with other content")
        expect(show(d, "s") == before, "a refused push changed the dataset")
        says(d.ctl("push", "s", b, "--checksum", "--add"), 0, "20 points")
        expect(show(d, "s")["points"] == before["points"] + 20 and show(d, "s")["generation"] == before["generation"] + 1,
               str(show(d, "s")))
        expect(states(d.ctl("push", "s", b, "--checksum", "--add", "--json").ok()) == ["known"], "--add of the same")
        expect(states(d.ctl("push", "s", b, "--replace", "--json").ok()) == ["known"], "--replace of the same")
        # A restart knows them as well.
        d.stop()
        d.start()
        expect(states(d.ctl("push", "s", b, "c.las", "--checksum", "--json").ok()) == ["known", "known"], "after a restart")


def sums(base, name, *paths, binary=False):
    """A list by sha256sum, beside the files."""
    out = subprocess.run(["sha256sum"] + (["-b"] if binary else []) + list(paths), cwd=base, check=True, stdout=subprocess.PIPE).stdout
    with open(os.path.join(base, name), "wb") as f:
        f.write(out)
    return os.path.join(base, name)


def manifest_of_sums():
    """--manifest: all files or none, before the daemon is asked."""
    if not shutil.which("sha256sum"):
        print("     skipped: there is no sha256sum")
        return
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        os.mkdir(os.path.join(base, "sub"))
        a, b, c = tile(base, 1), tile(os.path.join(base, "sub"), 2), tile(base, 3)
        odd = os.path.join(base, "back\\slash\nline.las")
        shutil.copy(tile(base, 4), odd)
        out = os.path.join(base, "m.ply")
        text = sums(base, "SHA256SUMS", "t00001.las", "sub/t00002.las", os.path.basename(odd))
        binary = sums(base, "BINARY", "t00001.las", "sub/t00002.las", "t00003.las", binary=True)
        with open(binary) as f:
            expect(" *t00001.las" in f.read(), "no binary marker")
        os.chdir("/")
        says(d.ctl("mesh", a, b, odd, "-o", out, "--manifest", text), 0)
        says(d.ctl("push", "s", a, b, "--manifest", binary), 0)
        # By any name of the file; a link to it is it.
        os.symlink(a, os.path.join(base, "link.las"))
        os.chdir(os.path.join(base, "sub"))
        says(d.ctl("mesh", "../link.las", "./t00002.las", "-o", out, "--manifest", "../SHA256SUMS"), 0)
        says(d.ctl("mesh", "t00002.las", "-o", out, "--manifest", sums(base, "sub/here", "sub/t00002.las")), 1, "does not list it")
        # Not listed; a mismatch among good ones; a list that is none.
        before = show(d, "s")
        says(d.ctl("push", "s", a, b, c, "--manifest", text), 1, "t00003.las", "SHA256SUMS does not list it")
        with open(c, "r+b") as f:
            f.seek(-1, 2)
            f.write(b"\x01")
        got = says(d.ctl("push", "s", a, c, b, "--manifest", binary), 1, "t00003.las: its SHA-256 is", "BINARY has")
        expect("t00001" not in got.err, got.err)
        says(d.ctl("push", "new", a, c, b, "--manifest", binary), 1, "t00003.las")
        gone(d, "new")
        expect(show(d, "s") == before, "something was kept")
        got = says(d.ctl("push", "s", c, odd, "--manifest", binary, "--json"), 1)
        error = json.loads(got.out.splitlines()[0])["error"]
        expect(error["file"].endswith("t00003.las") and "line.las" in error["hint"], str(error))
        with open(os.path.join(base, "none"), "w") as f:
            f.write("# a comment\n\nnot a sum\n")
        says(d.ctl("push", "s", a, "--manifest", os.path.join(base, "none")), 1, "line", "64 hexadecimal digits")
        says(d.ctl("push", "s", a, "--manifest", os.path.join(base, "absent")), 1, "absent: it cannot be opened")
        with open(os.path.join(base, "bsd"), "w") as f:
            for p in (a, b):
                f.write("SHA256 (%s) = %s\n" % (p, subprocess.run(["sha256sum", p], stdout=subprocess.PIPE).stdout.decode()[:64].upper()))
        says(d.ctl("mesh", a, b, "-o", out, "--manifest", os.path.join(base, "bsd")), 0)
        # Without a daemon it says the same.
        says(e2e.run([e2e.ACUTCTL, "push", "s", a, c, "--manifest", binary, "--socket", base + "/none.sock"]), 1, "t00003.las")


def thousands_of_tiles():
    """A folder, a list and the files themselves, in any order; the memory stays within its bound."""
    count = 3000
    with e2e.Folder() as base, e2e.Daemon(base, memory="32M") as d:
        tiles = os.path.join(base, "tiles")
        os.mkdir(tiles)
        paths = [tile(tiles, i, n=4, side=55) for i in range(count)]
        os.mkdir(os.path.join(tiles, ".hidden"))
        tile(os.path.join(tiles, ".hidden"), 1)
        with open(os.path.join(tiles, "readme.txt"), "w") as f:
            f.write("not a survey file\n")
        says(d.ctl("push", "s", tiles, "-q"), 0)
        expect(show(d, "s")["points"] == 4 * count and show(d, "s")["files"] == count, str(show(d, "s")))
        random.Random(1).shuffle(paths)
        with open(os.path.join(base, "list"), "w") as f:
            f.write("\n".join(paths) + "\n")
        says(d.ctl("push", "again", "@" + os.path.join(base, "list"), "-q"), 0)
        got = d.ctl("push", "s", *paths[:2000], "--json").ok()
        expect(states(got) == ["known"] * 2000, "files that are there are read again")
        digests = []
        for name in ("s", "again"):
            job = d.ctl("submit", name, "--wait").ok().out.split()[0]
            one = d.ctl("show", job, "--json").ok().json()
            digests.append((one["digest"], one["vertex_digest"]))
        out = os.path.join(base, "m.ply")
        one = d.ctl("mesh", tiles, "-o", out, "--json").ok().json()
        digests.append((one["digest"], one["vertex_digest"]))
        expect(len(set(digests)) == 1, str(digests))
        expect(d.vmhwm() < (32 + 32) << 20, "VmHWM %d" % d.vmhwm())


def too_many_for_the_memory():
    """Memory that a push keeps for its files is charged: beyond it they are refused, and the daemon continues."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        tile(base, 1)
        # One file under many long names.
        deep = base + ("/" + "d" * 200) * 15
        os.makedirs(deep)
        for i in range(4000):
            os.link(os.path.join(base, "t00001.las"), "%s/%d.las" % (deep, i))
        says(d.ctl("push", "s", base, "-q"), 3, "does not fit into this memory", "several parts")
        expect(d.vmhwm() < (24 + 32) << 20, "VmHWM %d" % d.vmhwm())
        says(d.ctl("mesh", os.path.join(base, "t00001.las"), "-o", os.path.join(base, "m.ply")), 0)


def broken_among_good():
    """The mesh is that of the good files alone; with --strict nothing is kept."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        good = [tile(base, i, n=200) for i in range(4)]
        out = os.path.join(base, "m.ply")
        want = d.ctl("mesh", *good, "-o", out, "--json").ok().json()
        bad = {}
        bad["short.las"] = "whole points"
        with open(good[0], "rb") as f:
            data = f.read()
        with open(os.path.join(base, "short.las"), "wb") as f:
            f.write(data[:-30])
        las(os.path.join(base, "lattice.las"), [(2**31 - 1, 0, 0), (-2**31, 5, 0), (0, 0, 0)], scale=(1000., 1000., .01))
        bad["lattice.las"] = "does not fit into 32 bits"
        # A box that lies: it fits, its points do not.
        las(os.path.join(base, "liar.las"), [(i, i, 0) for i in range(9000)] + [(2**31 - 1, 0, 0)],
            scale=(1., 1., .01), box=[(0, 10), (0, 10), (0, 10)])
        bad["liar.las"] = "point 9000"
        with open(os.path.join(base, "text.las"), "w") as f:
            f.write("1 2 3\n")
        bad["text.las"] = "LASF"
        bad["absent.las"] = "cannot be opened"
        for name, text in bad.items():
            path = os.path.join(base, name)
            for command in ("mesh", "push"):
                words = [command] + (["one-" + name.split(".")[0]] if command == "push" else [])
                rest = ["-o", out] if command == "mesh" else []
                got = says(d.ctl(*words, good[0], path, *good[1:], *rest), 3, name, text)
                says(d.ctl(command, *(["strict"] if command == "push" else []), good[0], path, *good[1:], *rest, "--strict"), 1, name)
                gone(d, "strict")
            job = d.ctl("submit", words[1], "--wait").ok().out.split()[0]
            got = d.ctl("show", job, "--json").ok().json()
            expect(got["digest"] == want["digest"] and got["vertex_digest"] == want["vertex_digest"] and
                   got["points"] == want["points"], "%s left something: %s" % (name, got))
            expect(show(d, words[1])["files"] == 4, str(show(d, words[1])))
        everything = [os.path.join(base, n) for n in bad]
        got = d.ctl("push", "all", *everything, *good, "--json")
        says(got, 3)
        expect(sorted(states(got)) == ["refused"] * len(bad) + ["staged"] * 4, got.out)
        errors = [json.loads(line)["error"] for line in got.out.splitlines()]
        expect(all(e["file"].startswith(base) and e["message"] for e in errors if e), str(errors))
        # Alone, these two have a lattice of their own.
        says(d.ctl("push", "none", *[p for p in everything if os.path.basename(p) not in ("liar.las", "lattice.las")]), 1)
        gone(d, "none")


def inputs_that_do_not_fit():
    """The inputs that do not fit the lattice do not depend on the order."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        points = [(0, 0, 0), (100, 0, 5), (0, 100, 9), (100, 100, 3)]
        paths = [las(os.path.join(base, n), points, **kw) for n, kw in (
            ("a.las", dict(scale=(.01, .01, .01))),
            ("b.las", dict(scale=(.01, .01, .01), offset=(200, 0, 0))),
            ("far.las", dict(scale=(.01, .01, .01), offset=(9e8, 0, 0))),
            ("fine.las", dict(scale=(1e-9, 1e-9, .01), box=[(0, 20), (0, 20), (0, 1)])))]
        wide = las(os.path.join(base, "wide.las"), points, scale=(.01, .01, .01), box=[(0, 5e7), (0, 1), (0, 1)])
        seen = set()
        for order in list(itertools.permutations(paths + [wide]))[::7]:
            got = d.ctl("mesh", *order, "-o", os.path.join(base, "m.ply"), "--json")
            says(got, 3)
            report = got.json()
            seen.add((report["digest"], report["vertex_digest"], tuple(sorted(os.path.basename(r["file"]) for r in report["refused"]))))
        expect(len(seen) == 1, str(seen))
        expect(list(seen)[0][2] == ("far.las", "fine.las", "wide.las"), str(seen))


def names_that_are_no_text():
    """Two names that differ only in bytes that are not UTF-8: the second is refused for that reason, not as a change."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        os.mkdir(base + "/in")
        for i, name in enumerate((b"caf\xe8.las", b"caf\xe9.las")):
            path = las(os.path.join(base, "one.las"), [(x % 30, x // 30, i) for x in range(900 + i)], scale=(.01, .01, .01))
            os.rename(path, os.path.join(os.fsencode(base), b"in", name))
        says(d.ctl("push", "valley", base + "/in"), 3, "has the same name", "UTF-8")
        expect(show(d, "valley")["points"] == 900, str(show(d, "valley")))


if __name__ == "__main__":
    e2e.main(manifest_of_sums, the_same_file_again, thousands_of_tiles, too_many_for_the_memory, broken_among_good, inputs_that_do_not_fit,
             names_that_are_no_text)
