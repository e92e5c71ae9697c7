"""fetch --resume: the client is killed at random times, interrupted, or loses its daemon, which comes back with another memory or
without its cache. The file is that of an uninterrupted fetch. Kept state that is damaged, or of another job or other options, is
refused."""
import os
import random
import shutil
import signal
import subprocess

import e2e
from e2e import Daemon, Folder, expect

SMALL = {"memory": "24M", "threads": 2}
POINTS = 300000  # 19 domains
RESUMABLE = ("ply", "obj", "landxml", "dxf", "glb", "stl", "html", "gpkg", "geojson", "dxf-contours")  # tests/client/format/formats.py
NEAR = {"glb": ["--origin", "auto"], "stl": ["--origin", "auto"],  # 32-bit floats
        "gpkg": ["--interval", "1"], "geojson": ["--interval", "0.5", "--base", "0.1", "--simplify", "0.2"],
        "dxf-contours": ["--format=dxf-contours", "--interval", "1m"]}
OFTEN = {"ACUT_FETCH_SYNC": "1"} # durable after every block


def survey(base, points=POINTS, name="survey.las", seed=1):
    path = os.path.join(base, name)
    e2e.run([e2e.SYNTH, "--points", str(points), "--seed", str(seed), path]).ok()
    return path


def area(d, base, name="area.wkt", part=0.6):
    """The path of a triangle in the lower left of the dataset s."""
    shown, path = d.ctl("dataset", "show", "s", "--json").ok().json(), os.path.join(base, name)
    x, y, right, top = [float(v) for v in shown["min"][:2] + shown["max"][:2]]
    with open(path, "w") as f:
        f.write("POLYGON ((%f %f, %f %f, %f %f))" % (x - 1, y - 1, x + part * (right - x), y, x, y + part * (top - y)))
    return path


