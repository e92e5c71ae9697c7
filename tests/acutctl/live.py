"""acutctl with a real acutd: outputs, views and reports of mesh, and its private daemons."""
import contextlib
import fcntl
import json
import os
import pty
import re
import select
import shutil
import signal
import sqlite3
import struct
import subprocess
import sys
import tempfile
import termios
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e  # noqa: E402
from checks import check, end  # noqa: E402

ACUTCTL, ACUTD, SYNTH = (os.environ[k] for k in ("ACUTCTL", "ACUTD", "ACUT_SYNTH"))
for program in (ACUTD, SYNTH):
    if not os.access(program, os.X_OK):
        print("skipped: %s is not built" % program)
        sys.exit(77)
if os.path.exists("/run/acut/acutd.sock"):
    print("skipped: a system daemon runs, private ones are not tested")
    sys.exit(77)


class Place:
    """A user with separate folders for everything that a private daemon keeps."""

    def __init__(self, base):
        self.base = base
        self.run = os.path.join(base, "run")
        os.mkdir(self.run, 0o700)
        self.env = {k: v for k, v in os.environ.items() if not k.startswith(("ACUT", "XDG_"))}
        self.env.update(HOME=base, XDG_RUNTIME_DIR=self.run, XDG_STATE_HOME=base + "/state", XDG_CACHE_HOME=base + "/cache",
                        ACUT_ACUTD=ACUTD)
        self.log = self.run + "/acut/acutd.log"

    def path(self, name):
        return os.path.join(self.base, name)

    def start(self, *args, **kw):
        return subprocess.Popen([ACUTCTL, *map(str, args)], env=dict(self.env, **kw.pop("env", {})), stdin=subprocess.DEVNULL,
                                stdout=kw.pop("stdout", subprocess.PIPE), stderr=subprocess.PIPE, **kw)

    def ctl(self, *args, **kw):
        p = self.start(*args, **kw)
        out, err = p.communicate(timeout=e2e.PATIENCE)
        return p.returncode, (out or b"").decode(errors="replace"), err.decode()

    def json(self, *args, **kw):
        got, out, err = self.ctl(*args, "--json", **kw)
        check(" ".join(map(str, args)), got in (0, 3), "%d %s%s" % (got, out, err))
        return json.loads(out.splitlines()[-1])

    def daemons(self):
        """Process ids of the daemons that keep their state below our folders."""
        found = []
        for pid in filter(str.isdigit, os.listdir("/proc")):
            try:
                with open("/proc/%s/cmdline" % pid, "rb") as f:
                    words = f.read().split(b"\0")
            except OSError:
                continue
            if any(w.startswith(self.base.encode()) for w in words) and words[0].endswith(b"acutd"):
                found.append(int(pid))
        return found

    def end(self):
        for sig in (signal.SIGTERM, signal.SIGKILL):
            for pid in self.daemons():
                with contextlib.suppress(ProcessLookupError):  # one of a single command ends by itself
                    os.kill(pid, sig)
            wait_for(lambda: not self.daemons())


def wait_for(cond):
    end = time.monotonic() + e2e.PATIENCE
    while time.monotonic() < end:
        if cond():
            return True
        time.sleep(0.05)
    return cond()


def read_ply(path):
    with open(path, "rb") as f:
        data = f.read()
    at = data.index(b"end_header\n") + 11
    head = data[:at].decode()
    nv, nf = (int(re.search(r"element %s (\d+)" % k, head).group(1)) for k in ("vertex", "face"))
    check("PLY size of " + path, len(data) == at + 24 * nv + 13 * nf)
    return head, nv, nf, data[at:]


