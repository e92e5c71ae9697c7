"""Runs of acut-cluster by nodes of a real Slurm: the mesh that acutd makes of the same files, whatever becomes of tasks, nodes and the
controller."""
import json
import os
import re
import subprocess
import time

import e2e
from checks import check
from cluster_tasks import stl_triangles
from run import CLUSTER, TASK, Daemon, main, run, same, show, sums, tiles
from slurm_test import slurm

PHASES = ("head", "stage", "sort", "commit", "plan", "mesh", "sum", "gather", "finish")


def waiting_task(base):
    """A program of tasks of which those that mesh wait for base/go."""
    slow = base + "/slow"
    with open(slow, "w") as f:
        f.write('#!/bin/bash\n[ $2 != mesh ] || while [ ! -e %s/go ]; do sleep 0.1; done\n%s "$@"\n' % (base, TASK))
    os.chmod(slow, 0o755)
    return slow


def left(base, *wanted):
    got = sorted(n for n in os.listdir(base) if n[0] in "wm" or "part" in n or n[0] == ".")
    check("nothing is left", got == sorted(wanted), str(got))


class Held:
    """A run in which the first attempt at a task of one phase waits until it is killed, or for base/go."""

    def __init__(self, base, s, survey, phase, *options, env={}):
        self.base, self.s, self.phase, self.work = base, s, phase, "%s/w-%s" % (base, phase)
        program = "%s/task-%s" % (base, phase)
        with open(program, "w") as f:
            f.write('#!/bin/bash\nif [ $2 = %s ] && mkdir %s 2>/dev/null; then echo $SLURMD_NODENAME >%s/node\n'
                    'while [ ! -e %s/go ]; do sleep 0.1; done; fi\nexec %s "$@"\n' % (phase, self.path(), self.path(), base, TASK))
        os.chmod(program, 0o755)
        self.p = subprocess.Popen([CLUSTER, "mesh", survey, "-o", "%s/m-%s.ply" % (base, phase), "--work", self.work, "--on", "slurm", "--json",
                                   "--no-config", "--task-points", "10000", "--task-memory", "64M", "--wait", *options],
                                  env={**os.environ, **s.env, **env, "ACUT_TASK": program}, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                  text=True)

    def path(self):
        return "%s/held-%s" % (self.base, self.phase)

    def node(self):
        """On which the task waits; None: it does not wait yet."""
        try:
            with open(self.path() + "/node") as f:
                return f.read().strip() or None
        except OSError:
            return None

    def attempts(self):
        """At tasks of the phase: how many began, and how many ended."""
        text = ""
        for name in os.listdir(self.work + "/log"):
            with open("%s/log/%s" % (self.work, name)) as f:
                text += f.read()
        return [len(re.findall("^acut-cluster: %s .* %s " % (self.phase, verb), text, re.M)) for verb in ("begins", "ends")]

    def end(self, what, wanted):
        out, err = self.p.communicate(timeout=240)
        check(what, self.p.returncode == 0, out + err)
        if not self.p.returncode:
            same(what, json.loads(out)["result"], wanted)
        n = self.attempts()
        run(CLUSTER, "clean", self.work, env=self.s.env)
        return n


def lost_in_each_phase(base, s, survey, wanted):
    """Eight runs, each in another phase when the nodes that they are on are lost."""
    held = [Held(base, s, survey, phase, "--sort") for phase in PHASES]
    s.until("a task of each phase runs", lambda: all(h.node() for h in held))
    lost = sorted({h.node() for h in held})
    check("a node is left", len(lost) < 3, str(lost))
    for node in lost:
        s.lose(node)
    for h in held:
        begun, ended = h.end("a node is lost in the phase " + h.phase, wanted)
        check("an attempt was lost in the phase " + h.phase, begun > ended, "%d began, %d ended" % (begun, ended))
    left(base, *("m-%s.ply" % h.phase for h in held))
    for node in lost:
        s.do("back", node)
    forget(base)
    s.until("the nodes come back", lambda: s.run("sinfo", "-h", "-t", "idle", "-o", "%D").strip() == "3")


def forget(base):
    for name in os.listdir(base):
        if name.startswith(("m-", "held-", "task-", "gate-")):
            subprocess.run(["rm", "-r", base + "/" + name], check=True)


