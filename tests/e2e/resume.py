"""A push that is repeated after an interruption continues: the daemon or the client was killed or interrupted, during files or
the commit. The lattice is the same, and the digests are those of an uninterrupted push. Other pushes may come between. It does not
continue for another user, with other options, or too late."""
import json
import os
import shutil
import random
import re
import select
import signal
import sqlite3
import subprocess
import time

import e2e
from e2e import expect, until
from survey import gone, las, says, show, states

try:
    from acut_wire import Client, Refused, pb
except ImportError as e:
    e2e.skip("python3-xxhash and python3-protobuf are needed: %s" % e)


def tiles(base, count, n=3000):
    """Tiles with different offsets: the lattice depends on which of them are known."""
    paths = []
    for i in range(count):
        rng = random.Random(i)
        points = [(rng.randrange(10000), rng.randrange(10000), rng.randrange(500)) for _ in range(n)]
        paths.append(las(os.path.join(base, "t%03d.las" % i), points, scale=(.01, .01, .01), offset=(100. * i, 13.37, 0)))
    return paths


def ask(c, body, path, push):
    with open(path, "rb") as f:
        if body == "probe":
            return c.ask("probe", pb.Probe(push=push, name=path, path=os.path.abspath(path).encode()), f.fileno())
        return c.ask("file", pb.File(push=push, name=path), f.fileno())


def left_by_all(d, but=0):
    """Waits until acutd has noticed that all clients are gone but so many, and the one that asks. A lower number than before is not
    enough: one who has just asked may count for a moment, and then is the one who left."""
    def connections():
        return d.ctl("status", "--json").ok().json()["connections"]
    until(lambda: connections() == 1 + but, lambda: "who is gone stays connected: %d connections" % connections())


class Half:
    """A push by hand that stops when all files are probed and the first `n` are durable."""

    def __init__(self, d, dataset, paths, n, wait=True, **options):
        self.d, self.c = d, Client(d.socket)
        begun = self.c.ask("push_begin", pb.PushBegin(dataset=dataset, **options))
        self.number, self.id = self.c.last, begun.push
        self.known = [ask(self.c, "probe", p, self.id).known for p in paths]
        self.lattice = self.c.ask("push_plan", pb.PushPlan(push=self.id)).lattice
        for p, known in list(zip(paths, self.known))[:n]:
            if not known:
                ask(self.c, "file", p, self.id)
        if wait:
            files = n - sum(map(bool, self.known[:n]))
            until(lambda: self.c.ping() and self.c.durable.get(self.number, 0) >= files,
                  lambda: "no Durable of %d files, but %s" % (files, self.c.durable))

    def held(self, gate):
        """Waits until a call that acutd makes for the last request is held. Fails with the answer, if that comes instead."""
        came = []

        def answered():
            if select.select([self.c.wire], [], [], 0)[0]:
                came.append(self.c.wire.recv()[1])
            return came and came[-1].WhichOneof("body") not in ("progress", "durable")
        expect(gate.wait(answered), "no call is held, and the answer is %s" % came[-1:])

    def vanish(self, beside=0):
        """Closes the connection. If acutd runs, waits until it has noticed; so many other connections stay."""
        self.c.close()
        if self.d.process.poll() is None:
            left_by_all(self.d, beside)


def end_in(d, seconds):
    """Starts acutd again; the 7 days of all pending pushes are over in so many seconds. It trusts the clock, by which a push into
    each dataset was the last thing before."""
    d.stop()
    db = sqlite3.connect(os.path.join(d.state, "catalogue.db"))
    now = int(time.time() * 1e6)
    db.execute("UPDATE push SET begun_us = ?, sum = NULL", (now + (seconds - 7 * 86400) * 1000000,))
    db.execute("UPDATE dataset SET pushed_us = ?, sum = NULL", (now,))
    db.commit()
    db.close()
    d.start()


def digests(d, dataset):
    job = d.ctl("submit", dataset, "--wait").ok().out.split()[0]
    got = d.ctl("show", job, "--json").ok().json()
    return got["digest"], got["vertex_digest"], got["points"]


def pending(d, dataset):
    return show(d, dataset)["pending"]