def outputs(p):
    las, other = p.path("a.las"), p.path("b.las")
    for path, seed in ((las, 1), (other, 2)):
        subprocess.run([SYNTH, "--points", "60000", "--seed", str(seed), path], check=True)
    ply, obj, png = p.path("m.ply"), p.path("m.obj"), p.path("m.png")
    got = p.json("mesh", las, other, "-o", ply, "-o", obj, "-o", png, "--width", "300")
    head, nv, nf, _ = read_ply(ply)
    check("counts", (nv, nf) == (got["vertices"], got["triangles"]), str(got))
    check("digests in the header", "comment acut-digest %s %s\n" % (got["digest"], got["vertex_digest"]) in head, head)
    check("bytes", got["output_bytes"] == sum(os.path.getsize(x) for x in (ply, obj, png)))
    with open(obj) as f:
        kinds = [line[0] for line in f]
    check("OBJ", (kinds.count("v"), kinds.count("f")) == (nv, nf))
    with open(png, "rb") as f:
        data = f.read()
    check("PNG", data[:8] == b"\x89PNG\r\n\x1a\n" and 0 < struct.unpack(">I", data[16:20])[0] <= 300)
    check("keys", not [k for k in ("job dataset generation points used vertices triangles hull domains digest vertex_digest "
                                   "lattice crs units removed seconds stage_seconds first_triangle_seconds peak_rss_bytes "
                                   "output_bytes halo points_read cells_read seal_seconds plan_seconds domains_seconds left_out refused warnings").split() if k not in got], str(got))
    check("phases", 0 < got["seal_seconds"] <= got["stage_seconds"] and 0 < got["plan_seconds"] and 0 < got["domains_seconds"]
          and got["plan_seconds"] + got["domains_seconds"] <= got["seconds"] + 0.001, str(got))
    # Canonical files do not depend on the order of inputs; the same on standard output.
    files = [p.path("c%d.ply" % i) for i in range(2)]
    p.json("mesh", las, other, "-o", files[0], "--canonical")
    p.json("mesh", other, las, "-o", files[1], "--canonical", "--memory", "24M", "--threads", "1")
    first, second = (open(f, "rb").read() for f in files)
    check("canonical is the same file", first == second)
    with open(p.path("s.ply"), "wb") as f:
        status, _, err = p.ctl("mesh", las, other, "-o", "-", "--format", "ply", "--canonical", "--quiet", stdout=f)
    head, nv2, nf2, body = read_ply(p.path("s.ply"))
    check("standard output", status == 0 and err == "" and body == read_ply(files[0])[3], "%d %s" % (status, err))
    # Options after an -o apply to that output. Options before the first -o, or given once, apply to all.
    one, two, three = p.path("one.ply"), p.path("two.obj"), p.path("three.png")
    p.json("mesh", las, other, "--origin", "1,2,3", "-o", one, "--canonical", "-o", two, "--canonical", "--origin", "4,5,6", "-o", three,
           "--width", "40", "-o", p.path("four.png"), "--width", "50")
    origin = re.compile(r"acut-origin (.*)$", re.M)
    check("an origin each", (origin.search(read_ply(one)[0]).group(1), origin.search(open(two).read()).group(1)) == ("1 2 3", "4 5 6"))
    widths = [struct.unpack(">I", open(x, "rb").read()[16:20])[0] for x in (three, p.path("four.png"))]
    check("a width each", widths[0] <= 40 < widths[1] <= 50, str(widths))
    check("in canonical order", read_ply(one)[3][24 * nv:] == read_ply(files[0])[3][24 * nv:])
    p.json("mesh", las, "-o", p.path("x.ply"), "--format", "obj", "-o", p.path("y.obj"), "--format", "ply")
    check("a format each", open(p.path("x.ply")).read(1) == "#" and open(p.path("y.obj"), "rb").read(3) == b"ply")
    p.json("mesh", las, other, "-o", one, "-o", two, "--canonical", "--origin", "auto")
    check("given once, of all", origin.search(read_ply(one)[0]) and origin.search(open(two).read()) and
          read_ply(one)[3][24 * nv:] == read_ply(files[0])[3][24 * nv:])
    # Filters.
    left = p.json("mesh", las, other, "-o", p.path("e.ply"), "--max-edge", "2.5")
    check("--max-edge leaves the mesh whole", left["digest"] == got["digest"] and left["triangles"] == nf)
    check("--max-edge counts", read_ply(p.path("e.ply"))[2] == nf - left["left_out"]["triangles"]
          and left["left_out"]["triangles"] > 0 and left["left_out"]["area"] > 0, str(left["left_out"]))
    # A coarser lattice moves points. They are counted, and the largest shift is reported. A warning is printed once.
    coarse = p.json("mesh", las, "-o", p.path("e.ply"), "--scale", "1")
    check("moved points", 0 < coarse["moved"] <= 60000 and 0 < max(coarse["max_shift"][:2]) <= 0.5, str(coarse))
    said = p.ctl("mesh", las, "-o", p.path("e.ply"), "--scale", "1")
    check("moved points as text", "rounded to the lattice: " in said[1], str(said))
    check("nothing moved", got["moved"] == 0 and got["max_shift"] == [0, 0, 0], str(got))
    with open(las, "rb") as f, open(p.path("short.las"), "wb") as g:
        g.write(f.read()[:-7])
    said = p.ctl("mesh", p.path("short.las"), "-o", p.path("e.ply"), "--accept-truncated")[2]
    check("a warning once", said.count("59999 of 60000 points are there") == 1, said)
    # The same for a header with an error and bytes after the points, which are reported when all was read.
    with open(las, "rb") as f, open(p.path("odd.las"), "wb") as g:
        data = bytearray(f.read())
        data[100:104] = (int.from_bytes(data[100:104], "little") + 1).to_bytes(4, "little")
        g.write(data + b"rest")
    said = p.ctl("mesh", p.path("odd.las"), "-o", p.path("e.ply"))[2]
    both = ("variable length records claimed", "4 bytes behind the last point")
    check("warnings once", [said.count(w) for w in both] == [1, 1], said)
    said = p.json("mesh", p.path("odd.las"), "-o", p.path("e.ply"))["warnings"]
    check("warnings once in JSON", [sum(w in t for t in said) for w in both] == [1, 1], str(said))
    said = p.json("info", p.path("odd.las"))
    check("info tells once", "claimed" in said["warning"] and len(said["differences"]) == 1, str(said))
    ground = p.json("mesh", las, "-o", p.path("g.ply"), "--ground")
    check("--ground", 0 < ground["used"] < ground["points"] and ground["removed"]["class"] > 0, str(ground))
    # A broken file among good ones.
    bad = p.path("bad.las")
    with open(las, "rb") as f, open(bad, "wb") as g:
        g.write(f.read()[:-7])
    status, out, err = p.ctl("mesh", las, bad, p.path("none.las"), "-o", p.path("x.ply"), "--json")
    got3 = json.loads(out)
    check("refused inputs", status == 3 and [r["file"] for r in got3["refused"]] == [bad, p.path("none.las")], out + err)
    status, out, err = p.ctl("mesh", las, bad, "-o", p.path("y.ply"), "--strict")
    check("--strict", status == 1 and not os.path.exists(p.path("y.ply")) and bad in err, "%d %s" % (status, err))
    status, _, err = p.ctl("mesh", bad, "-o", p.path("y.ply"))
    check("nothing good", status == 1 and bad in err, err)
    # Counted and digested, not written.
    before = set(os.listdir(p.base))
    same = p.json("mesh", las, other, "--format", "null", cwd=p.base)
    check("--format null", set(os.listdir(p.base)) == before and same["output_bytes"] == 0 and all(
        same[k] == got[k] for k in ("digest", "vertex_digest", "vertices", "triangles", "hull")), str(same))
    # Lists, folders, standard input.
    os.mkdir(p.path("dir"))
    shutil.copy(las, p.path("dir/1.LAS"))
    os.mkdir(p.path("dir/sub"))
    shutil.copy(other, p.path("dir/sub/2.las"))
    with open(p.path("dir/readme.txt"), "w") as f:
        f.write("not a survey\n")
    with open(p.path("list"), "w") as f:
        f.write("%s\n\n%s\n" % (las, other))
    for words in (["dir"], ["@list"]):
        words = [w if w[0] == "@" else p.path(w) for w in words]
        same = p.json("mesh", *words, "-o", p.path("z.ply"), cwd=p.base)
        check(" ".join(words), same["digest"] == got["digest"] and same["vertex_digest"] == got["vertex_digest"], str(same))
    q = subprocess.run([ACUTCTL, "mesh", "-", "--input-format", "xyz", "-o", p.path("t.obj"), "--json"], input=b"0 0 1\n1 0 2\n0 1 3\n",
                       stdout=subprocess.PIPE, env=p.env, timeout=e2e.PATIENCE)
    check("standard input", q.returncode == 0 and json.loads(q.stdout)["triangles"] == 1, q.stdout)
    status, out, err = p.ctl("info", las, other, "--json")
    check("info", status == 0 and [json.loads(line)["points"] for line in out.splitlines()] == [60000, 60000], out + err)
    # The reader of standard output exits; the disk is full.
    r, w = os.pipe()
    os.close(r)
    check("a closed pipe", p.ctl("mesh", las, "-o", "-", "--format", "obj", "-q", stdout=w)[0] == 141)
    os.close(w)
    check("a full disk", p.ctl("mesh", las, "-o", "/dev/full", "--format", "ply")[0] == 74)
    check("no temporary files", not [n for n in os.listdir(p.base) if n.endswith(".part")], str(os.listdir(p.base)))