def every_task_twice(base, s, survey, wanted):
    double = base + "/task-double"
    with open(double, "w") as f:
        f.write('#!/bin/sh\n%s "$@" &\n%s "$@"\nr=$?\nwait $! && exit $r\n' % (TASK, TASK))
    os.chmod(double, 0o755)
    p = run(CLUSTER, "mesh", survey, "-o", base + "/m-twice.ply", "--work", base + "/w-twice", "--on", "slurm", "--json", "--no-config",
            "--task-points", "10000", "--task-memory", "64M", "--sort", "--wait", env={**s.env, "ACUT_TASK": double})
    same("every task twice", json.loads(p.stdout)["result"], wanted)
    run(CLUSTER, "clean", base + "/w-twice", env=s.env)
    left(base, "m-twice.ply")
    forget(base)


def one_file(base, s, d):
    """A PLY and an STL that the tasks of three nodes write, each task twice at once: all are in the middle of it when a node is lost."""
    survey, work, double, gate = tiles(base + "/large", 40000), base + "/w-one", base + "/task-one", e2e.Gate(base)
    wanted = d.mesh(survey, "-o", base + "/by-daemon.stl", "--origin", "auto")
    outputs = [base + "/m-one." + end for end in ("ply", "stl")]
    with open(double, "w") as f:
        f.write('#!/bin/sh\n[ $2 != gather ] || { echo $SLURMD_NODENAME >%s/held-$3; export LD_PRELOAD=%s ACUT_GATE=%s; }\n'
                '%s "$@" &\n%s "$@"\nr=$?\nwait $! && exit $r\n' % (base, gate.env["LD_PRELOAD"], gate.folder, TASK, TASK))
    os.chmod(double, 0o755)
    gate.close("pwrite", "/.m-one.", 1)
    p = subprocess.Popen([CLUSTER, "mesh", survey, "-o", outputs[0], "-o", outputs[1], "--origin", "auto", "--work", work, "--on", "slurm",
                          "--json", "--no-config", "--task-points", "80000", "--task-memory", "64M", "--sbatch=--cpus-per-task=32", "--wait"],
                         env={**os.environ, **s.env, "ACUT_TASK": double}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def nodes():
        """Of the tasks of gather, and how much is in the outputs."""
        parts = [base + "/" + name for name in os.listdir(base) if name.startswith(".m-one.")]
        held = [base + "/" + name for name in os.listdir(base) if name.startswith("held-")]
        return [name for name in (open(name).read().strip() for name in sorted(held)) if name], sum(os.stat(name).st_blocks for name in parts)

    s.until("three tasks of gather write", lambda: len(nodes()[0]) == 3 and nodes()[1] and os.path.exists(gate.path("held")))
    of = nodes()[0]
    check("three nodes write", len(set(of)) == 3, str(of))
    s.lose(of[0])
    gate.open()
    out, err = p.communicate(timeout=240)
    check("a node is lost while all write", p.returncode == 0, out + err)
    same("one file of three nodes", json.loads(out)["result"], wanted)
    again = [x["again"] for x in show(work, s.env)["phases"] if x["phase"] == "gather"]
    check("tasks of gather were lost", again == [1], "%s, %s" % (again, of))
    run(os.environ["ACUT_VERIFY"], outputs[0], *(survey + "/" + name for name in os.listdir(survey)))
    check("the triangles of the STL", stl_triangles(outputs[1]) == stl_triangles(base + "/by-daemon.stl"))
    run(CLUSTER, "clean", work, env=s.env)
    left(base, "m-one.ply", "m-one.stl")
    s.do("back", of[0])
    forget(base)
    s.until("the node comes back", lambda: s.run("sinfo", "-h", "-t", "idle", "-o", "%D").strip() == "3")


def controller_killed(base, s, survey, wanted):
    """Just after it got a run, while a task runs and others wait. It has forgotten some jobs then, starts tasks whose phase before has
    not run, and drains nodes; `show` has the commands that mend these. What was forgotten is submitted again after the patience."""
    h, done = Held(base, s, survey, "mesh", env={"ACUT_CLUSTER_PATIENCE": os.environ.get("ACUT_CLUSTER_PATIENCE", "5")}), set()
    s.until("a task runs", h.node)
    s.do("restart")
    open(base + "/go", "w").close()
    while h.p.poll() is None:
        for trouble in show(h.work, s.env)["troubles"]:
            if trouble["command"] not in done:
                done.add(trouble["command"])
                subprocess.run(["sh", "-c", trouble["command"]], env={**os.environ, **s.env}, stderr=subprocess.DEVNULL)
        time.sleep(0.5)
    h.end("the controller was killed", wanted)
    left(base, "m-mesh.ply")


def faults(base):
    """One Slurm for all: a node is lost in each phase, every task runs twice at once, also while a node is lost, the controller is
    killed."""
    with slurm(base + "/slurm", 3, cpus=32) as s:
        survey, d = tiles(base + "/tiles", 6000), Daemon(base)
        wanted, before = d.mesh(survey, "--format", "null"), sums(survey)
        lost_in_each_phase(base, s, survey, wanted)
        every_task_twice(base, s, survey, wanted)
        one_file(base, s, d)
        controller_killed(base, s, survey, wanted)
        check("no input has changed", sums(survey) == before)


def three_nodes(base):
    """A mesh that nobody waits for; then one of which a task of each array is killed."""
    with slurm(base + "/slurm", 3) as s:
        survey, d = tiles(base + "/tiles"), Daemon(base)
        wanted = d.mesh(survey, "--format", "null")
        work = base + "/w1"
        p = run(CLUSTER, "mesh", survey, "-o", base + "/m1.ply", "--work", work, "--on", "slurm", "--json", "--no-config", "--task-points", "60000", env=s.env)
        check("submitted", len(json.loads(p.stdout)["jobs"]) == len(PHASES) - 1, p.stdout)  # all but sort
        s.until("the run is done", lambda: show(work, s.env)["state"] == "done")
        same("Slurm", show(work, s.env)["result"], wanted)
        run(CLUSTER, "clean", work, env=s.env)
        kills, work = base + "/kills", base + "/w2"
        with open(kills, "w") as f:
            f.write('#!/bin/bash\ncase $2-$3 in stage-1|sort-2|mesh-2|gather-0) mkdir %s/killed-$2 2>/dev/null && kill -9 $PPID $$;; esac\n'
                    'exec %s "$@"\n' % (base, TASK))
        os.chmod(kills, 0o755)
        p = run(CLUSTER, "mesh", survey, "-o", base + "/m2.ply", "--work", work, "--on", "slurm", "--json", "--no-config", "--task-points", "30000",
                "--max-tasks", "4", "--sort", "--task-memory", "64M", "--wait", env={**s.env, "ACUT_TASK": kills})
        check("tasks were killed", len([n for n in os.listdir(base) if n.startswith("killed-")]) == 4, str(os.listdir(base)))
        same("killed tasks", json.loads(p.stdout)["result"], wanted)
        run(CLUSTER, "clean", work, env=s.env)
        left(base, "m1.ply", "m2.ply")


def four_nodes(base):
    """What show, clean, cancel and resume say of a run with four nodes."""
    with slurm(base + "/slurm", 4) as s:
        survey, d = tiles(base + "/tiles"), Daemon(base)
        wanted, work, slow = d.mesh(survey, "--format", "null"), base + "/w", waiting_task(base)
        run(CLUSTER, "mesh", survey, "-o", base + "/m.ply", "--work", work, "--on", "slurm", "--json", "--no-config", "--task-points", "60000",
            env={**s.env, "ACUT_TASK": slow})
        s.until("tasks run", lambda: any(r[2] == "RUNNING" and "-mesh" in r[3] for r in s.queue()))
        got = show(work, s.env)
        mesh, gather = (next(p for p in got["phases"] if p["phase"] == name) for name in ("mesh", "gather"))
        check("show", got["state"] == "running" and got["jobs"] and mesh["running"] > 0 and gather["waiting"] == gather["tasks"] > 1, str(got))
        text = run(CLUSTER, "show", work, env=s.env).stdout
        check("show for people", "phase commit 1/1 done\n" in text and " running" in text and "; slurm %d" % got["jobs"][0] in text, text)
        run(CLUSTER, "clean", work, "--force", env=s.env, status=1)
        run(CLUSTER, "cancel", work, env=s.env)
        s.until("all is gone", lambda: not s.queue())
        check("cancelled", show(work, s.env)["state"] == "cancelled")
        run(CLUSTER, "wait", work, env=s.env, status=1)
        open(base + "/go", "w").close()
        p = run(CLUSTER, "resume", work, "--wait", "--json", env={**s.env, "ACUT_TASK": slow})
        same("resumed", json.loads(p.stdout)["result"], wanted)
        run(CLUSTER, "clean", work, env=s.env)
        left(base, "m.ply")


def one_node(base):
    with slurm(base + "/slurm", 1) as s:
        survey, d = tiles(base + "/tiles", 30000), Daemon(base)
        wanted = d.mesh(survey, "--format", "null")
        p = run(CLUSTER, "mesh", survey, "-o", base + "/m.ply", "--work", base + "/w", "--on", "slurm", "--json", "--no-config", "--task-points", "25000",
                "--task-memory", "64M", "--wait", env=s.env)
        same("Slurm of one node", json.loads(p.stdout)["result"], wanted)


if __name__ == "__main__":
    main(one_node, three_nodes, four_nodes, faults)
