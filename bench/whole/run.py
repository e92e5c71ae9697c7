#!/usr/bin/python3
"""The whole way beside CGAL: LAS on disk to PLY on disk through daemon and socket, against the bare in-memory
triangulation of the same points. Runs in turn, prints each and the median ratio of wall times.

usage: run.py BUILD-FOLDER [--points N] [--memory 256M] [--threads 2] [--runs 5] [--work FOLDER] [SYNTH OPTION...]

The output's blocks are written once before the timed runs (a disk that allocates on first write is several
times slower then), and the input is in the page cache.
"""
import argparse
import json
import os
import statistics
import subprocess
import sys
import time

p = argparse.ArgumentParser()
p.add_argument("build")
p.add_argument("--points", type=int, default=10_000_000)
p.add_argument("--memory", default="256M")
p.add_argument("--threads", type=int, default=2)
p.add_argument("--runs", type=int, default=5)
p.add_argument("--work", default="/tmp")
args, synth = p.parse_known_args()

las = os.path.join(args.work, "acut-bench-%d.las" % args.points)
ply = os.path.join(args.work, "acut-bench-%d.ply" % args.points)
tool = lambda *parts: os.path.join(args.build, *parts)
if not os.path.exists(las):
    subprocess.run([tool("tools/acut-synth"), "--points", str(args.points), "--seed", "1", *synth, las], check=True)


def acut():
    start = time.monotonic()
    r = subprocess.run([tool("client/acutctl/acutctl"), "mesh", "--json", "--no-progress", "--memory", args.memory,
                        "--threads", str(args.threads), "-o", ply, las], stdout=subprocess.PIPE, check=True)
    wall = time.monotonic() - start
    return wall, json.loads(r.stdout)


def cgal():
    r = subprocess.run([tool("bench/whole/cgal_las"), las], stdout=subprocess.PIPE, check=True)
    f = r.stdout.split()
    return float(f[4]), float(f[3]), int(f[5])


acut()
ratios, walls, peers = [], [], []
for i in range(args.runs):
    wall, got = acut()
    peer, peer_cpu, peer_rss = cgal()
    walls.append(wall)
    peers.append(peer)
    ratios.append(wall / peer)
    print("run %d: acut %.2f s (staging %.2f, first triangle %.2f), VmHWM %.0f MiB, %d domains; CGAL %.2f s wall, "
          "%.2f s CPU, %.0f MiB; ratio %.2f" % (i + 1, wall, got["stage_seconds"], got["first_triangle_seconds"],
          got["peak_rss_bytes"] / 2**20, got["domains"], peer, peer_cpu, peer_rss / 2**20, ratios[-1]), flush=True)
print("%d points, memory=%s, %d threads: acut %.2f s, CGAL %.2f s, ratio %.2f (median of %d; min %.2f, max %.2f); "
      "%d bytes written; digest %s" % (got["points"], args.memory, args.threads, statistics.median(walls),
      statistics.median(peers), statistics.median(ratios), args.runs, min(ratios), max(ratios), got["output_bytes"],
      got["digest"]))