def pends(d, dataset, text):
    """Waits until that is said of the interrupted pushes of a dataset, which may not be there yet."""
    seen = None

    def is_said():
        nonlocal seen
        got = d.ctl("dataset", "show", dataset, "--json")
        expect(got.status in (0, 4), got.err)
        seen = got.err if got.status else got.json()["pending"]
        return got.status == 0 and text in (seen or "")
    until(is_said, lambda: "%s: not '%s' is pending, but: %s" % (dataset, text, seen))


def leftovers(d):
    return sorted(n for _, _, files in os.walk(os.path.join(d.state, "datasets")) for n in files
                  if not n.startswith(("manifest-",)) and not n.endswith(".seg"))


def swept(d):
    until(lambda: not leftovers(d), lambda: "left behind: %s" % leftovers(d))


def killed_daemon():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        paths = tiles(base, 6)
        d.ctl("push", "want", *paths).ok()
        want, lattice = digests(d, "want"), show(d, "want")["lattice"]
        half = Half(d, "s", paths, 3)
        d.stop(signal.SIGKILL)
        half.vanish()
        d.start()
        expect("3 files, 9000 points" in pending(d, "s"), str(pending(d, "s")))
        expect("s" in [json.loads(line)["name"] for line in d.ctl("datasets", "--json").ok().out.splitlines()], "datasets")
        says(d.ctl("submit", "s"), 4, "no generation yet")
        # A restart changes nothing; nor does a push that fails before it has anything.
        d.stop()
        d.start()
        says(d.ctl("push", "s", os.path.join(base, "absent.las")), 1)
        pends(d, "s", "3 files")
        # Fewer files, other order: the lattice is the interrupted push's all the same.
        got = says(d.ctl("push", "s", *reversed(paths)), 0, "3 files of an interrupted push are here", "not read again")
        expect(got.out.count("not read again") + got.err.count("not read again") == 3, got.out + got.err)
        expect(digests(d, "s") == want and show(d, "s")["lattice"] == lattice, "another mesh")
        swept(d)
        expect(pending(d, "s") is None and show(d, "s")["generation"] == 1, str(show(d, "s")))
        expect(states(d.ctl("push", "s", *paths, "--json").ok()) == ["known"] * 6, "taken up files are not known")
        d.stop()
        d.start()
        expect(digests(d, "s") == want and not leftovers(d), "after a restart")


def killed_again_and_again():
    """A push into a dataset with points is killed three times; the client sees each file staged once."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        paths = tiles(base, 8)
        d.ctl("push", "want", *paths[:2]).ok()
        d.ctl("push", "want", *paths[2:]).ok()
        d.ctl("push", "s", *paths[:2]).ok()
        want = digests(d, "want")
        for n in (3, 5, 6):
            half = Half(d, "s", paths[2:], n - 2)
            d.stop(signal.SIGKILL)
            half.vanish()
            d.start()
            expect("%d files" % (n - 2) in pending(d, "s"), "%d: %s" % (n, pending(d, "s")))
            expect(show(d, "s")["points"] == 6000 and show(d, "s")["generation"] == 1, "visible before the commit")
        got = d.ctl("push", "s", *paths, "--json").ok()
        expect(states(got) == ["known"] * 2 + ["adopted"] * 4 + ["staged"] * 2, str(states(got)))
        expect(digests(d, "s") == want, "another mesh")


def vanished_client():
    """The connection ends: files that were staged completely are kept, even without a durable point; a broken file is not."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        paths = tiles(base, 4)
        d.ctl("push", "want", *paths).ok()
        want = digests(d, "want")
        Half(d, "s", paths, 2, wait=False).vanish()
        pends(d, "s", "2 files")
        # A file that is another one now is read again, under the name that it has.
        os.utime(paths[0], ns=(5, 5))
        got = d.ctl("push", "s", *paths, "--json").ok()
        expect(states(got) == ["staged", "adopted", "staged", "staged"], str(states(got)))
        expect(digests(d, "s") == want, "another mesh")
        # Its content is enough, if asked.
        Half(d, "t", paths, 2, wait=False).vanish()
        os.utime(paths[0], ns=(6, 6))
        got = d.ctl("push", "t", *paths, "--checksum", "--json").ok()
        expect(states(got) == ["adopted", "adopted", "staged", "staged"], str(states(got)))
        expect(digests(d, "t") == want, "another mesh")
        # Only what is named again counts; the rest stays until it is named.
        Half(d, "u", paths, 3, wait=False).vanish()
        got = d.ctl("push", "u", paths[1], "--json").ok()
        expect(states(got) == ["adopted"], str(states(got)))
        expect(show(d, "u")["points"] == 3000 and digests(d, "u")[2] == 3000, str(show(d, "u")))
        pends(d, "u", "2 files, 6000 points")
        d.stop(signal.SIGKILL)
        d.start()
        got = d.ctl("push", "u", *paths, "--json").ok()
        expect(states(got) == ["adopted", "known", "adopted", "staged"], str(states(got)))
        expect(digests(d, "u") == want and pending(d, "u") is None, "another mesh")
        # Without a staged file there is no pending push, and no dataset.
        Half(d, "v", paths, 0, wait=False).vanish()
        gone(d, "v")
        swept(d)


