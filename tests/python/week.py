"""A week of the two example scripts, etc/examples/nightly-ingest.{sh,py}, each on a daemon of its own: good files, broken ones,
half-copied and repeated ones, corrected ones, two runs at once, no daemon, a daemon and a script that are killed in the middle
of a push, a full disk. At the end nothing is lost and nothing doubled: the dataset is the one that the right files make, in
a new store, by acutctl."""
import fcntl
import glob
import hashlib
import os
import re
import shutil
import signal
import subprocess
import time

import e2e
from e2e import Daemon, Folder, expect, until

EXAMPLES = os.path.join(os.environ["ACUT_SOURCE"], "etc/examples")


def synth(path, points, seed, *options):
    e2e.run([e2e.SYNTH, "--points", points, "--seed", seed, "--origin", "%d,5400000" % (500000 + 20 * seed), *options, path]).ok()
    with open(path, "rb") as f:
        return f.read()


class Week:
    """Folders, daemon and script; what was delivered; a row a run."""

    def __init__(self, base, script):
        self.base, self.script = base, os.path.join(EXAMPLES, script)
        self.incoming, self.out = os.path.join(base, "incoming"), os.path.join(base, "out")
        os.mkdir(self.incoming)
        self.gate = e2e.Gate(base)
        self.daemon = Daemon(base, memory="64M", env=self.gate.env)
        self.rows, self.delivered, self.night = [], set(), ""
        self.env = dict(os.environ, ACUT_SOCKET=self.daemon.socket, PAUSES="0.05 0.1 0.2 0.4 0.8",
                        PATH=os.path.dirname(e2e.ACUTCTL) + ":" + os.environ["PATH"])

    def deliver(self, name, data, whole=True, age=0):
        path = os.path.join(self.incoming, name)
        with open(path, "wb") as f:
            f.write(data)
        if age:
            os.utime(path, (time.time() - age, time.time() - age))
        if whole:
            self.delivered.add(hashlib.sha256(data).hexdigest())

    def start(self):
        return subprocess.Popen([self.script, self.incoming, "valley", self.out], env=dict(self.env, NIGHT=self.night),
                                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True)

    def finish(self, p, what, *want):
        text = p.communicate(timeout=e2e.PATIENCE)[0].decode(errors="replace")
        line = ""
        if p.returncode not in (75, -signal.SIGKILL):
            with open(os.path.join(self.incoming, "ingest.log")) as f:
                line = f.read().splitlines()[-1]
            expect("night=%s " % self.night in line and "status=%d " % p.returncode in line, "the log says: " + line)
        counts = re.findall(r"(?:added|known|broken|waiting)=(\d+)", line) or ["-"] * 4
        self.rows.append("%s  %-44s %4d  %s" % (self.night, what, p.returncode, "".join("%8s" % c for c in counts)))
        expect(p.returncode in want, "%s: status %d, not %s\n%s" % (what, p.returncode, want, text))
        return counts, text

    def run(self, what, want, *counts):
        got, text = self.finish(self.start(), what, want)
        if counts:
            expect(got == list(map(str, counts)), "%s: added, known, broken, waiting are %s, not %s\n%s" % (what, got, counts, text))
        return text

    def free(self):
        """The lock ends with the last process that has it, also an acutctl that outlives the script."""
        with open(os.path.join(self.incoming, ".lock")) as f:
            try:
                fcntl.flock(f, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return False
        return True

    def left(self):
        return sorted(n for n in os.listdir(self.incoming) if n.endswith(".las"))


def week(script):
    with Folder() as base:
        make = lambda name, points, seed: synth(os.path.join(base, name), points, seed)
        w = Week(base, script)
        d = w.daemon.start()
        try:
            live(w, d, make)
        finally:
            print("\n".join(["%s:" % script, "%-11s %-44s %4s %8s%8s%8s%8s" % ("night", "", "exit", "added", "known", "broken", "waiting")]
                            + w.rows), flush=True)
            d.stop(signal.SIGKILL)


def live(w, d, make):
    right = {n: make(n, 10000 + i, i) for i, n in enumerate(("a.las", "b.las", "c.las", "d.las", "e.las", "f.las"), 1)}

    w.night = "2026-03-02"
    w.run("nothing has ever arrived", 0, 0, 0, 0, 0)
    w.deliver("a.las", right["a.las"])
    w.deliver("b.las", right["b.las"])
    w.deliver(".hidden.las", right["c.las"], whole=False)
    w.deliver("x.las.part", right["c.las"], whole=False)
    w.run("two files", 0, 2, 0, 0, 0)
    expect(w.left() == [".hidden.las"] and os.path.exists(os.path.join(w.incoming, "x.las.part")), "what was not to be touched")

    w.night = "2026-03-03"
    first_c = make("first-c.las", 9000, 33)
    w.deliver("c.las", first_c)
    w.deliver("a.las", right["a.las"])
    w.deliver("broken.las", first_c[:90] + b"\xff" * 40 + first_c[130:])
    w.deliver("stale.las", right["d.las"][:5000], age=3 * 86400)
    w.run("one new, one repeated, two broken", 3, 1, 1, 2, 0)
    with open(os.path.join(w.incoming, "failed/broken.las.error")) as f:
        expect("bad-input" in f.read(), "the reason of broken.las")
    expect(os.path.exists(os.path.join(w.incoming, "failed/stale.las.error")), "the reason of stale.las")

    w.night = "2026-03-04"
    w.deliver("d.las", right["d.las"][:len(right["d.las"]) // 2], whole=False)
    w.deliver("e.las", right["e.las"])
    w.deliver("b-again.las", right["b.las"])
    w.run("one new, one under another name, one half", 0, 1, 1, 0, 1)
    expect("d.las" in w.left(), "the half-copied file was moved")

    w.night = "2026-03-05"
    w.deliver("d.las", right["d.las"])
    w.deliver("c.las", right["c.las"])
    os.kill(d.process.pid, signal.SIGSTOP)
    both = [w.start(), w.start()]
    until(lambda: any(p.poll() is not None for p in both), "neither of two runs gave way")
    second = [p for p in both if p.poll() is not None][0]
    w.finish(second, "a run while another one is at work", 75)
    os.kill(d.process.pid, signal.SIGCONT)
    got, _ = w.finish([p for p in both if p is not second][0], "the other: one completed, one corrected", 0)
    expect(got == ["2", "0", "0", "0"], got)

    w.night = "2026-03-06"
    d.stop()
    w.deliver("f.las", right["f.las"])
    w.run("no daemon", 69)
    expect("f.las" in w.left(), "f.las is gone")

    w.night = "2026-03-07"
    right["g.las"] = make("g.las", 250000, 7)
    w.deliver("g.las", right["g.las"])
    d.start()
    w.gate.close("pread", "/g.las", 4)
    w.env["PAUSES"] += " 1" * e2e.PATIENCE  # until the daemon is there again, however long that takes
    p = w.start()
    w.gate.wait()
    d.stop(signal.SIGKILL)
    w.gate.open()
    d.start()
    got, _ = w.finish(p, "the daemon is killed and started in a push", 0)
    w.env["PAUSES"] = "0.05 0.1"
    expect(int(got[0]) + int(got[1]) == 2, got)

    w.night = "2026-03-08"
    right["h.las"] = make("h.las", 200000, 8)
    w.deliver("h.las", right["h.las"])
    held = d.ctl("cache", "stat", "--json").ok().json()["kinds"]["datasets"]["bytes"]
    d.stop()
    plenty = list(d.command)
    d.command += ["--disk", str(held + (2 << 20))]
    d.start()
    w.run("the disk is full", 74)
    d.stop()
    d.command = plenty
    d.start()
    w.gate.close("pread", "/h.las", 4)
    p = w.start()
    w.gate.wait()
    os.killpg(p.pid, signal.SIGKILL)
    w.gate.open()
    w.finish(p, "the script is killed in a push", -signal.SIGKILL)
    until(w.free, "what the script had started holds its lock")
    w.run("and runs again", 0)
    w.run("and once more", 0, 0, 0, 0, 0)
    check(w, d, right)


def check(w, d, right):
    expect(w.left() == [".hidden.las"], "left behind: %s" % w.left())
    kept = set()
    for path in glob.glob(os.path.join(w.incoming, "done/*")) + glob.glob(os.path.join(w.incoming, "failed/*")):
        with open(path, "rb") as f:
            kept.add(hashlib.sha256(f.read()).hexdigest())
    expect(w.delivered <= kept, "%d of what was delivered is in no folder" % len(w.delivered - kept))
    pristine = os.path.join(w.base, "pristine")
    os.mkdir(pristine)
    for name, data in right.items():
        with open(os.path.join(pristine, name), "wb") as f:
            f.write(data)
    with Daemon(pristine, memory="64M") as other:
        other.ctl("push", "valley", *(os.path.join(pristine, n) for n in right)).ok()
        want = other.ctl("submit", "valley", "--ground", "--wait", "--json").ok().json()
        points = [x.ctl("dataset", "show", "valley", "--json").ok().json()["points"] for x in (d, other)]
    expect(points[0] == points[1], "%d points, the right files have %d" % tuple(points))
    have = d.ctl("submit", "valley", "--ground", "--wait", "--json").ok().json()
    expect((have["digest"], have["vertex_digest"]) == (want["digest"], want["vertex_digest"]), "another mesh than the right files make")
    meshes = sorted(n for n in os.listdir(w.out) if not n.startswith("ground.ply"))
    expect(meshes == ["ground-2026-03-%02d.ply" % n for n in (2, 3, 4, 5, 7, 8)], meshes)
    expect(os.readlink(os.path.join(w.out, "ground.ply")) == meshes[-1], "the link")
    e2e.run([e2e.VERIFY, os.path.join(w.out, "ground.ply")]).ok()
    with open(os.path.join(w.out, "ground.ply"), "rb") as f:
        expect(want["digest"].encode() in f.read(4096), "the last file is of another mesh")
    with open(os.path.join(w.incoming, "ingest.log")) as f:
        expect("digest=%s" % want["digest"] in f.read().splitlines()[-1], "the last line of the log")


def shell():
    if not shutil.which("flock"):
        print("skipped: there is no flock(1) (shell)")
        return
    week("nightly-ingest.sh")


def python():
    week("nightly-ingest.py")


def shellchecked():
    if not shutil.which("shellcheck"):
        print("skipped: there is no shellcheck")
        return
    e2e.run(["shellcheck", os.path.join(EXAMPLES, "nightly-ingest.sh")]).ok()


e2e.main(shellchecked, shell, python)
