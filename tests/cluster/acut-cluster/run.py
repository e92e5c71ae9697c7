"""Runs of acut-cluster: with processes of this machine, and as a script. What comes out is what acutd makes of the same files."""
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
import e2e
from checks import asked, check, end

CLUSTER, TASK, PHASES, ACUTD, ACUTCTL, SYNTH = (os.environ[n] for n in ("ACUT_CLUSTER", "ACUT_TASK_PROGRAM", "PHASES", "ACUTD", "ACUTCTL", "ACUT_SYNTH"))


def run(*args, env=None, status=0, cwd=None, timeout=300):
    p = subprocess.run(args, capture_output=True, text=True, cwd=cwd, timeout=timeout, env={**os.environ, **(env or {})})
    if status is not None and p.returncode != status:
        check(" ".join(args[1:]), False, "status %d, wanted %d\n%s%s" % (p.returncode, status, p.stdout, p.stderr))
    return p


def tiles(folder, points=60000):
    """Six tiles in a row of two and three, with gaps and overlaps of nothing."""
    os.mkdir(folder)
    for k in range(6):
        run(SYNTH, "--points", str(points), "--area", "300x200", "--origin", "%d,%d,0" % (500000 + k % 3 * 300, 5400000 + k // 3 * 200),
            "--seed", str(k + 1), "%s/t%d.las" % (folder, k))
    return folder


def sums(folder):
    """Of its files: bytes and times."""
    got = []
    for name in sorted(os.listdir(folder)):
        with open(os.path.join(folder, name), "rb") as f:
            got.append((name, hashlib.sha256(f.read()).digest(), os.fstat(f.fileno()).st_mtime_ns))
    return got


class Daemon:
    """acutctl with a daemon of its own: what it makes of files."""

    def __init__(self, base):
        self.env = {"ACUT_ACUTD": ACUTD, "HOME": base, "XDG_RUNTIME_DIR": base, "XDG_STATE_HOME": base + "/state", "XDG_CACHE_HOME": base + "/cache",
                    "ACUT_SOCKET": ""}

    def mesh(self, *args):
        return json.loads(run(ACUTCTL, "mesh", *args, "--json", "--memory", "64M", env=self.env).stdout.splitlines()[-1])


def show(work, env=None):
    return json.loads(run(CLUSTER, "show", work, "--json", env=env).stdout)


def stage(base):
    """A dataset: the same points whatever the number of tasks, as acutd imports it."""
    survey, work = tiles(base + "/tiles"), base + "/w"
    before = sums(survey)
    p = run(CLUSTER, "stage", "tiles", "--work", work, "--on", "local", "--task-points", "130000", "--json", "--no-config", cwd=base)
    out = json.loads(p.stdout)
    check("staged", out["state"] == "done" and out["result"]["points"] == "360000" and out["result"]["segments"] == "3", p.stdout)
    s = show(work)
    check("show", s["state"] == "done" and [(x["phase"], x["tasks"], x["done"]) for x in s["phases"]] ==
          [("head", 1, 1), ("stage", 3, 3), ("commit", 1, 1)] and s["core_hours"] > 0, str(s))
    with open(work + "/acut-work") as f:
        check("one name of the run", "id %s\n" % s["id"] in f.read(), s["id"])
    check("the inputs are as they were", before == sums(survey))
    run(CLUSTER, "wait", work)
    run(TASK, work, "stage", "2")
    run(TASK, work, "stage", "3", status=2)
    p = run(CLUSTER, "clean", work, status=1)
    check("a dataset is not removed by mistake", "--keep-dataset" in p.stderr, p.stderr)
    run(CLUSTER, "clean", work, "--keep-dataset")
    check("only the dataset is left", os.listdir(work) == ["dataset"], str(os.listdir(work)))
    check("without what attempts have left", len(os.listdir(work + "/dataset")) == 4, str(os.listdir(work + "/dataset")))


def refused(base):
    """An input that is broken stops the run, with its name; mended it goes on."""
    survey, work = tiles(base + "/tiles", 20000), base + "/w"
    with open(survey + "/t2.las", "r+b") as f:
        good = f.read()
        f.truncate(len(good) // 2)
    p = run(CLUSTER, "stage", survey, "--work", work, "--on", "local", "--task-points", "20000", "--no-config", status=1)
    check("the input is named", "t2.las" in p.stderr and "resume" in p.stderr, p.stderr)
    s = show(work)
    check("show says why", s["state"] == "stopped" and any("t2.las" in f["message"] for f in s["failures"]), str(s))
    run(CLUSTER, "clean", work, status=1)
    run(CLUSTER, "clean", work, "--force")
    check("nothing is left", not os.path.exists(work), "")


def interrupted(base):
    """A driver that is killed, cancel and resume."""
    survey, work = tiles(base + "/tiles", 20000), base + "/w"
    slow = base + "/slow"
    with open(slow, "w") as f:
        f.write('#!/bin/sh\n[ -e %s/go ] || sleep 600\nexec %s "$@"\n' % (base, TASK))
    os.chmod(slow, 0o755)

    def start():
        p = subprocess.Popen([CLUSTER, "stage", survey, "--work", work, "--on", "local", "--task-points", "20000", "--no-config"],
                             env={**os.environ, "ACUT_TASK": slow}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        e2e.until(begun, "the head does not begin")
        return p

    def begun():
        """The log names the driver, so other commands see it."""
        return os.path.exists(work + "/log/head-0") and "begins on" in open(work + "/log/head-0").read()

    p = start()
    s = show(work)
    check("seen from outside", s["state"] == "running" and s["phases"][0]["running"] == 1 and s["phases"][1]["waiting"] > 0, str(s))
    run(CLUSTER, "clean", work, "--force", status=1)
    p.send_signal(signal.SIGINT)
    out = p.communicate(timeout=e2e.PATIENCE)[0]
    check("interrupted", p.returncode == 130 and "resume" in out, "%d %s" % (p.returncode, out))
    check("nothing runs any more", show(work)["state"] == "stopped", str(show(work)))
    run(CLUSTER, "cancel", work)
    run(TASK, work, "head", "0", status=1)
    check("cancelled", show(work)["state"] == "cancelled")
    run(CLUSTER, "wait", work, status=1)
    run(CLUSTER, "resume", work)
    check("resumed", show(work)["state"] == "done")
    run(CLUSTER, "clean", work, "--force")
    check("nothing is left", not os.path.exists(work))
    p = start()
    q = run(CLUSTER, "cancel", work)
    out = p.communicate(timeout=e2e.PATIENCE)[0]
    check("a run that is cancelled while it is waited for", p.returncode == 1 and "the run was cancelled" in out and "1 job;" in q.stdout + q.stderr,
          "%d %s %s%s" % (p.returncode, out, q.stdout, q.stderr))
    run(CLUSTER, "clean", work, "--force")


def script(base):
    survey, work = tiles(base + "/tiles", 20000), base + "/w"
    run(CLUSTER, "stage", survey, "--work", work, "--on", "script", "--task-points", "20000", "--no-config")
    run("sh", work + "/script")
    check("a script", show(work)["state"] == "done")
    check("nothing is missing", run(CLUSTER, "resume", work).stdout.startswith("nothing is missing"))
    run(CLUSTER, "wait", work)


def many_segments(base):
    """A dataset of more segments than a reader holds open, in an acutd with few descriptors: it is meshed while they are merged."""
    survey, work = base + "/tiles", base + "/w"
    os.mkdir(survey)
    for k in range(320):
        run(SYNTH, "--points", "400", "--area", "20x20", "--origin", "%d,%d,0" % (500000 + k % 20 * 20, 5400000 + k // 20 * 20), "--seed", str(k + 1),
            "%s/t%03d.las" % (survey, k))
    wanted = Daemon(base).mesh(survey, "--format", "null")
    p = run(CLUSTER, "stage", survey, "--work", work, "--on", "local", "--task-points", "400", "--json", "--no-config")
    segments = int(json.loads(p.stdout)["result"]["segments"])
    check("many segments", segments > 300, str(segments))
    with e2e.Daemon(base, memory="64M", prefix=["prlimit", "--nofile=280"]) as d:
        d.ctl("dataset", "import", work + "/dataset", "valley").ok()
        same("many segments", d.ctl("submit", "valley", "--wait", "--json").ok().json(), wanted)
    run(CLUSTER, "mesh", survey, "-o", base + "/m.ply", "--work", work + "2", "--on", "local", "--task-points", "400", "--no-config",
        env={"ACUT_TASK": few_descriptors(base)})
    same("many segments, few descriptors", show(work + "2")["result"], wanted)


def few_descriptors(base):
    path = base + "/few"
    with open(path, "w") as f:
        f.write('#!/bin/sh\nulimit -n 160\nexec %s "$@"\n' % TASK)
    os.chmod(path, 0o755)
    return path


KEYS = ("digest", "vertex_digest", "vertices", "triangles")


def same(what, result, wanted):
    got = {k: str(result[k]) for k in KEYS}
    check(what, got == {k: str(wanted[k]) for k in KEYS}, "%s, wanted %s" % (got, {k: wanted[k] for k in KEYS}))


def mesh(base):
    """The daemon's mesh, with tasks of several sizes and memories, and of a view."""
    survey, d = tiles(base + "/tiles"), Daemon(base)
    wanted = d.mesh(survey, "--format", "null")
    ground = d.mesh(survey, "--ground", "--format", "null")
    for k, (args, of) in enumerate(((["--task-points", "1000000"], wanted), (["--task-points", "60000"], wanted),
                                    (["--task-points", "9000", "--task-memory", "64M"], wanted),
                                    (["--task-points", "50000", "--ground"], ground),
                                    (["--task-points", "40000", "--sort"], wanted))):
        work = "%s/w%d" % (base, k)
        p = run(CLUSTER, "mesh", survey, "-o", "%s/m%d.ply" % (base, k), "--work", work, "--on", "local", "--json", "--no-config", *args)
        same("mesh " + " ".join(args), json.loads(p.stdout)["result"], of)
        s = show(work)
        files = sum(len(f) for _, _, f in os.walk(work))
        tasks = sum(x["tasks"] for x in s["phases"])
        check("few files a task", files <= 4 * tasks + 10, "%d files, %d tasks" % (files, tasks))
        check("memory of tasks", all(x["peak"] and x["peak"] <= (128 if k == 2 else 1024 + 64) << 20 for x in s["phases"]), str(s["phases"]))
        run(CLUSTER, "clean", work)
        check("nothing is left", not os.path.exists(work))
    check("one file each", [n for n in sorted(os.listdir(base)) if n[0] == "m"] == ["m%d.ply" % k for k in range(5)] and
          os.path.getsize(base + "/m0.ply") == os.path.getsize(base + "/m1.ply"), str(os.listdir(base)))


def convex(base):
    """Corners of a convex polygon, of which all stay open: one task of gather says how much memory it would need."""
    os.mkdir(base + "/in")
    n = e2e.polygon(base + "/in/polygon.xyz", 250)
    wanted = Daemon(base).mesh(base + "/in", "--format", "null")
    check("convex", int(wanted["triangles"]) == n - 2 and int(wanted["hull"]) == n, str(wanted))
    def mesh(points, memory, status=0):
        return run(CLUSTER, "mesh", base + "/in", "-o", base + "/m.ply", "--work", "%s/w%s-%s" % (base, points, memory), "--on", "local", "--json",
                   "--no-config", "--task-points", points, "--task-memory", memory, status=status)
    same("convex, several tasks", json.loads(mesh("15000", "64M").stdout)["result"], wanted)
    p = mesh("1000000", "64M", status=1)
    need = re.search("vertices are open at once.*--task-memory ([0-9]+M)", p.stdout + p.stderr, re.S)
    check("convex, one task", need, p.stdout + p.stderr)
    if need:
        same("convex, with " + need.group(1), json.loads(mesh("1000000", need.group(1)).stdout)["result"], wanted)


def real(base):
    """Neighbouring LAZ tiles of a real survey."""
    data = e2e.data_dir()
    if not data:
        print("     no real files (ACUT_TEST_DATA)")
        return
    survey, d = data + "/lidar/tiles_ign_pdrf8", Daemon(base)
    for view in ([], ["--ground"], ["--surface", "--zmax", "1000"]):
        wanted = d.mesh(survey, *view, "--format", "null")
        for points in ("1000000", "7000"):
            work = base + "/w"
            p = run(CLUSTER, "mesh", survey, "-o", base + "/m.ply", "--work", work, "--on", "local", "--json", "--no-config", "--task-points", points,
                    "--task-memory", "64M", *view)
            same("real tiles, " + " ".join(view) + " " + points, json.loads(p.stdout)["result"], wanted)
            run(CLUSTER, "clean", work)


def options(base):
    """What is said of inputs and of outputs means what it means to acutctl. Names of files are relative to the folder of the command."""
    d = Daemon(base)
    random = 12345
    os.mkdir(base + "/texts")
    for k in range(3):
        with open("%s/texts/t%d.xyz" % (base, k), "w") as f:
            for _ in range(3000):
                random = random * 1103515245 + 12345 & 0x7fffffff
                x, y, z = random % 1000 / 1e5 + 9 + k / 100, random // 1000 % 1000 / 1e5 + 48, random % 97 / 3
                f.write("%.3f;2;%.7f;%.7f\n" % (z, x, y))
    with open(base + "/area.wkt", "w") as f:
        f.write("POLYGON ((500100 5316000, 501500 5316000, 501500 5317500, 500100 5317500, 500100 5316000))")
    common = ["texts", "--columns", "zcxy", "--input-format", "xyz"]
    for k, args in enumerate((["--assume-crs", "EPSG:4258", "--utm", "32N"], ["--assume-crs", "EPSG:4258", "--utm", "33N", "--scale", "0.005,0.01"],
                              ["--planar", "--override-units", "m,ft"], ["--assume-crs", "EPSG:4258", "--mask", "area.wkt", "--max-edge", "80m"],
                              ["--assume-crs", "EPSG:4258", "--class", "2", "--zmin", "5"])):
        p = run(ACUTCTL, "mesh", *common, *args, "-o", "d%d.ply" % k, "--canonical", "--json", "--memory", "64M", env=d.env, cwd=base, status=None)
        work = "w%d" % k
        q = run(CLUSTER, "mesh", *common, *args, "-o", "m%d.ply" % k, "--canonical", "--json", "--work", work, "--on", "local", "--no-config",
                "--task-memory", "64M", "--task-points", "4000", cwd=base, status=None)
        check("options " + " ".join(args), p.returncode == q.returncode == 0, "%s\n%s\n%s%s" % (p.stderr, p.stdout, q.stderr, q.stdout))
        if p.returncode or q.returncode:
            continue
        check("a mesh", int(json.loads(q.stdout)["result"]["triangles"]) > 1000, q.stdout)
        same("options " + " ".join(args), json.loads(q.stdout)["result"], json.loads(p.stdout.splitlines()[-1]))
        with open("%s/d%d.ply" % (base, k), "rb") as f, open("%s/m%d.ply" % (base, k), "rb") as g:
            check("the same file", f.read().split(b"end_header")[1] == g.read().split(b"end_header")[1], " ".join(args))
        run(CLUSTER, "clean", work, cwd=base)


def killed_once(base):
    """An attempt that failed is counted when its task is done, too."""
    with open(base + "/a.xyz", "w") as f:
        f.writelines("%d %d %d.5\n" % (k % 17, k * k % 19, k % 5) for k in range(300))
    with open(base + "/kills", "w") as f:
        f.write('#!/bin/bash\n[ $2 != stage ] || ! mkdir %s/killed 2>/dev/null || kill -9 $$\nexec %s "$@"\n' % (base, TASK))
    os.chmod(base + "/kills", 0o755)
    run(CLUSTER, "stage", base + "/a.xyz", "--work", base + "/w", "--on", "local", "--no-config", env={"ACUT_TASK": base + "/kills"})
    s = show(base + "/w")
    check("again", s["state"] == "done" and [p["again"] for p in s["phases"]] == [0, 1, 0] and s["phases"][1]["why"][0]["tasks"] == 1, str(s))


def lost_results(base):
    """A pack or the manifest that is gone is made again by resume, when a task has missed it."""
    survey, work = tiles(base + "/tiles"), base + "/w"
    run(CLUSTER, "mesh", survey, "-o", base + "/m.ply", "--work", work, "--on", "local", "--no-config", "--task-points", "130k")
    with open(base + "/m.ply", "rb") as f:
        before = f.read()
    pack = [name for name in os.listdir(work + "/mesh") if name.startswith("pack-1-")][0]
    for lost, n in ("/mesh/" + pack, "2 tasks are"), ("/dataset/manifest", "1 task is"):
        os.unlink(work + lost)
        for name in [n for n in os.listdir(work + "/done") if n.startswith(("gather-", "finish-"))]:
            os.unlink(work + "/done/" + name)
        for name in [n for n in os.listdir(work) if n.startswith("shared-")] + ["../m.ply"]:
            os.unlink(os.path.join(work, name))
        p = run(TASK, work, "gather", "1", env={"ACUT_CLUSTER_PATIENCE": "0.2"}, status=74)
        check("it is missed", os.path.basename(lost) in p.stderr, p.stderr)
        p = run(CLUSTER, "resume", work, env={"ACUT_CLUSTER_PATIENCE": "2"})
        check("it is made again", n + " done again" in p.stderr and show(work)["state"] == "done", p.stderr)
        with open(base + "/m.ply", "rb") as f:
            check("the same output", f.read() == before)


def changed(work, change):
    """With other lines in acut-work."""
    with open(work + "/acut-work") as f:
        body = "".join(change([line for line in f if not line.startswith("check ")]))
    check_sum = subprocess.run([PHASES, "check-sum"], input=body, capture_output=True, text=True, check=True).stdout
    with open(work + "/acut-work", "w") as f:
        f.write(body + "check %s\n" % check_sum)


def contents(folder):
    found = {}
    for top, folders, names in os.walk(folder):
        for name in folders + names:
            path = os.path.join(top, name)
            if os.path.isfile(path):
                with open(path, "rb") as f:
                    found[path] = f.read()
            else:
                found[path] = None
    return found


def other_versions(base):
    """A run that another version began is neither resumed nor are its tasks run, and nothing of it is changed: its packs may have
    another order of vertices and triangles. It can be looked at and removed; one without a mesh goes on."""
    survey, work = tiles(base + "/tiles", 2000), base + "/w"
    run(CLUSTER, "mesh", survey, "-o", base + "/m.ply", "--work", work, "--on", "local", "--no-config", "--task-points", "4k")
    with open(work + "/acut-work") as f:
        text = f.readlines()
    check("the kernel is named", sum(line.startswith("kernel ") for line in text) == 1, "".join(text))
    check("a program that does not compare it refuses the run", text[0] == "acut-work 2\n", text[0])
    # A pack is lost, and finish has not been.
    os.unlink([os.path.join(work, "mesh", n) for n in os.listdir(work + "/mesh") if n.startswith("pack-")][0])
    os.unlink(work + "/done/finish-0")
    for what, change in (("another kernel", lambda lines: ["kernel kernel 0\n" if x.startswith("kernel ") else x for x in lines]),
                         ("no kernel", lambda lines: ["acut-work 1\n"] + [x for x in lines[1:] if not x.startswith("kernel ")]),
                         ("no sums", lambda lines: [x for x in lines if not (x.startswith("tasks ") and x.endswith(" sum\n"))])):
        changed(work, lambda lines: change(text[:-1]))
        before = contents(base)
        phases = [x["phase"] for x in show(work)["phases"]]
        check("all phases", "mesh" in phases and "finish" in phases, str(phases))
        for args in [(CLUSTER, "resume", work), *((TASK, work, phase, "0") for phase in phases)]:
            p = run(*args, env={"ACUT_CLUSTER_PATIENCE": "0.2"}, status=76)
            check("%s: %s" % (what, args[1:]), "another version of acut began the run" in p.stderr, p.stderr)
        check("nothing is changed", contents(base) == before, "%s: %s" % (what, set(contents(base)) ^ set(before)))
    changed(work, lambda lines: ["acut-work 3\n"] + lines[1:])
    check("a newer version", "it has version 3, this version of acut reads up to 2" in run(CLUSTER, "show", work, status=76).stderr)
    changed(work, lambda lines: ["acut-work 1\n"] + lines[1:])
    run(CLUSTER, "clean", work, "--force")
    check("it is removed", not os.path.exists(work))
    run(CLUSTER, "stage", survey, "--work", work, "--on", "local", "--no-config")
    changed(work, lambda lines: [x for x in lines if not x.startswith("kernel ")])
    os.unlink(work + "/done/commit-0")
    run(CLUSTER, "resume", work)


def elsewhere(base):
    """A relative --directory, for tasks and for later commands that begin in other folders; and clean without that folder."""
    os.makedirs(base + "/top/in")
    with open(base + "/top/in/a.xyz", "w") as f:
        f.writelines("%d %d %d.5\n" % (k % 17, k * k % 19, k % 5) for k in range(300))
    for k, way in enumerate((["--directory", "top"], ["--directory=top"])):
        work = "%s/w%d" % (base, k)
        run(CLUSTER, "mesh", "in/a.xyz", "-o", "m.ply", *way, "--work", work, "--on", "script", "--no-config", cwd=base)
        run("sh", work + "/script", cwd="/")
        check("a folder of the command", os.path.getsize(base + "/top/m.ply") > 1000)
        run(CLUSTER, "clean", "w%d" % k, cwd=base)
        check("clean with a relative name", not os.path.exists(work))
    run(CLUSTER, "mesh", "in/a.xyz", "-o", "m.ply", "--directory", "top", "--work", base + "/w", "--on", "local", "--no-config", cwd=base)
    shutil.rmtree(base + "/top")
    p = run(CLUSTER, "clean", base + "/w")
    check("clean without the folder of the command", "warning" in p.stderr and "/top" in p.stderr and not os.path.exists(base + "/w"), p.stderr)


def reported(base):
    """At the end of a run: the report as acutctl prints it, and what is odd about the inputs, also of a file that is cut off."""
    survey, work = base + "/a.xyz", base + "/w"
    with open(survey, "w") as f:
        f.writelines("%d %d %d.5\n" % (k % 17, k * k % 19, k % 5) for k in range(300))
    before = os.umask(0)
    p = run(CLUSTER, "mesh", survey, "-o", base + "/m.ply", "--work", work, "--on", "local", "--no-config", "--sort")
    run(CLUSTER, "cancel", work)
    os.umask(before)
    modes = {name: os.stat(os.path.join(top, name)).st_mode & 0o777 for top, folders, files in os.walk(base) for name in folders + files}
    others = ["a.xyz", "m.ply", *os.listdir(work + "/log")]
    wrong = {name: oct(mode) for name, mode in modes.items() if mode not in (0o640, 0o750) and name not in others}
    os.unlink(work + "/cancelled")
    check("permissions of a work folder", not wrong and modes["m.ply"] == 0o666, str(wrong))
    for what, text in (("mesh", p), ("show", run(CLUSTER, "show", work)), ("wait", run(CLUSTER, "wait", work))):
        check(what + " has the report", "wrote %s/m.ply\n" % base in text.stdout and " points used of 300" in text.stdout, text.stdout)
        check(what + " warns", "warning: the coordinate system, the unit of x and y and the unit of z are unknown" in text.stderr, text.stderr)
    for out in (show(work), json.loads(run(CLUSTER, "wait", work, "--json").stdout)):
        check("as JSON", out["report"]["points"] == 300 and out["report"]["digest"] == out["result"]["digest"] and len(out["warnings"]) == 1 and
              "are unknown" in out["warnings"][0], str(out))
    check("a run with a mesh", "wrote" not in run(CLUSTER, "wait", work, "--quiet").stdout)
    run(CLUSTER, "clean", work)
    run(SYNTH, "--points", "2000", base + "/cut.las")
    os.truncate(base + "/cut.las", os.path.getsize(base + "/cut.las") - 5000)
    p = run(CLUSTER, "stage", base + "/cut.las", "--accept-truncated", "--work", work, "--on", "local", "--no-config", "--json")
    out = json.loads(p.stdout)
    check("a file that is cut off", out["report"] is None and any("cut.las: " in w for w in out["warnings"]), p.stdout)


def output_tiles(base):
    """Outputs that many tasks write: relative names are of the folder of the command."""
    survey, d = tiles(base + "/tiles", 30000), Daemon(base)
    d.mesh(survey, "-o", base + "/by-daemon", "--tile", "120", "--format", "obj")
    p = run(CLUSTER, "mesh", "tiles", "-o", "by-tasks", "--tile", "120", "--format", "obj", "--work", base + "/w", "--on", "local", "--json",
            "--no-config", "--task-points", "20000", cwd=base)
    check("tiles", json.loads(p.stdout)["state"] == "done")
    check("gather is divided", [x["tasks"] for x in show(base + "/w")["phases"] if x["phase"] == "gather"] == [10], str(show(base + "/w")))
    with open(base + "/w/acut-work") as f:
        check("the folder of the command", "word --directory=%s\n" % os.path.realpath(base) in f.read())
    names = sorted(os.listdir(base + "/by-daemon"))
    check("the same tiles", names == sorted(os.listdir(base + "/by-tasks")) and len(names) > 20, str(os.listdir(base + "/by-tasks")))
    run(CLUSTER, "clean", "w", cwd=base)


def main(*parts):
    for part in asked(*parts):
        with tempfile.TemporaryDirectory() as base:
            part(base)
    end()


if __name__ == "__main__":
    main(stage, refused, interrupted, script, mesh, convex, real, options, killed_once, lost_results, other_versions, elsewhere, reported, output_tiles, many_segments)
