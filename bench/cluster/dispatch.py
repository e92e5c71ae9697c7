#!/usr/bin/python3
"""What Slurm and acut-cluster add to the tasks of a run: a chain of phases whose tasks sleep, on nodes of a Slurm of its own.

usage: dispatch.py BUILD [--seconds N] [--nodes N] [--rounds N...] [--poll SECONDS]

A phase of R rounds has R tasks a node, which has one processor. The ideal time is the sum of the rounds times the seconds of a task.
Two times are compared with it, from the submission on: until the last task has ended, and until the waiting command has seen that.
Tasks that sleep take no processor, so the machine may do something else meanwhile.
"""
import argparse
import os
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../tests/cluster"))
from slurm_test import slurm

TASK = """#!/bin/sh
sleep %g
: >"$1/done/$2-$3"
"""


def main():
    p = argparse.ArgumentParser(usage=__doc__.split("\n\n")[1])
    p.add_argument("build")
    p.add_argument("--seconds", type=float, default=60)
    p.add_argument("--nodes", type=int, default=2)
    p.add_argument("--rounds", type=int, nargs="+", default=[1, 3, 1])
    p.add_argument("--poll", type=float, default=10)
    o = p.parse_args()
    phases = ["%s=%d" % (chr(ord("a") + i), r * o.nodes) for i, r in enumerate(o.rounds)]
    tasks, ideal = sum(o.rounds) * o.nodes, sum(o.rounds) * o.seconds
    with tempfile.TemporaryDirectory() as base, slurm(base + "/slurm", o.nodes, cpus=1) as s:
        work = base + "/work"
        for name in ("log", "done"):
            os.makedirs("%s/%s" % (work, name))
        with open(work + "/task", "w") as f:
            f.write(TASK % o.seconds)
        os.chmod(work + "/task", 0o755)
        begun = time.time()
        subprocess.run([os.path.join(o.build, "tests/cluster/dispatch/dispatch-run"), "slurm", work, "1", work + "/task", str(o.poll), "wait", *phases],
                       check=True, env={**os.environ, **s.env}, stdout=subprocess.DEVNULL)
        seen = time.time() - begun
        ended = [os.stat("%s/done/%s" % (work, name)).st_mtime for name in os.listdir(work + "/done")]
        if len(ended) != tasks:
            sys.exit("%d of %d tasks have ended" % (len(ended), tasks))
        last = max(ended) - begun
    print("%6s %6s %8s %8s %8s %9s %9s" % ("nodes", "tasks", "task s", "ideal s", "ended s", "more", "seen s"))
    print("%6d %6d %8g %8g %8.1f %8.1f%% %9.1f" % (o.nodes, tasks, o.seconds, ideal, last, 100 * (last / ideal - 1), seen))


if __name__ == "__main__":
    main()
