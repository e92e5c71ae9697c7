"""What the phases of a cluster run make of files is what a push of the same files makes: the same sources, content, rounded and left-out
numbers, and the same mesh. The dataset is taken by `acutctl dataset import` as it is."""
import json
import os
import random
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "..", "e2e"))
import e2e
import geo
from e2e import expect

RUN = os.environ.get("ACUT_SURVEY_RUN", "survey-run")
DEGREES = [(1024, 0, 1, 2), (2048, 0, 1, 4326)]


def staged(base, name, files, stages, *options, memory="64M"):
    """Runs all phases; the path of the dataset's folder, and the totals of its stages."""
    work = os.path.join(base, name)
    listed = os.path.join(base, name + ".list")
    with open(listed, "w") as f:
        f.write("".join(p + "\n" for p in files))
    with open(listed) as f:
        e2e.run([RUN, work, str(stages), memory, *options], stdin=f).ok()
    totals = {"moved": 0, "left_out": 0, "points": 0}
    for i in range(stages):
        with open(os.path.join(work, "done", "stage-%d" % i)) as f:
            for line in f:
                word = line.split()
                if word[0] == "value" and word[1] in totals:
                    totals[word[1]] += int(word[2])
    return os.path.join(work, "dataset"), totals


def mesh(d, dataset):
    job = d.ctl("submit", dataset, "--wait").ok().out.split()[0]
    r = d.ctl("show", job, "--json").ok().json()
    return r["digest"], r["vertex_digest"], r["triangles"]


def sources(d, dataset):
    """Without their numbers, which are by place in one and by the order of the command in the other."""
    g = json.loads(d.ctl("dataset", "log", dataset, "--json", "--files").ok().out)
    files = sorted(g["files"], key=lambda f: f["path"])
    for f in files:
        del f["source"]
    return g["content"], files


def shown(d, dataset):
    s = d.ctl("dataset", "show", dataset, "--json").ok().json()
    return {k: s[k] for k in ("points", "files", "lattice", "crs", "unit_xy", "unit_z", "box") if k in s}


def compare(base, files, push=(), run=(), counts=((1, 0), (3, 2))):
    """`counts`: of stages, of sort tasks."""
    with e2e.Daemon(base) as d:
        pushed = [json.loads(line) for line in d.ctl("push", "pushed", *files, *push, "--json").ok().out.splitlines()]
        pushed = [p for p in pushed if p["file"] is not None]
        for n, sorts in counts:
            name = "staged%d" % n
            folder, totals = staged(base, name, files, n, "grows=1", "sorts=%d" % sorts, *run)
            d.ctl("dataset", "import", folder, name).ok()
            for what in (sources, shown, mesh):
                expect(what(d, name) == what(d, "pushed"), "%s:\n%s\n%s" % (what.__name__, what(d, name), what(d, "pushed")))
            expect(totals["moved"] == sum(p["moved"] for p in pushed), "%s %s" % (totals, pushed))
            expect(totals["left_out"] == sum(p["lines_left_out"] for p in pushed), "%s %s" % (totals, pushed))
            # A push of the same files finds them there.
            again = [json.loads(line) for line in d.ctl("push", name, *files, *push, "--json").ok().out.splitlines()]
            expect(all(p["state"] == "known" for p in again if p["file"] is not None), again)


def tiles_of_a_survey():
    with e2e.Folder() as base:
        files = []
        for i in range(8):
            files.append("%s/tile%d.las" % (base, i * 5 % 8))
            e2e.run([e2e.SYNTH, "--points", "20k", "--origin", "%d,%d" % (500000 + i % 3 * 50, 5400000 + i // 3 * 50), "--seed", str(i),
                     files[-1]]).ok()
        compare(base, files, counts=((1, 0), (3, 0), (8, 5)))


def degrees_and_a_geoid():
    with e2e.Folder() as base:
        files = [geo.las("%s/%d.las" % (base, i), geo.cloud(47.25, 11.9 + i * 0.1, seed=i), keys=DEGREES) for i in range(4)]
        grid = geo.pgm(base + "/slope.pgm", lambda lat, lon: 30 + lat / 10)
        compare(base, files)
        for f in ("staged1", "staged3", "state", "cache"):
            e2e.run(["rm", "-rf", "%s/%s" % (base, f)])
        units = ("--assume-units", ",m", "--geoid", grid)
        compare(base, files, push=units, run=("unit_z=metre", "geoid=" + grid))


def texts():
    """Points are rounded, lines left out, degrees assumed."""
    with e2e.Folder() as base:
        r = random.Random(5)
        files = []
        for i in range(4):
            files.append("%s/%d.xyz" % (base, i))
            with open(files[-1], "w") as f:
                for k in range(500):
                    f.write("%.9f %.9f %s\n" % (11.5 + i * .01 + r.random() * .01, 47 + r.random() * .01, "nan" if k == 7 * i else "%.4f" % (k / 7)))
        compare(base, files, push=("--assume-crs", "EPSG:4326", "--scale", "0.01,0.001"),
                run=("assume=EPSG:4326", "scale_xy=0.01", "scale_z=0.001"))
        for f in ("staged1", "staged3", "state", "cache"):
            e2e.run(["rm", "-rf", "%s/%s" % (base, f)])
        compare(base, files, push=("--override-crs", "EPSG:25832", "--scale", "0.001"), run=("override=EPSG:25832", "scale_xy=0.001"))


def one_step():
    """A mesh of files has a lattice that leaves no room."""
    with e2e.Folder() as base:
        r = random.Random(6)
        files = []
        for i in range(3):
            files.append("%s/%d.xyz" % (base, i))
            with open(files[-1], "w") as f:
                for k in range(400):
                    f.write("%.10f %.10f %.7f\n" % (700000 + i * 30 + r.random() * 40, 5200000 + r.random() * 40, r.random()))
        with e2e.Daemon(base) as d:
            m = d.ctl("mesh", *files, "--json", "-o", base + "/m.ply").ok().json()
            folder, _ = staged(base, "staged", files, 2)
            d.ctl("dataset", "import", folder, "staged").ok()
            expect(mesh(d, "staged") == (m["digest"], m["vertex_digest"], m["triangles"]), "another mesh")


def real_files():
    data = e2e.data_dir()
    if not data:
        print("skipped: there are no real files")
        return
    for names in (("las12_pdrf1_ahn3_213k.laz", "las12_pdrf1_ahn3_641k.laz"), ("las13_pdrf1_forest_217k.laz",),
                  ("las14_pdrf10.laz", "las14_pdrf10.las")):
        with e2e.Folder() as base:
            compare(base, [os.path.join(data, "lidar", n) for n in names], counts=((2, 3),))


if __name__ == "__main__":
    e2e.main(tiles_of_a_survey, degrees_and_a_geoid, texts, one_step, real_files)
