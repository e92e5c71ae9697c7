"""Every output format of `acutctl formats`, one after the other: a new one is in here by itself, or fails until OPTIONS has what it needs.
The same bytes with any memory and threads; meshes of nothing, of vertices alone and of one triangle; kill -9 of the client."""
import hashlib
import json
import os
import signal
import subprocess

import e2e
from e2e import expect, main

# What a format cannot do without.
OPTIONS = {"tif": ["--cell", "0.5"], "glb": ["--origin", "auto"], "stl": ["--origin", "auto"],
           "gpkg": ["--interval", "1"], "geojson": ["--interval", "1"], "dxf-contours": ["--interval", "1"]}


def formats():
    """Name, words of the command line, and the end of the file's name."""
    rows = [json.loads(line) for line in e2e.run([e2e.ACUTCTL, "formats", "--json"]).ok().out.splitlines()]
    rows = [r for r in rows if r["direction"] == "out" and r["format"] != "null"]
    expect(len(rows) >= 12, str([r["format"] for r in rows]))
    return [(r["format"], ["--format", r["format"], *OPTIONS.get(r["format"], [])], (r["extensions"] or ".file").split()[0]) for r in rows]


def survey(base, points, seed):
    path = os.path.join(base, "%d.las" % seed)
    e2e.run([e2e.SYNTH, "--points", str(points), "--seed", str(seed), path]).ok()
    return path


def digest(path):
    with open(path, "rb") as f:
        return hashlib.sha256(f.read()).hexdigest()


def canonical(d, job, words, out):
    """Whether the order of what is written can be asked for; where it cannot, there is one order."""
    r = d.ctl("fetch", job, "-o", out, *words, "--canonical")
    expect(r.status in (0, 2) and (not r.status or "--canonical has no meaning" in r.err), "%s: %s" % (words, r.err))
    return ["--canonical"] if not r.status else []


def same_bytes():
    """24M to 1G, 1 to 4 threads, and the inputs in one push or two, in any order."""
    seen = {}
    with e2e.Folder() as base:
        inputs = [survey(base, 30000, 1), survey(base, 30000, 2)]
        for memory, threads, pushes in (("24M", 1, [inputs]), ("1G", 4, [inputs[::-1]]), ("64M", 2, [inputs[:1], inputs[1:]])):
            folder = os.path.join(base, memory)
            os.mkdir(folder)
            with e2e.Daemon(folder, memory=memory, threads=threads) as d:
                for files in pushes:
                    d.ctl("push", "s", *files, "--override-crs", "EPSG:25832", "--override-units", "m,m").ok()
                job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
                for name, words, end in formats():
                    out = os.path.join(folder, "m" + end)
                    d.ctl("fetch", job, "-o", out, *words, *canonical(d, job, words, out)).ok()
                    expect(os.path.getsize(out) > 10000, "%s: %d bytes" % (name, os.path.getsize(out)))
                    seen.setdefault(name, []).append(digest(out))
        print("     %s" % ", ".join(seen))
        expect(all(len(v) == 3 and len(set(v)) == 1 for v in seen.values()), "other bytes: %s" % [n for n, v in seen.items() if len(set(v)) > 1])


def small_meshes():
    """Nothing, vertices alone, one triangle: a file each, and nothing beside it but what belongs to it."""
    shapes = {"nothing": ([(0, 0, 1)], ["--class", "77"]), "one": ([(3, 4, 5)], []), "line": ([(i, 2 * i, 3) for i in range(5)], []),
              "triangle": ([(0, 0, 0), (30, 0, 3), (0, 30, 6)], [])}
    with e2e.Folder() as base:
        for shape, (points, view) in shapes.items():
            path = os.path.join(base, shape + ".xyz")
            with open(path, "w") as f:
                f.writelines("%d %d %d\n" % p for p in points)
            with e2e.Daemon(base, memory="24M", threads=1, name=shape) as d:
                d.ctl("push", "s", path, "--assume-units", "m,m").ok()
                job = d.ctl("submit", "s", "--wait", "--json", *view).ok().json()["job"]
                for name, words, end in formats():
                    folder = os.path.join(base, shape + name)
                    os.mkdir(folder)
                    got = d.ctl("fetch", job, "-o", os.path.join(folder, "m" + end), *words, "--json").ok().json()
                    expect(got["vertices"] == (0 if view else len(points)) and got["triangles"] == (shape == "triangle"), "%s %s: %s" % (shape, name, got))
                    expect("m" + end in os.listdir(folder) and all(n.startswith("m.") and ".part" not in n for n in os.listdir(folder)), str(os.listdir(folder)))


def killed():
    """Killed at a write, or when the file is to get its name, and begun anew: the bytes of an undisturbed fetch, and nothing left."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M", threads=2) as d:
        gate, outs = e2e.Gate(base), os.path.join(base, "outs")
        os.mkdir(outs)
        d.ctl("push", "s", survey(base, 30000, 3), "--override-units", "m,m").ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        env = dict(os.environ, ACUT_SOCKET=d.socket, **gate.env)
        for name, words, end in formats():
            out = os.path.join(outs, "m" + end)
            words = words + canonical(d, job, words, out)
            want, files = d.ctl("fetch", job, "-o", out, *words).ok() and digest(out), sorted(os.listdir(outs))
            for n in files:
                os.unlink(os.path.join(outs, n))
            for call, first in (("pwrite", 0), ("fsync", 0), ("pwrite", 1), ("renameat", 0)):
                gate.close(call, "/outs", first)
                p = subprocess.Popen([e2e.ACUTCTL, "fetch", str(job), "-o", out, *words], env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                if gate.wait(lambda: p.poll() is not None):
                    p.send_signal(signal.SIGKILL)
                    p.wait()
                    expect(not os.path.exists(out) or digest(out) == want, "%s, killed at %s: another file" % (name, call))
                gate.open()
            d.ctl("fetch", job, "-o", out, *words).ok()
            left = [n for n in sorted(os.listdir(outs)) if not n.startswith(".")]
            expect(digest(out) == want and left == files, "%s: %s, not %s" % (name, left, files))
            for n in os.listdir(outs):
                os.unlink(os.path.join(outs, n))


if __name__ == "__main__":
    main(same_bytes, small_meshes, killed)
