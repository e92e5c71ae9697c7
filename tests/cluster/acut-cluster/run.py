"""Runs of acut-cluster: with processes of this machine, as a script, and (slurm) by nodes of a real Slurm. What comes out is what acutd
makes of the same files."""
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from slurm_test import slurm

CLUSTER, TASK, ACUTD, ACUTCTL, SYNTH = (os.environ[n] for n in ("ACUT_CLUSTER", "ACUT_TASK_PROGRAM", "ACUTD", "ACUTCTL", "ACUT_SYNTH"))
failed = 0


def check(what, cond, detail=""):
    global failed
    if not cond:
        failed += 1
        print("FAIL", what, detail, flush=True)


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
    before = {n: os.stat(os.path.join(survey, n)).st_mtime_ns for n in os.listdir(survey)}
    p = run(CLUSTER, "stage", "tiles", "--work", work, "--on", "local", "--task-points", "130000", "--json", "--no-config", cwd=base)
    out = json.loads(p.stdout)
    check("staged", out["state"] == "done" and out["result"]["points"] == "360000" and out["result"]["segments"] == "3", p.stdout)
    s = show(work)
    check("show", s["state"] == "done" and [(x["phase"], x["tasks"], x["done"]) for x in s["phases"]] ==
          [("head", 1, 1), ("stage", 3, 3), ("commit", 1, 1)] and s["core_hours"] > 0, str(s))
    check("the inputs are as they were", before == {n: os.stat(os.path.join(survey, n)).st_mtime_ns for n in os.listdir(survey)})
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
        f.write('#!/bin/sh\n[ -e %s/go ] || sleep 60\nexec %s "$@"\n' % (base, TASK))
    os.chmod(slow, 0o755)
    p = subprocess.Popen([CLUSTER, "stage", survey, "--work", work, "--on", "local", "--task-points", "20000", "--no-config"],
                         env={**os.environ, "ACUT_TASK": slow}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    end = time.time() + 30
    while not os.path.exists(work + "/log/head-0") and time.time() < end:
        time.sleep(0.05)
    s = show(work)
    check("seen from outside", s["state"] == "running" and s["phases"][0]["running"] == 1 and s["phases"][1]["waiting"] > 0, str(s))
    run(CLUSTER, "clean", work, "--force", status=1)
    p.send_signal(signal.SIGINT)
    out = p.communicate(timeout=30)[0]
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


def script(base):
    survey, work = tiles(base + "/tiles", 20000), base + "/w"
    run(CLUSTER, "stage", survey, "--work", work, "--on", "script", "--task-points", "20000", "--no-config")
    run("sh", work + "/script")
    check("a script", show(work)["state"] == "done")
    run(CLUSTER, "wait", work)


parts = {p.__name__: p for p in (stage, refused, interrupted, script)}
for name in sys.argv[1:] or parts:
    begun = time.time()
    with tempfile.TemporaryDirectory() as base:
        parts[name](base)
    print("%s: %.1f s" % (name, time.time() - begun), flush=True)
raise SystemExit(1 if failed else 0)