def interruption(p):
    big = p.path("big.las")
    subprocess.run([SYNTH, "--points", "1M", big], check=True)
    # The shared daemon is stopped in the middle of a mesh; for a private daemon the client is stopped while it writes.
    gate = e2e.Gate(p.base)
    p.end()
    for sig, status in ((signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)):
        for own in ([], ["--memory", "32M", "--threads", "1"]):
            gate.close(*(("pwrite", p.base, 2, "acutctl") if own else ("pread", ".seg")))
            q = p.start("mesh", big, "-o", p.path("big.ply"), *own, env=gate.env)
            check("in the middle", gate.wait(lambda: q.poll() is not None))
            q.send_signal(sig)
            gate.open()
            _, err = q.communicate(timeout=e2e.PATIENCE)
            check("signal %d %s" % (sig, own), q.returncode == status, "%d %s" % (q.returncode, err))
            check("nothing is left", not [n for n in os.listdir(p.base) if "big.ply" in n], str(os.listdir(p.base)))
    gate.close("pwrite", p.base, 2, "acutctl")
    q = p.start("mesh", big, "-o", p.path("big.ply"), env=gate.env)
    check("in the middle", gate.wait(lambda: q.poll() is not None))
    q.kill()
    q.communicate(timeout=e2e.PATIENCE)
    left = [n for n in os.listdir(p.base) if "big.ply" in n]
    check("killed, nothing is left", q.returncode == -9 and not left, "%d %s" % (q.returncode, left))
    gate.close("pread", ".seg")
    status, _, err = p.ctl("mesh", big, "-o", p.path("big.ply"), "--timeout", "0.2", "--memory", "32M", env=gate.env)
    gate.open()
    check("--timeout", status == 124 and "0.2" in err, "%d %s" % (status, err))
    # The job ends with its client, since it is bound to it.
    check("no job runs on", wait_for(lambda: p.json("status", "--private")["jobs_running"] == 0))


