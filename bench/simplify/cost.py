#!/usr/bin/python3
"""Views with an error beside plain ones, in a daemon: surveys of several regions, without lines and with breaklines.

usage: cost.py BUILD [--points N] [--errors LIST] [--vertices N] [--memory SIZE] [--threads N] [--runs N] [--only plain|lines]
                     [--file LAS] [--acutd PROGRAM] [--no-verify] [--work FOLDER] [--keep]

The survey is made by acut-synth; the six breaklines follow it from side to side, as waves. CPU time of acutd (user and system) for the
whole job, as a ratio to the plain mesh of the same dataset: the base of the view with breaklines is the mesh with the same breaklines.
Runs take turns, plain mesh first, each without what was kept of earlier ones; a ratio is the median of the ratios of the runs.
"""
import argparse
import json
import math
import os
import statistics
import sys

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
import acutbench
from acutbench import Daemon, Failed, Folder, run

LINES = 6


def cpu(pid):
    """Seconds so far, of all threads, finer than a tick."""
    total = 0
    for thread in os.listdir("/proc/%d/task" % pid):
        with open("/proc/%d/task/%s/schedstat" % (pid, thread)) as f:
            total += int(f.read().split()[0])
    return total / 1e9


def write_lines(path, info, vertices):
    """LINES lines with a vertex every so often, at half of the height of the survey."""
    low, high = info["min"], info["max"]
    each = vertices // LINES
    with open(path, "w") as f:
        f.write("x,y,z,name\n")
        for line in range(LINES):
            for i in range(each):
                x = low[0] + (high[0] - low[0]) * (0.03 + 0.94 * i / max(each - 1, 1))
                y = low[1] + (high[1] - low[1]) * ((line + 0.7) / (LINES + 0.4) + 0.025 * math.sin(i / 7 + line))
                f.write("%.2f,%.2f,%.2f,%d\n" % (x, y, (low[2] + high[2]) / 2, line))


class Job:
    """One dataset in one view, and what its meshes cost."""

    def __init__(self, d, name, title, view):
        self.d, self.name, self.title, self.view, self.cpu, self.ratios = d, name, title, view, [], []

    def run(self, base=None):
        self.d.ctl("cache", "gc", "--all").ok()
        before = cpu(self.d.pid)
        self.report = json.loads(
            self.d.ctl("submit", self.name, "--wait", "--new", "--json", "--no-progress", *self.view).ok().out.splitlines()[-1])
        self.cpu.append(cpu(self.d.pid) - before)
        if base:
            self.ratios.append(self.cpu[-1] / base)
        return self.cpu[-1]


def check(d, job, folder, lines, file):
    path = os.path.join(folder, "m.ply")
    d.ctl("fetch", job.report["job"], "-o", path).ok()
    view = d.json("show", job.report["job"])["view"]
    run(d.tools.path("tools/acut-verify"), "--quiet", "--view", view, *lines, path, file).ok()
    os.unlink(path)


def measure(d, table, args, folder, file):
    errors = args.errors.split(",")
    info, lines = d.json("info", file), os.path.join(folder, "lines.csv")
    write_lines(lines, info, args.vertices)
    for name in ("plain", "lines"):
        d.ctl("push", name, file).ok()
    d.ctl("push", "lines", lines, "--lines-as", "hard", "--assume-crs", info["crs"], "--assume-units", "m,m").ok()
    for name in args.only or ("plain", "lines"):
        plain = Job(d, name, "%s mesh" % name, [])
        jobs = [Job(d, name, "%s %s" % (name, e), ["--max-error", e + "m"]) for e in errors]
        for _ in range(args.runs):
            base = plain.run()
            for j in jobs:
                j.run(base)
        table.words("%s: %d triangles of %d points in %d domains" % (name, plain.report["triangles"], plain.report["used"],
                                                                    plain.report["domains"]))
        table.add(plain.title + " cpu", plain.cpu, "s")
        for j in jobs:
            r = j.report["bound"]
            table.words("%s m: %d points kept, %.1f %%, %d rounds" % (j.title, r["kept"], r["percent"], r["rounds"]))
            table.add(j.title + " cpu", j.cpu, "s", statistics.median(j.ratios))
            if not args.no_verify:
                check(d, j, folder, ["--breaklines", lines] if name == "lines" else [], file)


def body():
    p = argparse.ArgumentParser(description="Views with an error in a daemon.")
    p.add_argument("build", help="a build folder of meson")
    p.add_argument("--points", default="700k", help="of the survey (700k)")
    p.add_argument("--errors", default="0.1,0.11,0.3", help="metres (0.1,0.11,0.3)")
    p.add_argument("--vertices", type=int, default=540, help="of all breaklines (540)")
    p.add_argument("--memory", default="256M")
    p.add_argument("--threads", type=int, default=1)
    p.add_argument("--runs", type=int, default=5)
    p.add_argument("--only", nargs="*", choices=("plain", "lines"), help="one of the two")
    p.add_argument("--file", help="this survey, which is in metres, in place of one of acut-synth")
    p.add_argument("--acutd", help="measure this one, in place of that of the build")
    p.add_argument("--no-verify", action="store_true", help="do not check the last mesh of each view by acut-verify")
    p.add_argument("--work", default="/tmp", help="where folders are made (/tmp)")
    p.add_argument("--keep", action="store_true", help="keep the table in bench/results/ (or --results)")
    p.add_argument("--results", default=os.path.join(acutbench.HERE, "results"), help="where --keep writes")
    args = p.parse_args()
    tools, table = acutbench.Tools(args.build), acutbench.Table()
    tools.acutd = args.acutd or tools.acutd
    table.words(acutbench.machine(args.build, args.work))
    table.words("%s, memory %s, %d thread(s)" % (args.file or args.points + " points", args.memory, args.threads))
    with Folder(args.work) as folder, Daemon(tools, folder, memory=args.memory, threads=args.threads) as d:
        file = args.file or os.path.join(folder, "survey.las")
        if not args.file:
            run(tools.synth, "--points", acutbench.count(args.points), file).ok()
        measure(d, table, args, folder, file)
    if args.keep:
        print("kept in " + table.keep(args.results, "simplify-cost"))
    return 0


if __name__ == "__main__":
    acutbench.main(body)