def cut_off_in_a_file():
    """A half-read file leaves nothing, also if the daemon restarts and numbers its files anew."""
    with e2e.Folder() as base:
        gate = e2e.Gate(base)
        with e2e.Daemon(base, env=gate.env) as d:
            cut_off_in(base, d, gate)


def cut_off_in(base, d, gate):
    paths = tiles(base, 3)
    big = os.path.join(base, "big.las")
    rng = random.Random(9)
    las(big, [(rng.randrange(30000), rng.randrange(30000), 0) for _ in range(600000)], offset=(0, 200, 0))
    paths.insert(2, big)
    d.ctl("push", "want", *paths).ok()
    want = digests(d, "want")
    for reads in (1, 3, 6):
        name = "s%d" % reads
        half = Half(d, name, paths, 2, wait=False)
        # So much of it is read, and no more before its client is gone.
        gate.close("pread", "/big.las", reads)
        with open(big, "rb") as f:
            half.c.send("file", pb.File(push=half.id, name=big), f.fileno())
        half.held(gate)
        half.vanish()
        gate.open()
        pends(d, name, "interrupted")
        d.stop()
        d.start()
        got = d.ctl("push", name, *paths[:2], paths[3], big, "--json").ok()
        expect(states(got) == ["adopted", "adopted", "staged", "staged"], str(states(got)))
        expect(digests(d, name) == want, "another mesh")


def interrupted_client():
    """acutctl itself, by Ctrl-C and by kill -9, in the first file and in later ones."""
    with e2e.Folder() as base:
        gate = e2e.Gate(base)
        with e2e.Daemon(base, env=gate.env) as d:
            interrupted_in(base, d, gate)


