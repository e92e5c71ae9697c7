#!/usr/bin/python3
"""The phases plan and mesh of a cluster's run beside acutd, on the same survey.

usage: mesh.py BUILD [--points N] [--tasks N...] [--task-memory SIZE] [--memory SIZE] [--threads N] [--runs N] [--work FOLDER]

For each number of tasks: CPU seconds of the plan and of all mesh tasks, as records have them, the ratio to what acutd takes from the
job's begin to its end, without a reader, with nothing stored; domains, and as many of acutd; bytes of the plan a task, peak memory of
a task. Runs take turns; a number is the median, a ratio the median of the ratios. The digests must be the same.
"""
import argparse
import json
import os
import shutil
import statistics
import sys

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
import acutbench
from acutbench import Daemon, Failed, Folder, run


def of_daemon(tools, folder, survey, o):
    with Daemon(tools, folder, o.memory, o.threads) as d:
        d.ctl("push", "survey", survey, "--no-progress").ok()
        before = acutbench.proc_cpu(d.pid)
        got = d.json("submit", "survey", "--wait")
        job = d.json("show", str(got["job"]))
        cpu = acutbench.proc_cpu(d.pid) - before
    shutil.rmtree(d.state)
    shutil.rmtree(d.cache)
    return cpu, job


def of_cluster(tools, folder, survey, tasks, o):
    work = os.path.join(folder, "work")
    points = max(1, o.points // tasks)
    run(tools.path("cluster/acut-cluster/acut-cluster"), "mesh", survey, "--format", "null", "--work", work, "--on", "local",
        "--task-points", str(points), "--task-memory", o.task_memory, "--quiet").ok()
    shown = json.loads(run(tools.path("cluster/acut-cluster/acut-cluster"), "show", work, "--json").ok().out.splitlines()[-1])
    phase = {p["phase"]: p for p in shown["phases"]}
    plan = [n for n in os.listdir(work) if n.startswith("plan-")]
    domains = 0
    for name in os.listdir(os.path.join(work, "done")):
        if name.startswith("mesh-"):
            with open(os.path.join(work, "done", name)) as f:
                domains += sum(int(line.split()[2]) for line in f if line.startswith("value domains "))
    got = {"tasks": phase["mesh"]["tasks"], "plan": 3600 * phase["plan"]["core_hours"], "mesh": 3600 * phase["mesh"]["core_hours"],
           "peak": phase["mesh"]["peak"], "domains": domains, "digest": shown["result"]["digest"],
           "plan_bytes": os.path.getsize(os.path.join(work, plan[0])) / phase["mesh"]["tasks"]}
    shutil.rmtree(work)
    return got


def main():
    p = argparse.ArgumentParser(usage=__doc__.split("\n\n")[1])
    p.add_argument("build")
    p.add_argument("--points", type=acutbench.count, default=10000000)
    p.add_argument("--tasks", type=int, nargs="+", default=[1, 4, 16, 64])
    p.add_argument("--task-memory", default="1G")
    p.add_argument("--memory", default="256M")
    p.add_argument("--threads", type=int, default=2)
    p.add_argument("--runs", type=int, default=3)
    p.add_argument("--work", default=None)
    o = p.parse_args()
    tools = acutbench.Tools(o.build)
    with Folder(o.work) as folder:
        survey = os.path.join(folder, "survey.las")
        run(tools.synth, "--points", str(o.points), survey).ok()
        seen = {n: [] for n in o.tasks}
        for _ in range(o.runs):
            cpu, job = of_daemon(tools, folder, survey, o)
            for n in o.tasks:
                got = of_cluster(tools, folder, survey, n, o)
                if got["digest"] != job["digest"]:
                    raise Failed("%d tasks: another digest than acutd's" % n)
                seen[n].append((cpu, job, got))
        print("%6s %8s %8s %8s %7s %8s %8s %12s %8s" % ("tasks", "acutd s", "plan s", "mesh s", "ratio", "domains", "acutd's", "plan B/task", "peak MB"))
        for n in o.tasks:
            median = lambda f: statistics.median(f(*row) for row in seen[n])
            last = seen[n][-1]
            print("%6d %8.2f %8.3f %8.2f %7.2f %8d %8d %12.0f %8.1f" % (
                last[2]["tasks"], median(lambda c, j, g: c), median(lambda c, j, g: g["plan"]), median(lambda c, j, g: g["mesh"]),
                median(lambda c, j, g: (g["plan"] + g["mesh"]) / c), last[2]["domains"], last[1]["domains"], last[2]["plan_bytes"],
                max(row[2]["peak"] for row in seen[n]) / 1e6))


if __name__ == "__main__":
    try:
        main()
    except Failed as e:
        sys.exit(str(e))