def progress(p):
    """There is a progress line on a terminal, and none without."""
    # A daemon of its own, which continues in small steps until the line has all its parts.
    gate = e2e.Gate(p.base)
    slow = ["--memory", "24M", "--threads", "1"]
    for options, wanted in ((slow, True), (slow + ["--no-progress"], False), (slow + ["--quiet"], False), (slow + ["--json"], False)):
        gate.close("pread", ".seg", 400 if wanted else 1 << 30)
        try:
            main, side = pty.openpty()
        except OSError as e:
            print("progress: skipped, no terminal can be had:", e)
            return
        q = subprocess.Popen([ACUTCTL, "mesh", p.path("big.las"), "-o", p.path("t.ply"), *options], env={**p.env, **gate.env},
                             stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=side)
        os.close(side)
        seen = b""
        while True:
            if not select.select([main], [], [], 0.5 if wanted is True else None)[0]:
                gate.close("pread", ".seg", 20) # a rate needs some time and new points
                continue
            try:
                part = os.read(main, 4096)
            except OSError:
                break
            if not part:
                break
            seen += part
            if wanted is True and b"mesh" in seen and b"% " in seen and b"/s" in seen:
                wanted = "seen"
                gate.open()
        os.close(main)
        check("status", q.wait(e2e.PATIENCE) == 0)
        # The note about classes comes after the last line of progress.
        seen = re.sub(rb"acutctl: note: points of all classes[^\r\n]*\r\n", b"", seen)
        check("progress with %s" % options, (b"mesh" in seen and b"% " in seen and b"/s" in seen
                                             and seen.endswith(b"\r\x1b[K")) == bool(wanted), repr(seen[-400:]))
        check("nothing else with %s" % options, wanted or not seen, repr(seen))


