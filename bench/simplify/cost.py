#!/usr/bin/python3
"""Views with an error beside plain ones, in a daemon: surveys of several regions, without lines and with breaklines.

usage: cost.py BUILD [--points N] [--errors LIST] [--vertices N] [--memory SIZE] [--threads N] [--runs N] [--only plain|lines]
                     [--file LAS] [--acutd PROGRAM] [--no-verify] [--work FOLDER] [--keep]

The survey is made by acut-synth; the six breaklines follow it from side to side, as waves. CPU time of acutd (user and system) for the
whole job, as a ratio to the plain mesh of the same dataset: the base of the view with breaklines is the mesh with the same breaklines.
Runs take turns, plain mesh first, each without what was kept of earlier ones; a ratio is the median of the ratios of the runs.
"""
import argparse
import math
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
import acutbench
from acutbench import Meshes, daemon_arguments, one_daemon, run

LINES = 6


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


def measure(d, table, args, folder, file):
    errors = args.errors.split(",")
    info, lines = d.json("info", file), os.path.join(folder, "lines.csv")
    write_lines(lines, info, args.vertices)
    for name in ("plain", "lines"):
        d.ctl("push", name, file).ok()
    d.ctl("push", "lines", lines, "--lines-as", "hard", "--assume-crs", info["crs"], "--assume-units", "m,m").ok()
    for name in args.only or ("plain", "lines"):
        plain = Meshes(d, name, "%s mesh" % name, [])
        jobs = [Meshes(d, name, "%s %s" % (name, e), ["--max-error", e + "m"]) for e in errors]
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
            table.add(j.title + " cpu", j.cpu, "s", j.ratio())
            if not args.no_verify:
                path = os.path.join(folder, "m.ply")
                j.fetch(path, *(["--breaklines", lines] if name == "lines" else []), file)
                os.unlink(path)


def body():
    p = argparse.ArgumentParser(description="Views with an error in a daemon.")
    p.add_argument("build", help="a build folder of meson")
    p.add_argument("--points", default="700k", help="of the survey (700k)")
    p.add_argument("--errors", default="0.1,0.11,0.3", help="metres (0.1,0.11,0.3)")
    p.add_argument("--vertices", type=int, default=540, help="of all breaklines (540)")
    p.add_argument("--only", nargs="*", choices=("plain", "lines"), help="one of the two")
    p.add_argument("--file", help="this survey, which is in metres, in place of one of acut-synth")
    p.add_argument("--no-verify", action="store_true", help="do not check the last mesh of each view by acut-verify")
    daemon_arguments(p, "256M", 5)
    args = p.parse_args()
    with one_daemon(args, args.file or args.points + " points") as (d, folder, table):
        file = args.file or os.path.join(folder, "survey.las")
        if not args.file:
            run(d.tools.synth, "--points", acutbench.count(args.points), file).ok()
        measure(d, table, args, folder, file)
    if args.keep:
        print("kept in " + table.keep(args.results, "simplify-cost"))
    return 0


if __name__ == "__main__":
    acutbench.main(body)
