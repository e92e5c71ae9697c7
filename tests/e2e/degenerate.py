"""Degenerate inputs: convex position, collinear points, thin corridors, one position, two distant clusters, grids. The result is
exact (as CGAL's, triangle by triangle, where CGAL is fast enough) or a clear refusal, in bounded memory."""
import os
import re
import signal
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
        expect(got["triangles"] == 0 and got["vertices"] == 1 and got["removed"]["duplicate"] == 299999, str(got))
        expect(got["most"] == {"points": 300000, "x": 5, "y": 5}, str(got))
        expect(any("300,000 of 300,000 points" in w and "5 5" in w for w in got["warnings"]), str(got["warnings"]))


def flat_positions():
    """Positions without triangles become vertices, in all formats and with any memory, and are verified."""
    shapes = {"one": [(-3, 8)], "two": [(1, 2), (3, 9)], "axis": [(7, 31 * i) for i in range(5000)],
              "diagonal": [(3 * i, 7 * i) for i in range(200000)]}
    with e2e.Folder() as base:
        for name, at in shapes.items():
            path, out = (os.path.join(base, name + end) for end in (".xyz", ".ply"))
            with open(path, "w") as f:
                f.writelines("%d %d %d\n" % (x, y, i % 9) for i, (x, y) in enumerate(at))
            digests = set()
            for memory, threads in (("24M", 1), ("300M", 2)):
                with e2e.Daemon(base, memory=memory, threads=threads, name=name + memory) as d:
                    got = d.ctl("mesh", "--json", "--canonical", "-o", out, "-o", out[:-3] + "obj", path).ok().json()
                    expect(got["vertices"] == len(at) and got["triangles"] == got["hull"] == 0, str(got))
                    digests.add(got["vertex_digest"])
                    d.ctl("push", "kept", path).ok()
                    job = str(d.ctl("submit", "kept", "--wait", "--json").ok().json()["job"])
                    again = d.ctl("fetch", job, "-o", out + ".2.ply", "--json").ok().json()
                    expect(again["vertices"] == len(at) and again["vertex_digest"] == got["vertex_digest"], str(again))
                e2e.run([e2e.VERIFY, out, path]).ok()
                with open(out[:-3] + "obj") as f:
                    expect(sum(line.startswith("v ") for line in f) == len(at), "OBJ: " + name)
            expect(len(digests) == 1, "%s: digests %s" % (name, digests))


