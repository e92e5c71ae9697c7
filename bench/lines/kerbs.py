#!/usr/bin/python3
"""Kerbs on a real survey: pairs of lines 0.15 m apart, with a vertex every LENGTH metres, beside the plain mesh of the same points.

usage: kerbs.py BUILD FILE [--class LIST] [--lanes N] [--memory SIZE] [--threads N] [--runs N] [--acutd PROGRAM] [--work FOLDER] [--keep]

The lines go up and down along x from side to side of the points, LANES pairs of them; in the last row each is one segment. For each
spacing: line vertices and edges, triangles that are not in the Delaunay triangulation of the same vertices, CPU time of acutd for
planning and meshing as a ratio to the plain mesh, records and cells read, and those beyond what the plain mesh reads. Runs take turns, plain mesh first,
each without what was kept of earlier ones; a ratio is the median of the ratios of the runs. The mesh of each spacing is checked by acut-verify,
with its lines.
"""
import argparse
import os
import statistics
import struct
import sys

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
import acutbench
from acutbench import Failed, Meshes, daemon_arguments, one_daemon

SPACINGS = (0.5, 1, 5, 20, None)  # metres; None: one segment
APART = 0.15


def kerb(box, spacing, side, lane, lanes):
    """Positions of one line, (x, y): it rises and falls six times on its way, or is straight."""
    width, height = box[3] - box[0], box[4] - box[1]
    y = height * (lane + 0.5) / lanes + side * APART
    rise = height / (4 * lanes)
    if spacing is None:
        return [(0.01 * width, y), (0.99 * width, y + 0.3 * rise)]
    x, at = 0.01 * width + 0.37 * spacing * side, [width * c / 6 for c in range(1, 6)]
    while x < 0.99 * width:
        at.append(x)
        x += spacing
    out = []
    for x in sorted(at):
        u = 6 * x / width
        part = u - int(u)
        out.append((x, y + 0.5 * rise * (1 - part if int(u) % 2 else part)))
    return out


def write_lines(path, box, spacing, lanes):
    vertices = 0
    with open(path, "w") as f:
        f.write("x,y,z,name\n")
        for lane in range(lanes):
            for side in range(2):
                for x, y in kerb(box, spacing, side, lane, lanes):
                    f.write("%.3f,%.3f,%.3f,%d\n" % (box[0] + x, box[1] + y, box[2], 2 * lane + side))
                    vertices += 1
    return vertices


def read_ply(path):
    """Positions and triangles of a file of acutctl; triangles as sets of positions."""
    with open(path, "rb") as f:
        head, body = f.read().split(b"end_header\n", 1)
    words = head.decode().split()
    n, m = (int(words[words.index(what) + 1]) for what in ("vertex", "face"))
    face = struct.Struct("<B3iH" if b"ushort edges" in head else "<B3i")
    vertex = list(struct.iter_unpack("<3d", body[:24 * n]))
    at = [v[:2] for v in vertex]
    return vertex, {frozenset((at[f[1]], at[f[2]], at[f[3]])) for f in face.iter_unpack(body[24 * n:24 * n + face.size * m])}


def check(d, mesh, folder, lines, file):
    """Triangles of the mesh that are not in D."""
    path, flat = os.path.join(folder, "m.ply"), os.path.join(folder, "m.xyz")
    mesh.fetch(path, *lines, file)
    vertex, have = read_ply(path)
    with open(flat, "w") as f:
        f.writelines("%.3f %.3f %.3f\n" % v for v in vertex)
    plain = os.path.join(folder, "d.ply")
    d.ctl("mesh", flat, "--scale", "0.001", "-o", plain).ok()
    of_d = read_ply(plain)[1]
    os.unlink(path)
    os.unlink(plain)
    if len(of_d) != len(have):
        raise Failed("the Delaunay triangulation of the same vertices has %d triangles, the mesh %d" % (len(of_d), len(have)))
    return len(have - of_d)


def body():
    p = argparse.ArgumentParser(description="Kerbs on a real survey.")
    p.add_argument("build", help="a build folder of meson")
    p.add_argument("file", help="points in metres, on a lattice of 0.001 or coarser")
    p.add_argument("--class", dest="classes", default="2", help="of the points (2)")
    p.add_argument("--lanes", type=int, default=3, help="pairs of lines (3)")
    daemon_arguments(p, "24M", 5, ": regions are small with little")
    args = p.parse_args()
    view = ["--class", args.classes]
    with one_daemon(args, "%s, class %s" % (os.path.basename(args.file), args.classes)) as (d, folder, table):
        info = d.json("info", args.file)
        box = info["min"] + info["max"]
        system = ["--assume-crs", info["crs"]] if info["crs"] else []
        system += ["--assume-units", "m,m"] if info["units"]["xy"] else []
        d.ctl("push", "plain", args.file).ok()
        plain, meshes = Meshes(d, "plain", "plain", view), []
        for spacing in SPACINGS:
            path = os.path.join(folder, "kerbs-%s.csv" % spacing)
            m = Meshes(d, "kerbs-%s" % spacing, "segment" if spacing is None else "%gm" % spacing, view)
            m.path, m.vertices = path, write_lines(path, box, spacing, args.lanes)
            d.ctl("push", m.name, args.file).ok()
            m.lines = d.json("push", m.name, path, "--lines-as", "hard", *system)["line_set"]
            meshes.append(m)
        for _ in range(args.runs):
            base = plain.run()
            for m in meshes:
                m.run(base, may_refuse=True)  # the memory may not carry a segment
        r = plain.report
        table.words("plain: %d triangles of %d points in %d domains, %d records and %d cells read" % (
            r["triangles"], r["used"], r["domains"], r["points_read"], r["cells_read"]))
        table.add("plain cpu", plain.cpu, "s")
        for m in meshes:
            if m.refused:
                table.words("%s: %d line vertices, %d edges: refused after %.2f s of CPU time: %s" % (
                    m.title, m.vertices, m.lines["edges"], statistics.median(m.cpu), m.refused))
                continue
            new, r0, r1 = check(d, m, folder, ["--breaklines", m.path], args.file), plain.report, m.report
            table.words("%s: %d line vertices, %d edges, %d triangles in %d domains" % (
                m.title, m.vertices, m.lines["edges"], r1["triangles"], r1["domains"]))
            table.add(m.title + " cpu", m.cpu, "s", m.ratio())
            table.add(m.title + " triangles not in D", 100 * new / r1["triangles"], "%")
            for what in ("points_read", "cells_read", "halo"):
                table.add("%s %s beyond plain" % (m.title, what), r1[what] - r0[what], "1", r1[what] / r0[what])
        if args.keep:
            print("kept in " + table.keep(args.results, "kerbs"))
    return 0


if __name__ == "__main__":
    acutbench.main(body)