def on_terminal(p, width, *args, env=None, gate=None):
    """Standard output and error of a run on a terminal of that width; None without one. A gate is opened at the first output."""
    try:
        main, side = pty.openpty()
    except OSError as e:
        print("terminal: skipped, none can be had:", e)
        return None
    fcntl.ioctl(side, termios.TIOCSWINSZ, struct.pack("HHHH", 24, width, 0, 0))
    full = dict(p.env, TERM="xterm", **(env or {}))
    full.pop("COLUMNS", None)
    q = subprocess.Popen([ACUTCTL, *args], env=full, stdin=subprocess.DEVNULL, stdout=side, stderr=side)
    os.close(side)
    seen = b""
    while True:
        try:
            part = os.read(main, 65536)
        except OSError:
            break
        if not part:
            break
        seen += part
        if gate:
            gate.open()
    os.close(main)
    check("status of " + " ".join(args), q.wait(e2e.PATIENCE) == 0, seen)
    return seen.decode()


def terminal(p):
    """In lists and in the report at the end of a mesh no line is wider than the terminal, and NO_COLOR disables colours."""
    las, name = p.path("a.las"), "a-dataset-with-a-rather-long-name-as-scripts-make-them"
    wide = lambda seen: max((len(line) for part in seen.split("\n") for line in re.sub("\x1b\\[[0-9;]*[mK]", "", part).split("\r")), default=0)
    gate = e2e.Gate(p.base)
    for width in (120, 60):
        # The push must take long enough for a line of progress: acutd reports a long push five times a second.
        gate.close("pwrite", ".seg")
        seen = on_terminal(p, width, "mesh", las, "-o", p.path("page.ply"), "--max-edge", "3m", "--memory", "64M", env=gate.env, gate=gate)
        if seen is None:
            return
        check("the page fits %d" % width, wide(seen.split("acutctl: note")[0]) <= width, repr(seen))
        for said in ("written", "page.ply", "MB", "points", "left out", "by withheld", "mesh", "triangles in", "trimmed", "crs", "EPSG:32633",
                     "units", "metre", "time", "points a second", "memory", "digest"):
            check("the page says " + said, said in seen, repr(seen))
        check("progress is gone before the page", "\r\x1b[K" in seen and "%" not in seen[seen.rindex("\r\x1b[K"):], repr(seen))
    check("no colour with NO_COLOR", "\x1b[1m" in seen and "\x1b[1m" not in on_terminal(p, 80, "formats", env={"NO_COLOR": "1"}))
    p.ctl("push", name, las, "--private")
    p.ctl("submit", name, "--private", "--wait")
    for words in (["datasets"], ["jobs"], ["dataset", "log", name], ["dataset", "log", name, "--files"], ["cache", "stat"], ["status"],
                  ["dataset", "show", name], ["show", "1"], ["plan", name], ["formats"], ["config", "show", "--origin"], ["doctor"]):
        for width in (132, 80, 50):
            if words[0] == "show":
                words[1] = p.ctl("jobs", "--private")[1].split("\t")[0]
            seen = on_terminal(p, width, *words, "--private")
            check("%s fits %d" % (" ".join(words), width), wide(seen) <= width, repr(seen))
        rows = p.ctl(*words, "--private")[1].splitlines()
        check("a script sees all of it: " + " ".join(words), words[0] in ("cache", "status", "plan", "formats", "show", "doctor") or
              all(name in r or "\t" in r or words[1:2] == ["show"] for r in rows) and not any("…" in r for r in rows), str(rows))
        if words[0] == "show":
            rules = [r for r in rows if "left out" in r]
            check("rules that left out points, no others", rules and not any(re.search(r"\b0 by ", r) for r in rules), str(rows))
        if words[0] in ("datasets", "jobs", "formats") or words[1:2] == ["log"]:
            check("as many columns in each row: " + " ".join(words), len({r.count("\t") for r in rows}) == 1, str(rows))