def interrupted_in(base, d, gate):
    big = [os.path.join(base, "b%d.las" % i) for i in range(5)]
    for i, p in enumerate(big):
        e2e.run([e2e.SYNTH, "--points", 100000, "--seed", i, p]).ok()
    d.ctl("push", "want", *big).ok()
    want = digests(d, "want")
    kept = 0
    for i, sig in enumerate((signal.SIGINT, signal.SIGKILL, signal.SIGINT, signal.SIGTERM)):
        name = "s%d" % i
        # At the first block of the i-th file.
        gate.close("pread", "/b%d.las" % i, 6)
        p = subprocess.Popen([e2e.ACUTCTL, "push", name] + big, env=dict(os.environ, ACUT_SOCKET=d.socket),
                             stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        expect(gate.wait(lambda: p.poll() is not None), "acutctl ended")
        p.send_signal(sig)
        gate.open()
        p.communicate(timeout=e2e.PATIENCE)
        expect(p.returncode == (-sig if sig == signal.SIGKILL else 128 + sig), "signal %d: %d" % (sig, p.returncode))
        got = d.ctl("push", name, *big, "--json").ok()
        kept += sum(s in ("adopted", "known") for s in states(got))
        expect(digests(d, name) == want, "%s after signal %d: another mesh" % (name, sig))
    print("     %d of 20 files were there already" % kept)


def killed_in_the_commit():
    """Wherever the daemon dies, the push is done or pending, and nothing acknowledged is lost."""
    with e2e.Folder() as base:
        gate = e2e.Gate(base)
        with e2e.Daemon(base, memory="24M", env=gate.env) as d:
            killed_in(base, d, gate)


def killed_in(base, d, gate):
    paths = tiles(base, 3, n=50000)
    d.ctl("push", "want", *paths).ok()
    want = digests(d, "want")
    done = 0
    # Where its segment is merged and brought to disk, and where its manifest gets its name.
    for i, (call, text, n) in enumerate((("pread", ".run", 0), ("pwrite", ".seg", 3), ("fsync", ".seg", 0), ("renameat", "/manifest", 0),
                                         (None, None, 0))):
        name = "s%d" % i
        half = Half(d, name, paths, 3)
        if call:
            gate.close(call, text, n)
        half.c.send("push_commit", pb.PushCommit(push=half.id))
        if call:
            half.held(gate)
        else:
            half.c.answer(half.c.last, "push_committed")
        d.stop(signal.SIGKILL)
        half.vanish()
        gate.open()
        d.start()
        expect(bool(show(d, name)["generation"]) == (not call), "killed at %s of %s: generation %d" % (call, text, show(d, name)["generation"]))
        if show(d, name)["generation"]:
            done += 1
            expect(pending(d, name) is None, "done, and pending: %s" % pending(d, name))
        else:
            expect("3 files" in pending(d, name), str(pending(d, name)))
        got = states(d.ctl("push", name, *paths, "--json").ok())
        expect(got in (["adopted"] * 3, ["known"] * 3), str(got))
        expect(digests(d, name) == want, "another mesh")
    swept(d)
    expect(done == 1, "%d of 5 commits were done" % done)


def what_does_not_fit():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        paths = tiles(base, 3)
        # Other options: its files are read again, and that is said.
        Half(d, "a", paths, 2, wait=False).vanish()
        got = says(d.ctl("push", "a", *paths, "--planar"), 0, "2 files of an interrupted push", "other options")
        expect("not read again" not in got.out + got.err and show(d, "a")["points"] == 9000, got.out)
        until(lambda: pending(d, "a") is None, lambda: "pending, though the dataset has all: %s" % pending(d, "a"))
        Half(d, "b", paths, 2, wait=False).vanish()
        says(d.ctl("push", "b", *paths, "--scale", "0.5"), 0, "other options")
        # Systems that differ late in their names.
        system = "County grid of the northern valleys, revised edition of "
        Half(d, "h", paths, 2, wait=False, assume_crs=system + "1998").vanish()
        says(d.ctl("push", "h", *paths, "--assume-crs", system + "2017"), 0, "other options")
        expect(show(d, "h")["crs"] == system + "2017" and show(d, "h")["points"] == 9000, str(show(d, "h")))
        # An assumed system is not an overriding one; a push with the same options continues.
        Half(d, "o", paths, 2, wait=False, override_crs="EPSG:25832").vanish()
        says(d.ctl("push", "o", *paths, "--assume-crs", "EPSG:25832"), 0, "other options")
        Half(d, "q", paths, 2, wait=False, override_crs="EPSG:25832").vanish()
        got = says(d.ctl("push", "q", *paths, "--override-crs", "EPSG:25832"), 0, "not read again")
        # Read in another way: those files are new ones.
        Half(d, "f", paths, 2, wait=False).vanish()
        got = d.ctl("push", "f", *paths, "--input-format", "las", "--json").ok()
        expect(states(got) == ["staged"] * 3 and show(d, "f")["points"] == 9000, str(states(got)))
        # The first points come from a file that is not on its lattice: the dataset gets another one.
        Half(d, "g", paths, 2, wait=False).vanish()
        fine = las(os.path.join(base, "fine.las"), [(0, 0, 0), (9, 0, 0), (0, 9, 0)], scale=(.001, .001, .001))
        says(d.ctl("push", "g", fine), 0)
        expect(show(d, "g")["points"] == 3 and show(d, "g")["lattice"]["scale_xy"] in (.001, "0.001"), str(show(d, "g")))
        says(d.ctl("push", "g", *paths), 0, "is dropped with its 2 files", "another lattice")
        expect(show(d, "g")["points"] == 9003 and pending(d, "g") is None, str(show(d, "g")))
        # Likewise a text through a pipe, whose scale is not known before its end.
        Half(d, "p", paths, 2, wait=False).vanish()
        pends(d, "p", "2 files")
        p = subprocess.run([e2e.ACUTCTL, "push", "p", "-", "--input-format", "xyz", "--name", "t"],
                           input=b"".join(b"%d.25 %d.5 1.125\n" % (500000 + i % 1000, 4000000 + i // 1000) for i in range(300000)),
                           env=dict(os.environ, ACUT_SOCKET=d.socket), stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=e2e.PATIENCE)
        expect(p.returncode == 0 and show(d, "p")["points"] == 300000, "%d %s" % (p.returncode, p.stderr))
        # Too late.
        Half(d, "c", paths, 2, wait=False).vanish()
        pends(d, "c", "2 files")
        end_in(d, -1)
        gone(d, "c")
        expect("older than 7 days" in d.log_text(), "it is not said")
        swept(d)
        # Its time ends while acutd runs, and nobody pushes there. Where acutd starts slowly, it is over before: then with more.
        for seconds in (3, 15, 45):
            Half(d, "c", paths, 2, wait=False).vanish()
            pends(d, "c", "2 files")
            end_in(d, seconds)
            if d.ctl("dataset", "show", "c").status == 0:
                break
        else:
            expect(False, "it ends before its time")
        busy = Half(d, "other", paths, 1, wait=False)
        gone(d, "c")
        busy.vanish()
        says(d.ctl("push", "other", *paths), 0)
        swept(d)
        # Damaged: it is dropped, and said; the push begins anew.
        for what in ("pending", "stage", "run"):
            name = "d-" + what
            Half(d, name, paths, 2, wait=False).vanish()
            pends(d, name, "2 files")
            hit = [os.path.join(top, n) for top, _, files in os.walk(d.state) for n in files if n.endswith("." + what)]
            expect(len(hit) == 1, str(hit))
            with open(hit[0], "r+b") as f:
                f.seek(20)
                f.write(b"\xff\xff")
            says(d.ctl("push", name, *paths), 0, "is dropped with its 2 files", "damaged")
            expect(show(d, name)["points"] == 9000, str(show(d, name)))
            swept(d)
        # --strict keeps nothing of its own.
        bad = os.path.join(base, "bad.las")
        with open(bad, "wb") as f:
            f.write(b"LASF")
        says(d.ctl("push", "e", *paths, bad, "--strict"), 1)
        gone(d, "e")
        swept(d)


def others_between():
    """A survey of ten files is interrupted after eight. What others push meanwhile, also into a dataset that has no points yet, and also
    if the daemon is killed, does not touch the eight."""
    with e2e.Folder() as base:
        gate = e2e.Gate(base)
        with e2e.Daemon(base, env=gate.env) as d:
            others_push(base, d, gate)


def others_push(base, d, gate):
    paths = tiles(base, 10)
    las(paths[8], [(i % 317 * 31, i // 317 * 31, 0) for i in range(100000)], scale=(.01, .01, .01), offset=(800., 13.37, 0))
    coarse = las(os.path.join(base, "coarse.las"), [(0, 0, 0), (9, 0, 0), (0, 9, 0)], scale=(2., 2., 2.))
    other = las(os.path.join(base, "other.las"), [(0, 0, 0), (9, 0, 0), (0, 9, 0)], scale=(.01, .01, .01))
    d.ctl("push", "want", *paths).ok()
    d.ctl("push", "want", other, coarse).ok()
    want = digests(d, "want")
    gate.close("pread", "/t008.las", 6)
    p = subprocess.Popen([e2e.ACUTCTL, "push", "s"] + paths, env=dict(os.environ, ACUT_SOCKET=d.socket), stdout=subprocess.PIPE,
                         stderr=subprocess.PIPE)
    expect(gate.wait(lambda: p.poll() is not None), "acutctl ended")
    p.send_signal(signal.SIGKILL)
    p.communicate(timeout=e2e.PATIENCE)
    # Otherwise the rest of the ninth file may be read before acutd has noticed.
    left_by_all(d)
    gate.open()
    pends(d, "s", "8 files")
    says(d.ctl("push", "s", coarse), 0, "8 files of an interrupted push are here")
    expect("8 files, 24000 points" in pending(d, "s") and show(d, "s")["points"] == 3, str(show(d, "s")))
    # It is interrupted itself, too.
    Half(d, "s", [other], 1).vanish()
    pends(d, "s", "2 interrupted pushes")
    expect("9 files, 24003 points" in pending(d, "s"), str(pending(d, "s")))
    d.stop(signal.SIGKILL)
    d.start()
    expect("9 files, 24003 points" in pending(d, "s"), str(pending(d, "s")))
    got = d.ctl("push", "s", *paths, "--json").ok()
    expect(states(got) == ["adopted"] * 8 + ["staged"] * 2, str(states(got)))
    pends(d, "s", "1 files, 3 points")
    expect(states(d.ctl("push", "s", other, "--json").ok()) == ["adopted"], "not taken over")
    expect(digests(d, "s") == want and pending(d, "s") is None, "another mesh")
    swept(d)
    says(d.ctl("cache", "verify"), 0)


def discarded():
    """What is discarded is gone, also after a kill; what an open push has taken over is not."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        paths = tiles(base, 4)
        says(d.ctl("dataset", "discard", "s"), 4, "there is no dataset")
        d.ctl("push", "s", paths[3]).ok()
        says(d.ctl("dataset", "discard", "s"), 0, "no interrupted push is pending")
        Half(d, "s", paths[:2], 2).vanish()
        Half(d, "s", paths[2:3], 1).vanish()
        pends(d, "s", "2 interrupted pushes")
        expect("acutctl dataset discard" in pending(d, "s"), pending(d, "s"))
        end_in(d, 36000)
        pushes, = [c for c in d.ctl("doctor", "--json").json()["checks"] if c["name"] == "pushes"]
        expect("2 interrupted pushes wait" in pushes["message"] and "acutctl dataset discard" in pushes["hint"], str(pushes))
        half = Half(d, "s", paths[:2], 0, wait=False)
        expect(half.known == [2, 2], str(half.known))
        got = d.ctl("dataset", "discard", "s", "--json").ok().json()
        expect(got.pop("bytes") >= 3000 * 16, "no bytes")
        expect(got == {"dataset": "s", "pushes": 1, "files": 1, "open": [half.id]}, str(got))
        says(d.ctl("dataset", "discard", "s"), 0, "no interrupted push is pending", "push %d is open and keeps what it has" % half.id)
        half.vanish()
        pends(d, "s", "2 files")
        says(d.ctl("dataset", "discard", "s", "--all"), 0, "1 interrupted push discarded, 2 files")
        d.stop(signal.SIGKILL)
        d.start()
        expect(pending(d, "s") is None and not leftovers(d), "it is back: %s %s" % (pending(d, "s"), leftovers(d)))
        expect(states(d.ctl("push", "s", *paths, "--json").ok()) == ["staged"] * 3 + ["known"], "not read again")
        # Also from a dataset that was removed meanwhile.
        Half(d, "gone", paths, 2).vanish()
        pends(d, "gone", "2 files")
        d.ctl("dataset", "rm", "gone").ok()
        says(d.ctl("dataset", "discard", "gone"), 0, "1 interrupted push discarded, 2 files")
        says(d.ctl("dataset", "discard", "gone"), 4, "there is no dataset")
        # A dataset that has nothing else goes with it.
        Half(d, "new", paths, 2).vanish()
        pends(d, "new", "2 files")
        says(d.ctl("dataset", "discard", "new"), 0, "1 interrupted push discarded")
        says(d.ctl("dataset", "show", "new"), 4, "there is no dataset")


def another_user():
    if os.getuid():
        print("     skipped: needs root, to be another user")
        return
    other = 65534
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        os.chmod(base, 0o755)
        os.chmod(d.socket, 0o777)
        # The tree may lie where nobody else can go.
        acutctl = shutil.copy(e2e.ACUTCTL, base)
        paths = tiles(base, 3)
        Half(d, "s", paths, 2, wait=False).vanish()
        pends(d, "s", "2 files")
        p = subprocess.run([acutctl, "push", "s"] + paths, env=dict(os.environ, ACUT_SOCKET=d.socket), user=other,
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=e2e.PATIENCE)
        expect(p.returncode == 77 and b"belongs to the user" in p.stderr, "%d %s" % (p.returncode, p.stderr))
        expect("2 files" in pending(d, "s"), "another user took it: %s" % pending(d, "s"))
        p = subprocess.run([acutctl, "dataset", "discard", "s", "--all"], env=dict(os.environ, ACUT_SOCKET=d.socket), user=other,
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=e2e.PATIENCE)
        expect(p.returncode == 77 and "2 files" in pending(d, "s"), "another user discards: %d %s" % (p.returncode, p.stderr))
        # Even who may push into it does not take up what another one staged.
        p = subprocess.run([acutctl, "push", "t"] + paths[:1], env=dict(os.environ, ACUT_SOCKET=d.socket), user=other,
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=e2e.PATIENCE)
        expect(p.returncode == 0, p.stderr.decode())

        class AsOther(Half):
            pass
        pid = os.fork()
        if not pid:
            os.setuid(other)
            try:
                AsOther(d, "t", paths, 3, wait=False).vanish()
            finally:
                os._exit(0)
        os.waitpid(pid, 0)
        pends(d, "t", "2 files")
        got = d.ctl("push", "t", *paths, "--json").ok()
        expect(states(got) == ["known", "staged", "staged"], str(states(got)))


def idle_push_gives_memory():
    """An idle push releases its stage, and continues when it is asked to."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        paths = tiles(base, 3)
        for dataset in ("s", ""):
            half = Half(d, dataset, paths, 2, wait=False)

            def staged():
                return d.ctl("status", "--json").ok().json()["ledger"]["stage"]
            # It may have gone by now; it was there.
            most = re.search(r'^acut_ledger_peak_bytes{name="stage"} (\S+)', d.ctl("metrics").ok().out, re.M)
            expect(most and float(most[1]) > 1 << 20, "no stage: %s" % most)
            until(lambda: staged() < 1 << 20, lambda: "an idle push keeps %d bytes of memory" % staged())
            ask(half.c, "file", paths[2], half.id)
            done = half.c.ask("push_commit", pb.PushCommit(push=half.id))
            expect(done.points == 9000, str(done))
            half.vanish()


def two_at_once():
    """Of two simultaneous pushes, the second to commit is checked against what the first has committed."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        def late(half, reason):
            try:
                half.c.ask("push_commit", pb.PushCommit(push=half.id))
                expect(False, "it was committed")
            except Refused as e:
                expect(e.code == "busy" and reason in str(e), str(e))
            half.vanish()

        paths = tiles(base, 3)
        d.ctl("push", "a", paths[0]).ok()
        half = Half(d, "a", paths, 3, wait=False)
        d.ctl("push", "a", *paths[:2]).ok()
        late(half, "this file")
        expect(show(d, "a")["points"] == 6000, str(show(d, "a")))
        got = states(d.ctl("push", "a", *paths, "--json").ok())
        expect(got[:2] == ["known"] * 2 and show(d, "a")["points"] == 9000, str(got))
        # Files that the other one has not: both go in.
        d.ctl("push", "c", paths[0]).ok()
        half = Half(d, "c", paths[:2], 2, wait=False)
        d.ctl("push", "c", paths[2]).ok()
        half.c.ask("push_commit", pb.PushCommit(push=half.id))
        half.vanish()
        expect(show(d, "c")["points"] == 9000, str(show(d, "c")))
        # A lattice that was planned while an interrupted push had another one.
        coarse = las(os.path.join(base, "coarse.las"), [(0, 0, 0), (9, 0, 0), (0, 9, 0)], scale=(2., 2., 2.))
        first = Half(d, "b", paths, 2)
        second = Client(d.socket)
        begun = second.ask("push_begin", pb.PushBegin(dataset="b")).push
        first.vanish(beside=1)
        pends(d, "b", "2 files")
        ask(second, "probe", coarse, begun)
        second.ask("push_plan", pb.PushPlan(push=begun))
        ask(second, "file", coarse, begun)
        d.ctl("push", "b", *paths).ok()
        half.c, half.id = second, begun
        late(half, "another lattice")
        expect(show(d, "b")["points"] == 9000, str(show(d, "b")))
        # If it had a durable point before, it is pending until the next push.
        d.ctl("push", "b", *paths).ok()
        swept(d)


if __name__ == "__main__":
    e2e.main(killed_in_the_commit, killed_again_and_again, discarded, idle_push_gives_memory, killed_daemon, vanished_client, cut_off_in_a_file,
             interrupted_client, what_does_not_fit, others_between, another_user, two_at_once, at_once=6)