def tiles_of_no_triangles():
    """Vertices that are in no tile are reported, also in JSON."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        path, tiles = os.path.join(base, "line.xyz"), os.path.join(base, "tiles")
        with open(path, "w") as f:
            f.writelines("%d %d 1\n" % (i, 2 * i) for i in range(10))
        told = d.ctl("mesh", "--planar", "--tile", "5", "-o", tiles, path).ok()
        expect(told.err.count("10 vertices lie in no tile, since there are no triangles") == 1, told.err)
        got = d.ctl("mesh", "--planar", "--tile", "5", "-o", tiles, path, "--json").ok().json()
        expect(got["tiles"]["files"] == 0 and sum("lie in no tile" in w for w in got["warnings"]) == 1, str(got))
        with open(path, "a") as f:
            f.write("5 5 1\n")
        got = d.ctl("mesh", "--planar", "--tile", "5", "-o", tiles, path, "--json").ok().json()
        expect(got["tiles"]["files"] and not any("tile" in w for w in got["warnings"]), str(got))
        got = d.ctl("mesh", "--planar", "--tile", "5", "--max-edge", "0.5", "-o", tiles, path, "--json").ok().json()
        expect(got["tiles"]["files"] == 0 and any("no triangles but those that are left out" in w for w in got["warnings"]), str(got))


def few_positions():
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        path = os.path.join(base, "in.xyz")
        with open(path, "w") as f:
            for i in range(300000):
                f.write("%d %d %d\n" % (i % 3, i // 3 % 3, i % 7))
        got = mesh(d, base, path, oracle=False)
        expect(got["triangles"] == 8 and got["vertices"] == 9, str(got))


def convex_position():
    """A region that needs more positions than domains usually have room for gets a larger one, as long as the memory suffices."""
    with e2e.Folder() as base:
        path = os.path.join(base, "in.xyz")
        n = e2e.polygon(path, 290)
        expect(n > 4 * 40960, "%d corners: a quarter fits a domain of 24M" % n)
        with e2e.Daemon(base, memory="24M", name="wide") as d:
            got = mesh(d, base, path, oracle=False)
            expect(got["triangles"] == n - 2 and got["hull"] == n, str(got))
            d.ctl("push", "kept", path).ok()
            kept = d.ctl("submit", "kept", "--keep-withheld", "--keep-noise", "--wait", "--json").ok().json()
            expect(kept["digest"] == got["digest"], "another digest of a kept dataset: %s" % kept)
            d.stop(signal.SIGKILL)
            d.start()
            expect(d.ctl("fetch", str(kept["job"]), "--format", "null", "--json").ok().json()["digest"] == got["digest"], "after kill -9")
            d.stop()
            from_files_alone(base, d, n, got["digest"])


def domains(manifest, regions, out, memory):
    """Triangles and digest of all regions."""
    count, halves = 0, [0, 0]
    for region in regions:
        words = e2e.run([e2e.DOMAIN, "--memory", memory, manifest, "", region, out]).ok().out.split()
        digest = words[words.index("digest") + 1]
        count += int(words[words.index("triangles") + 1])
        halves = [(h + int(part, 16)) % 2**64 for h, part in zip(halves, (digest[:16], digest[16:]))]
    return count, "%016x%016x" % tuple(halves)


def from_files_alone(base, d, n, digest):
    """acut-domain gives such regions as much room, and says how much memory one needs that does not fit."""
    def plan(manifest, *options):
        r = e2e.run([e2e.DOMAIN, *options, "--plan", manifest, ""])
        return [line.split()[0] for line in r.out.splitlines()] if r.status == 0 else None

    manifest = next(path for top, _, files in os.walk(os.path.join(d.state, "datasets")) for path in (os.path.join(top, f) for f in files) if plan(path))
    out = os.path.join(base, "out")
    os.mkdir(out)
    for memory in "8M", "24M":
        regions = plan(manifest, "--memory", memory)
        expect(regions and domains(manifest, regions, out, memory) == (n - 2, digest), "with %s: %s" % (memory, regions))
    whole = plan(manifest, "--memory", "256M", "--load", "1000000")
    expect(len(whole) == 1, "regions: %s" % whole)
    r = e2e.run([e2e.DOMAIN, "--memory", "8M", manifest, "", whole[0], out])
    need = re.search("a region of %d positions needs .* of memory.*--memory ([0-9]+M) or more" % n, r.err, re.S)
    expect(r.status == 1 and need, "%d: %s" % (r.status, r.err))
    expect(domains(manifest, whole, out, need.group(1)) == (n - 2, digest), "with " + need.group(1))


e2e.main(
    one_position, convex_position, few_positions, flat_positions, tiles_of_no_triangles,
    case("uniform", 300000),
    case("grid", 300000, "--step", 1), case("grid", 300000, "--step", 16777),
    case("survey", 300000), case("clustered", 300000), case("two-clusters", 300000), case("duplicates", 300000),
    case("swath", 300000), case("gaussians", 300000), case("few", 300000), case("few", 30000, "--positions", 3, triangles=1),
    case("ring", 100000, may_refuse=True), case("corridor", 300000), case("corridor-diagonal", 300000),
    # Thin strips are normal surveys: what lies beside them is not read again for every domain.
    case("pipeline", 300000), case("pipeline-diagonal", 300000, reads=3), case("pipeline-slanted", 300000, reads=3),
    case("circle", 20000, may_refuse=True), case("circle", 300000, may_refuse=True),
    case("parabola", 20000), case("parabola", 200000, oracle=False),
    case("collinear", 1000, triangles=0), case("collinear", 300000, oracle=False, triangles=0))