def private(p):
    small = p.path("s.xyz")
    with open(small, "w") as f:
        f.write("0 0 1\n1 0 2\n0 1 3\n5 5 5\n")
    p.end()
    check("69 without --private", p.ctl("jobs")[0] == 69)
    # Many commands at the same time start one daemon.
    many = [p.start("mesh", small, "-o", p.path("m%d.obj" % i), "-q") for i in range(12)]
    check("many at once", [q.wait(e2e.PATIENCE) for q in many] == [0] * 12, str([q.stderr.read() for q in many]))
    # Daemons that found another one running are ending.
    check("one daemon", wait_for(lambda: len(p.daemons()) == 1), str(p.daemons()))
    pid = p.daemons()
    status, out, err = p.ctl("push", "d", small, "--private")
    job = p.ctl("submit", "d", "--wait", "--private")[1].split()[0]
    check("fetch", p.ctl("fetch", job, "-o", p.path("f.obj"), "--private")[0] == 0)
    check("the same daemon", p.daemons() == pid)
    check("a job that is not there", p.ctl("show", "99999", "--private")[0] == 4)
    # A killed daemon is replaced, and the pushed data is there.
    os.kill(pid[0], signal.SIGKILL)
    check("killed", wait_for(lambda: not p.daemons()))
    check("the dataset is there", p.json("dataset", "show", "d", "--private")["points"] == 4)
    # A start right after a stop: the new daemon waits for the folders.
    for _ in range(5):
        os.kill(p.daemons()[0], signal.SIGTERM)
        got = p.ctl("ping", "--private")
        check("after a stop", got[0] == 0, str(got))
        check("the one that was stopped is gone", wait_for(lambda: len(p.daemons()) == 1), str(p.daemons()))
    # A daemon that was told to end still accepts a connection.
    pid = p.daemons()[0]
    os.kill(pid, signal.SIGSTOP)
    os.kill(pid, signal.SIGTERM)
    q = p.start("ping", "--private")
    time.sleep(0.5)
    os.kill(pid, signal.SIGCONT)
    _, err = q.communicate(timeout=e2e.PATIENCE)
    check("at a stop", q.returncode == 0, "%d %s" % (q.returncode, err))
    # A daemon that cannot start says why.
    state = p.path("state")
    p.end()
    os.rename(state, state + "2")
    with open(state, "w"):
        pass
    status, _, err = p.ctl("mesh", small, "-o", p.path("n.obj"))
    check("no state folder", status not in (0, 3) and "state" in err, "%d %s" % (status, err))
    os.unlink(state)
    os.rename(state + "2", state)
    with contextlib.closing(sqlite3.connect(state + "/acut/catalogue.db")) as db:
        version = db.execute("PRAGMA user_version").fetchone()[0]
        db.execute("PRAGMA user_version = 99")
    status, _, err = p.ctl("mesh", small, "-o", p.path("n.obj"))
    check("a newer catalogue", status not in (0, 3) and "a newer acutd" in err and "version 99" in err, "%d %s" % (status, err))
    with contextlib.closing(sqlite3.connect(state + "/acut/catalogue.db")) as db:
        db.execute("PRAGMA user_version = %d" % version)
    # Daemons of a single command: their folders are made and removed, also those of a killed one.
    cache = p.path("cache/acut")
    check("own", p.ctl("mesh", small, "-o", p.path("o.obj"), "--memory", "24M", "-q")[0] == 0)
    check("own folders are gone", not [n for n in os.listdir(cache) if n.startswith("own-")], str(os.listdir(cache)))
    gate = e2e.Gate(p.base)
    gate.close("pread", ".seg")
    q = p.start("mesh", p.path("big.las"), "-o", p.path("k.ply"), "--memory", "24M", "--threads", "1", env=gate.env)
    gate.wait()
    check("own daemon runs", [n for n in os.listdir(cache) if n.startswith("own-")] and p.daemons(), str(p.daemons()))
    q.kill()
    gate.open()
    q.communicate()
    check("own daemon ends with its client", wait_for(lambda: not p.daemons()), str(p.daemons()))
    p.ctl("mesh", small, "-o", p.path("o.obj"), "--threads", "1")
    check("left folders are swept", not [n for n in os.listdir(cache) if n.startswith("own-")], str(os.listdir(cache)))
    keep = p.path("kept")
    check("--cache", p.ctl("mesh", small, "-o", p.path("o.obj"), "--cache", keep)[0] == 0 and os.path.isdir(keep))
    # A folder for sockets is not used if others can enter it.
    os.chmod(p.run + "/acut", 0o755)
    status, _, err = p.ctl("mesh", small, "-o", p.path("o.obj"))
    check("a folder that others can enter", status == 77 and "only you" in err, "%d %s" % (status, err))
    os.chmod(p.run + "/acut", 0o700)


with tempfile.TemporaryDirectory(prefix="acut-live-") as base:
    place = Place(base)
    try:
        outputs(place)
        interruption(place)
        progress(place)
        terminal(place)
        private(place)
    finally:
        place.end()
end()