def begin(d, *args, env=OFTEN, gate=None):
    return subprocess.Popen([e2e.ACUTCTL] + list(args), env=dict(os.environ, ACUT_SOCKET=d.socket, **env, **(gate.env if gate else {})),
                            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def held(d, gate, states, *args):
    """A fetch that is stopped after it has kept its state so often; None: it ended before."""
    gate.close("renameat", ".part.state", states)
    p = begin(d, *args, gate=gate)
    return p if gate.wait(lambda: p.poll() is not None) else p.communicate() and None


def parts(folder):
    return sorted(n for n in os.listdir(folder) if ".part" in n)


def read(path):
    with open(path, "rb") as f:
        return f.read()


def killed_client():
    rng = random.Random(7)
    with Folder() as base, Daemon(base, **SMALL) as d:
        gate = e2e.Gate(base)
        d.ctl("push", "s", survey(base)).ok()
        d.ctl("submit", "s", "--wait").ok()
        erased = area(d, base)
        for n, options in enumerate([[kind, *NEAR.get(kind, [])] for kind in RESUMABLE] +
                                    [["ply", "obj", "landxml", "--max-edge", "4"], ["ply", "--erase", erased], ["ply", "--origin", "auto"], ["dxf", "--polyface"]]):
            want = os.path.join(base, "all%d." % n)
            got = os.path.join(base, "got%d." % n)
            kinds, rest = [o for o in options if o in RESUMABLE], [o for o in options if o not in RESUMABLE]
            outs = lambda stem: [w for k in kinds for w in ("-o", stem + k)]
            full = d.ctl("fetch", "1", "--json", *outs(want), *rest).ok().json()
            # The call at which it is killed: the n-th write of a part, faces or state, or the n-th rename of the state
            # since it began. The first two kills come before any state is kept, the third after that.
            resume, kills = [], 0
            for call, text, least, most in (("pwrite", ".part", 0, 1), ("pwrite", ".part.state", 0, 1), ("renameat", ".part.state", 1, 3),
                                            ("pwrite", ".part", 0, 9), ("fsync", ".part", 0, 7), ("pwrite", ".part.state", 0, 3)):
                gate.close(call, text, rng.randrange(least, most))
                p = begin(d, "fetch", "1", "--json", *outs(got), *rest, *resume, gate=gate)
                kills += gate.wait(lambda: p.poll() is not None)
                p.kill()
                _, err = p.communicate()
                expect(p.returncode == -signal.SIGKILL, "it was over before it was killed (%d): %s" % (p.returncode, err))
                resume = ["--resume"] if os.path.exists(got + kinds[0] + ".part.state") else []
            expect(resume, "%s: killed %d times, and nothing is kept" % (options, kills))
            gate.open()
            result = d.ctl("fetch", "1", "--json", *outs(got), *rest, *resume).ok().json()
            for key in ("digest", "vertex_digest", "triangles", "vertices", "output_bytes", "left_out"):
                expect(result[key] == full[key], "%s: %s, not %s" % (key, result[key], full[key]))
            for k in kinds:
                # LandXML and HTML have the file's name in them.
                data = read(got + k)
                for before in (b'name="', b"<title>", b'"name":"'):
                    data = data.replace(before + b"got", before + b"all")
                expect(data == read(want + k), "%s differs" % (got + k))
        d.ctl("fetch", "1", "-o", os.path.join(base, "last.ply")).ok()
        expect(not [n for n in parts(base) if not n.startswith("got")], "left behind: %s" % parts(base))


def killed_in_a_window():
    """The stream of an area that is cut into pieces: its client is killed after each block in turn, sometimes the daemon, too.
    The joined file is that of an undisturbed fetch."""
    with Folder() as base, Daemon(base, **SMALL) as d:
        gate = e2e.Gate(base)
        want, out = base + "/want.ply", base + "/m.ply"
        d.ctl("push", "s", survey(base, 200000)).ok()
        d.ctl("submit", "s", "--wait").ok()
        shown = d.ctl("dataset", "show", "s", "--json").ok().json()
        lo, hi = shown["min"], shown["max"]
        box = "--bbox=" + ",".join("%.2f" % (lo[i % 2] + (hi[i % 2] - lo[i % 2]) * f) for i, f in enumerate((.05, .05, .95, .9)))
        full = d.ctl("fetch", "1", box, "--json", "-o", want).ok().json()
        expect(full["pieces"] > 2, "%d pieces" % full["pieces"])
        kills, p = 0, True
        while p:
            resume = ["--resume"] if os.path.exists(out + ".part.state") else []
            # A fetch keeps a state at its begin where it goes on; then one a block.
            p = held(d, gate, 1, "fetch", "1", box, "-o", out, "--json", *resume)
            if p:
                kills += 1
                p.kill()
                p.communicate()
                expect(kills < 10 * full["pieces"], "it does not get on")
                if kills % 3 == 0:
                    d.stop(signal.SIGKILL)
                    d.start()
        gate.open()
        expect(kills >= full["pieces"] - 2, "killed %d times in %d pieces" % (kills, full["pieces"]))
        print("     %d times killed in %d pieces" % (kills, full["pieces"]))
        expect(read(out) == read(want), "what was joined differs")
        expect(not parts(base), "left behind: %s" % parts(base))
        # Another area is another stream.
        p = held(d, gate, 1, "fetch", "1", box, "-o", out)
        p.kill()
        p.communicate()
        gate.open()
        says(d.ctl("fetch", "1", "-o", out, "--resume"), 1, "cannot be continued")


def gone_window():
    """The pieces of an area depend on the memory of the daemon, their order on the segments. With another memory, or after a
    merge, kept state cannot be continued; it is not removed."""
    with Folder() as base:
        out, want = base + "/m.ply", base + "/want.ply"
        gate = e2e.Gate(base)

        def kept():
            return [n for n in parts(base) if not n.endswith(".new")]

        def begun(d, box):
            p = held(d, gate, 1, "fetch", "1", box, "-o", out)
            p.kill()
            p.communicate()
            gate.open()

        def gone(d, box):
            before = kept()
            expect("m.ply.part.state" in before, "kept: %s" % before)
            says(d.ctl("fetch", "1", box, "-o", out, "--resume"), 1, "cannot be continued", "from its start")
            expect(kept() == before, "%s, not %s" % (kept(), before))

        with Daemon(base, **SMALL) as d:
            for seed in (1, 2, 3):
                d.ctl("push", "s", survey(base, 60000, "s%d.las" % seed, seed)).ok()
            d.ctl("submit", "s", "--wait").ok()
            shown = d.ctl("dataset", "show", "s", "--json").ok().json()
            expect(shown["segments"] == 3, "%s" % shown)
            lo, hi = shown["min"], shown["max"]
            box = "--bbox=" + ",".join("%.2f" % (lo[i % 2] + (hi[i % 2] - lo[i % 2]) * f) for i, f in enumerate((.05, .05, .95, .9)))
            full = d.ctl("fetch", "1", box, "-o", want, "--json").ok().json()
            begun(d, box)
            d.stop()
        with Daemon(base, memory="96M", threads=2) as d:
            gone(d, box)
            d.stop()
        with Daemon(base, **SMALL) as d:
            d.ctl("fetch", "1", box, "-o", out, "--resume").ok()
            expect(read(out) == read(want) and not parts(base), "with the memory of then it does not go on")
            begun(d, box)
            # The fourth of about this size is merged with the others.
            d.ctl("push", "s", survey(base, 60000, "s4.las", 4)).ok()
            e2e.until(lambda: d.ctl("dataset", "show", "s", "--json").ok().json()["segments"] == 1, "nothing is merged")
            gone(d, box)
            again = d.ctl("fetch", "1", box, "-o", out, "--json").ok().json()
            expect(again["digest"] == full["digest"] and not parts(base), "the same area is another: %s, %s" % (again, full))


def killed_daemon():
    with Folder() as base:
        gate = e2e.Gate(base)
        d = Daemon(base, **SMALL).start()
        path = survey(base)
        d.ctl("push", "s", path).ok()
        # A fetch of a job that runs, too.
        d.ctl("submit", "s").ok()
        out, step = os.path.join(base, "m.ply"), 0
        for memory, threads, lose in (("96M", 1, False), ("24M", 2, True), ("200M", 2, True)):
            p = held(d, gate, 3, "fetch", "1", "-o", out, *(["--resume"] if step else []))
            expect(p, "it was over before its third state")
            d.stop(signal.SIGKILL)
            gate.open()
            _, err = p.communicate()
            expect(p.returncode in (69, 74) and "acutctl fetch 1 --resume" in err, "%d %s" % (p.returncode, err))
            expect(os.path.exists(out + ".part.state") and not os.path.exists(out), "what is kept")
            if lose:
                shutil.rmtree(d.cache)
            d = Daemon(base, memory=memory, threads=threads).start()
            step += 1
        got = d.ctl("fetch", "1", "-o", out, "--resume", "--json").ok().json()
        d.ctl("fetch", "1", "-o", out + "2.ply").ok()
        expect(read(out) == read(out + "2.ply"), "the file differs")
        shown = d.ctl("show", "1", "--json").ok().json()
        expect(got["digest"] == shown["digest"] and not parts(base), "%s %s" % (got, parts(base)))
        e2e.run([e2e.VERIFY, out, path]).ok()
        d.stop(signal.SIGKILL)


def says(run, status, *texts):
    expect(run.status == status, "status %d, not %d: %s%s" % (run.status, status, run.out, run.err))
    for t in texts:
        expect(t in run.err + run.out, "%r is not in %s%s" % (t, run.out, run.err))


def interrupted(d, gate, out, *args):
    """A fetch that is ended by Ctrl-C keeps its state."""
    for n in parts(os.path.dirname(out)):
        os.unlink(os.path.join(os.path.dirname(out), n))
    p = held(d, gate, 2, "fetch", "1", "-o", out, *args)
    expect(p, "it was over before it was interrupted")
    p.send_signal(signal.SIGINT)
    gate.open()
    _, err = p.communicate()
    expect(p.returncode == 130 and "acutctl fetch 1 --resume" in err, "%d %s" % (p.returncode, err))


def flip(path, at):
    with open(path, "r+b") as f:
        f.seek(at, os.SEEK_SET if at >= 0 else os.SEEK_END)
        byte = f.read(1)[0]
        f.seek(at, os.SEEK_SET if at >= 0 else os.SEEK_END)
        f.write(bytes([byte ^ 4]))


def refused():
    with Folder() as base, Daemon(base, **SMALL) as d:
        gate = e2e.Gate(base)
        d.ctl("push", "s", survey(base)).ok()
        d.ctl("submit", "s", "--wait").ok()
        d.ctl("submit", "s", "--wait", "--every", "2").ok()
        want, out = os.path.join(base, "want.ply"), os.path.join(base, "m.ply")
        d.ctl("fetch", "1", "-o", want).ok()
        says(d.ctl("fetch", "1", "-o", out, "--resume"), 1, "nothing is kept")
        for more, text in ((["-o", base + "/m.png"], "png cannot be resumed"), (["-o", out, "--canonical"], "--canonical"),
                           (["-o", "/dev/null", "--format", "ply"], "regular file"), (["--format", "null"], "resume")):
            says(d.ctl("fetch", "1", "--resume", *more), 2, text)
        interrupted(d, gate, out)
        kept = {n: read(os.path.join(base, n)) for n in parts(base)}
        expect(sorted(kept) == ["m.ply.part", "m.ply.part.faces", "m.ply.part.state"], str(sorted(kept)))

        def restore():
            for n, data in kept.items():
                with open(os.path.join(base, n), "wb") as f:
                    f.write(data)

        says(d.ctl("fetch", "2", "-o", out, "--resume"), 2, "another job")
        says(d.ctl("fetch", "1", "-o", out, "--resume", "--origin", "auto"), 2, "options")
        says(d.ctl("fetch", "1", "-o", out, "--resume", "--mask", area(d, base)), 2, "options")
        says(d.ctl("fetch", "1", "-o", out, "-o", base + "/m.obj", "--resume"), 2, "outputs")
        expect({n: read(os.path.join(base, n)) for n in parts(base)} == kept, "a refusal has changed what was kept")
        size = os.path.getsize(out + ".part")
        for name, harm, text in ((".part", lambda p: flip(p, size // 2), "not the part of an earlier fetch"),
                                 (".part", lambda p: os.truncate(p, 10000), "shorter"),
                                 (".part", os.unlink, "is gone"),
                                 (".part.faces", lambda p: flip(p, 100), "not the part of an earlier fetch"),
                                 (".part.faces", lambda p: os.truncate(p, 100), "shorter"),
                                 (".part.faces", os.unlink, "is gone"),
                                 (".part.state", lambda p: flip(p, -30), "damaged"),
                                 (".part.state", lambda p: flip(p, 5), "damaged"),
                                 (".part.state", lambda p: os.truncate(p, 40), "damaged")):
            restore()
            harm(out + name)
            says(d.ctl("fetch", "1", "-o", out, "--resume"), 74, text, name, "without --resume")
            expect(not os.path.exists(out), "an output of a refused fetch")
        restore()
        # Not the header, which is written at the end, and nothing behind what the state says.
        with open(out + ".part", "ab") as f:
            f.write(b"rubbish" * 1000)
        flip(out + ".part", 0)
        d.ctl("fetch", "1", "-o", out, "--resume").ok()
        expect(read(out) == read(want) and not parts(base), "it went on with rubbish")
        # Two at a time into one file.
        interrupted(d, gate, out)
        p = held(d, gate, 0, "fetch", "1", "-o", out, "--resume")
        expect(p, "it was over before it kept anything")
        got = d.ctl("fetch", "1", "-o", out)
        says(got, 75, "another fetch writes it")
        gate.open()
        _, err = p.communicate()
        expect(p.returncode == 0, "%d %s" % (p.returncode, err))
        # Another area under the same name.
        interrupted(d, gate, out, "--mask", area(d, base))
        area(d, base, part=0.5)
        says(d.ctl("fetch", "1", "-o", out, "--mask", base + "/area.wkt", "--resume"), 2, "options")
        area(d, base)
        d.ctl("fetch", "1", "-o", out, "--mask", base + "/area.wkt", "--resume").ok()
        expect(os.path.getsize(out) < os.path.getsize(want) and not parts(base), "with the area of the earlier fetch")
        # Another tolerance of contours.
        lines = os.path.join(base, "l.gpkg")
        interrupted(d, gate, lines, "--interval", "1", "--simplify", "0.2")
        for other in (["--simplify", "0.3"], ["--simplify", "0.2ft"], []):
            says(d.ctl("fetch", "1", "-o", lines, "--interval", "1", "--resume", *other), 2, "options")
        d.ctl("fetch", "1", "-o", lines, "--interval", "1", "--simplify", "0.2", "--resume").ok()
        d.ctl("fetch", "1", "-o", lines + ".new.gpkg", "--interval", "1", "--simplify", "0.2").ok()
        expect(read(lines) == read(lines + ".new.gpkg") and not parts(base), "simplified contours that were continued are others")
        # A leftover is replaced by a fetch that does not go on.
        interrupted(d, gate, out)
        d.ctl("fetch", "1", "-o", out).ok()
        expect(read(out) == read(want) and not parts(base), "a leftover")
        # A state that the daemon cannot continue: there is a message, and nothing is lost.
        interrupted(d, gate, out)
        before = parts(base)
        d.stop()
        os.unlink(os.path.join(d.state, "plans", "plan-1"))
        with Daemon(base, memory="256M", threads=2) as other:
            got = other.ctl("fetch", "1", "-o", out, "--resume", "--json")
            expect(got.status == 1 and got.json()["error"]["code"] == "stream-gone", "%d %s %s" % (got.status, got.out, got.err))
            expect(parts(base) == before, "%s, not %s" % (parts(base), before))
            other.ctl("fetch", "1", "-o", out).ok()
            expect(not parts(base), "left behind: %s" % parts(base))


def full_disk():
    """The disk is full: what came is kept, and the fetch goes on when there is space."""
    with Folder() as base, Daemon(base, **SMALL) as d:
        d.ctl("push", "s", survey(base)).ok()
        d.ctl("submit", "s", "--wait").ok()
        out, want = os.path.join(base, "m.ply"), os.path.join(base, "want.ply")
        d.ctl("fetch", "1", "-o", want).ok()
        # Too little for anything to go on with: nothing stays.
        p = subprocess.run(["prlimit", "--fsize=4096", e2e.ACUTCTL, "fetch", "1", "-o", out],
                           env=dict(os.environ, ACUT_SOCKET=d.socket), capture_output=True, text=True)
        expect(p.returncode == 74 and "--resume" not in p.stderr, "%d %s" % (p.returncode, p.stderr))
        expect(not parts(base) and not os.path.exists(out), "left behind: %s" % parts(base))
        # Too little for the vertices; enough for them, and not for all.
        for limit in (os.path.getsize(want) // 4, os.path.getsize(want) // 4 * 3):
            for resume in ([], ["--resume"]):
                p = subprocess.run(["prlimit", "--fsize=%d" % limit, e2e.ACUTCTL, "fetch", "1", "-o", out] + resume,
                                   env=dict(os.environ, ACUT_SOCKET=d.socket, **OFTEN), capture_output=True, text=True)
                expect(p.returncode == 74 and "acutctl fetch 1 --resume" in p.stderr, "%d %s" % (p.returncode, p.stderr))
                expect(not os.path.exists(out), "an output that is not whole")
            d.ctl("fetch", "1", "-o", out, "--resume").ok()
            expect(read(out) == read(want) and not parts(base), "after the disk was full")
            os.unlink(out)


if __name__ == "__main__":
    e2e.main(killed_client, killed_in_a_window, gone_window, killed_daemon, refused, full_disk)
