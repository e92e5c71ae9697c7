"""Inputs where designs break: convex position, collinear, thin corridors, one position, two far clusters, grids.
An exact result (CGAL's, triangle by triangle, where CGAL is quick enough) or a clear refusal, in bounded memory."""
import os
import subprocess

import e2e
from e2e import expect

ORACLE = os.environ.get("CGAL_DIGEST")
MEMORY, OVER = 24 << 20, 32 << 20


def synth(base, distribution, points, *options):
    path = os.path.join(base, "in.las")
    e2e.run([e2e.SYNTH, "--distribution", distribution, "--points", points, "--seed", 3, "--origin", "0,0", *options, path]).ok()
    return path


def mesh(daemon, base, path, may_refuse=False, oracle=True):
    out = os.path.join(base, "out.obj")
    r = daemon.ctl("mesh", "--json", "--keep-withheld", "--keep-noise", "-o", out, path)
    peak = daemon.vmhwm()
    expect(peak <= MEMORY + OVER, "VmHWM %d with memory=24M" % peak)
    if r.status == 1 and may_refuse:
        got = [line for line in (r.out + r.err).splitlines() if "error" in line]
        expect("does-not-fit" in r.out + r.err, "refused for another reason: %s" % got)
        expect(not os.path.exists(out), "an output of a refused job")
        print("     refused:", got[-1][:300])
        return None
    got = r.ok().json()
    if oracle and ORACLE:
        count, digest = subprocess.run([ORACLE, path], stdout=subprocess.PIPE, check=True).stdout.decode().split()
        expect(got["triangles"] == int(count) and got["digest"] == digest, "%s, CGAL has %s %s" % (got, count, digest))
    print("     %(points)d points, %(triangles)d triangles, %(hull)d hull, %(domains)d domains, %(points_read)d read" % got,
          "VmHWM %.1f MiB" % (peak / 2**20))
    return got


def case(distribution, points, *options, may_refuse=False, oracle=True, triangles=None, reads=None):
    def run():
        with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
            got = mesh(d, base, synth(base, distribution, points, *options), may_refuse, oracle)
            if triangles is not None:
                expect(got["triangles"] == triangles, "%d triangles" % got["triangles"])
            if reads is not None:
                expect(got["domains"] > 8, "%d domains" % got["domains"])
                expect(got["points"] <= got["points_read"] < reads * points, "%d records read" % got["points_read"])
    run.__name__ = "_".join([distribution.replace("-", "_"), str(points)] + [str(o).strip("-") for o in options])
    return run


def one_position():
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        path = os.path.join(base, "in.xyz")
        with open(path, "w") as f:
            f.write("5 5 1\n" * 300000)
        got = mesh(d, base, path, oracle=False)
        expect(got["triangles"] == 0 and got["removed"], str(got))


def few_positions():
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        path = os.path.join(base, "in.xyz")
        with open(path, "w") as f:
            for i in range(300000):
                f.write("%d %d %d\n" % (i % 3, i // 3 % 3, i % 7))
        got = mesh(d, base, path, oracle=False)
        expect(got["triangles"] == 8 and got["vertices"] == 9, str(got))


e2e.main(
    one_position, few_positions,
    case("uniform", 300000),
    case("grid", 300000, "--step", 1), case("grid", 300000, "--step", 16777),
    case("survey", 300000), case("clustered", 300000), case("two-clusters", 300000), case("duplicates", 300000),
    case("swath", 300000), case("gaussians", 300000), case("few", 300000), case("few", 30000, "--positions", 3, triangles=1),
    case("ring", 100000, may_refuse=True), case("corridor", 300000), case("corridor-diagonal", 300000),
    # Thin strips are normal surveys: what lies beside them is not read again for every domain.
    case("pipeline", 300000), case("pipeline-diagonal", 300000, reads=3), case("pipeline-slanted", 300000, reads=3),
    case("circle", 20000, may_refuse=True), case("circle", 300000, may_refuse=True),
    case("parabola", 20000, may_refuse=True), case("parabola", 200000, may_refuse=True, oracle=False),
    case("collinear", 1000, triangles=0), case("collinear", 300000, oracle=False, triangles=0))
