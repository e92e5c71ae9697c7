"""Weights by file: a better flight hides a worse one of the same dataset. CGAL's regular triangulation of the same positions, with any
memory, threads, order and division of files, in views that select points, and over generations; names of files are resolved once."""
import json
import os
import random
import shutil

import e2e
import weights
from e2e import expect


def write(base, name, points):
    path = os.path.join(base, name)
    os.makedirs(os.path.dirname(path), exist_ok=True)
    return weights.points_file(os.path.dirname(path), points, os.path.basename(path))


def compare(got, parts, what):
    """parts: lists of points, each with the radius of its file, or radii of classes."""
    points, radius = [], {}
    for k, (pts, of) in enumerate(parts):
        for p in pts:
            kind = (k, p[3])
            radius[kind] = of.get(p[3], 0) if isinstance(of, dict) else of
            points.append((*p[:3], kind))
    return weights.compare(got, points, radius, what)


def submit(d, name, weight, *options):
    return d.ctl("submit", name, "--wait", "--json", "--weight", weight, *options).ok().json()


def verified(mesh, files, got, *options):
    r = e2e.run([e2e.VERIFY, "--json", *options, mesh, *files]).ok().json()
    expect(r["good"] and r["hidden"] == got["removed"]["weight"], "%s: %s" % (options, r))


def same(got):
    return tuple(got[k] for k in ("digest", "vertex_digest", "vertices", "triangles", "hull")) + (got["removed"]["weight"],)


def flights(rng, n):
    """A flight everywhere, and a better one in a strip that is part of it. Some positions are in both."""
    size = int(n ** .5 * 10)
    old = [(rng.randrange(size), rng.randrange(size), rng.randrange(90), rng.choice((1, 2))) for _ in range(n)]
    new = [(rng.randrange(size // 3, size // 2), rng.randrange(size), 500 + rng.randrange(9), rng.choice((1, 2))) for _ in range(n // 4)]
    return old, new + [(*p[:2], 700, 2) for p in old[::40]]


def tiny():
    """Random sets in tiny ranges, each file with a radius of its own, with none, or with that of a class."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        hidden = 0
        for seed in range(40):
            rng = random.Random(seed)
            size = rng.choice([3, 5, 9, 30])
            parts, rules, name = [], [], "t%d" % seed
            classes = {cls: 1 + rng.randrange(size) for cls in (1, 2) if rng.randrange(2)}
            for i in range(4):
                points = [(rng.randrange(size), rng.randrange(size), rng.randrange(4), rng.randrange(4)) for _ in range(rng.randrange(1, 30))]
                points += [(0, 0, 0, 1), (size, 0, 0, 1), (0, size, 0, 1)] if not i else []
                radius = rng.choice((None, 0, 1 + rng.randrange(size)))
                d.ctl("push", name, write(base, "%s/f%d.csv" % (name, i), points)).ok()
                rules += [] if radius is None else ["f%d.csv=%d" % (i, radius)]
                parts.append((points, classes if radius is None else radius))
            rules += ["%d=%d" % row for row in classes.items()] or ["99=5"]
            rng.shuffle(rules)
            hidden += compare(submit(d, name, ",".join(rules)), parts, "%s of %s" % (rules, parts))
        expect(hidden > 100, "only %d hidden" % hidden)


def any_memory():
    rng = random.Random(5)
    old, new = flights(rng, 60000)
    with e2e.Folder() as base:
        seen = set()
        for memory, threads in (("24M", 1), ("24M", 2), ("256M", 1), ("256M", 2)):
            folder = "%s-%d" % (memory, threads)
            files = [write(base, "%s/2019/part%d.csv" % (folder, i), old[i::3]) for i in range(3)]
            files += [write(base, "%s/2024/part%d.csv" % (folder, i), new[i::2]) for i in range(2)]
            rng.shuffle(files)
            with e2e.Daemon(base, memory=memory, threads=threads, name=folder) as d:
                # In one push, or in many; the files have other numbers each time.
                for some in [files[:2], files[2:]] if threads == 1 else [files]:
                    d.ctl("push", "s", *some).ok()
                got = submit(d, "s", "2024/*.csv=20")
                seen.add(same(got))
                if folder == "24M-1":
                    expect(got["domains"] >= 3, "only %d domains" % got["domains"])
                    hidden = compare(got, [(old, 0), (new, 20)], "flights")
                    expect(hidden > 3000, "only %d hidden" % hidden)
                for weight in ("2024/=20", folder + "/2024/part?.csv=20", "%s/%s/2024/=20" % (base, folder), "99=3,./2024/*=20"):
                    again = submit(d, "s", weight)
                    expect(same(again) == same(got), "%s: %s" % (weight, again))
                expect(submit(d, "s", "2024/=20")["job"] == got["job"], "the same view by another name is the same job")
                out = os.path.join(base, folder + ".ply")
                d.ctl("fetch", str(got["job"]), "-o", out).ok()
                expect("element vertex %d\n" % got["vertices"] in open(out, errors="replace").read(2000), "vertices of the file")
                verified(out, files, got, "--weight", "2024/=20")
                verified(out, files, got, "--weight", "2024/*.csv=20", "--view", got["view"])
                for args in (["--weight", "2019/=20"], ["--weight", "2024/=20,2019/part1.csv=9"], []):
                    expect(e2e.run([e2e.VERIFY, *args, out, *files]).status == 1, "other weights: %s" % args)
                r = e2e.run([e2e.VERIFY, "--view", got["view"], out, *files])
                expect(r.status == 2 and "--weight beside --view" in r.err, r.err)
                # The other flight is another mesh, with the same numbers of points.
                other = submit(d, "s", "2019/=20")
                expect(other["digest"] != got["digest"] and other["domains_reused"] == 0, other)
        expect(len(seen) == 1, seen)


def selected():
    """crop, every and thin make a grid of their own, in which each radius is a source."""
    rng = random.Random(6)
    old, new = flights(rng, 3000)
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        d.ctl("push", "s", write(base, "a/old.csv", old), write(base, "a/new.csv", new)).ok()
        box = (50, 60, 400, 500)
        files = [os.path.join(base, n) for n in ("a/old.csv", "a/new.csv")]
        out = os.path.join(base, "x.ply")

        def inside(points):
            return [p for p in points if box[0] <= p[0] <= box[2] and box[1] <= p[1] <= box[3]]

        compare(submit(d, "s", "new.csv=25", "--crop", "%d,%d,%d,%d" % box), [(inside(old), 0), (inside(new), 25)], "crop")
        compare(submit(d, "s", "new.csv=25,2=9", "--crop", "%d,%d,%d,%d" % box), [(inside(old), {2: 9}), (inside(new), 25)], "crop, class")
        compare(submit(d, "s", "old.csv=4,new.csv=25"), [(old, 4), (new, 25)], "both")
        compare(submit(d, "s", "2=25,old.csv=0"), [(old, 0), (new, {2: 25})], "one file without the weight of its class")
        best = {}
        for k, points in enumerate((old, new)):
            for p in points:
                # The order of view_thin_compare: z, class, position, and of equal points that with the radius.
                row = (p[2], p[3], p[0], p[1], -k)
                at = p[0] // 9, p[1] // 9
                best[at] = min(best.get(at, row), row)
        kept = [[(x, y, z, cls) for z, cls, x, y, k in best.values() if k == -i] for i in range(2)]
        got = submit(d, "s", "new.csv=25", "--thin", "9")
        compare(got, [(kept[0], 0), (kept[1], 25)], "thin")
        d.ctl("fetch", str(got["job"]), "-o", out).ok()
        verified(out, files, got, "--view", got["view"], "--weight", "new.csv=25")
        # Equal records in both files: that with the radius is taken.
        both = [write(base, "b/old.csv", old + new), write(base, "b/new.csv", new)]
        got = d.ctl("mesh", *both, "--weight", "new.csv=25", "--thin", "9", "-o", out, "--json").ok().json()
        verified(out, both, got, "--view", "ask 1 thin=9:lowest", "--weight", "new.csv=25")
        # A file's radius in place of that of its class, and none.
        got = d.ctl("mesh", *files, "--weight", "2=9,new.csv=25,old.csv=0", "-o", out, "--json").ok().json()
        compare(got, [(old, 0), (new, 25)], "mesh")
        verified(out, files, got, "--weight", "2=9,a/new.csv=25,old.csv=0")
        for weight in ("2=9,new.csv=25", "2=9,old.csv=0", "2=9"):
            expect(e2e.run([e2e.VERIFY, "--weight", weight, out, *files]).status == 1, weight)


def generations():
    rng = random.Random(7)
    old, new = flights(rng, 150000)
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        a, b = write(base, "old.csv", old), write(base, "new.csv", new)
        d.ctl("push", "s", a, b).ok()
        first = submit(d, "s", "new.csv=15")
        compare(first, [(old, 0), (new, 15)], "at first")
        # A better delivery replaces the better flight. It has another number.
        strip = len(old) // 4
        better = [(x, y, z + 1, cls) for x, y, z, cls in new[:strip:2]] + new[strip:]
        write(base, "new.csv", better)
        d.ctl("push", "s", "--replace", b).ok()
        second = submit(d, "s", "new.csv=15")
        compare(second, [(old, 0), (better, 15)], "replaced")
        expect(second["view"] != first["view"], "%s is also %s" % (first["view"], second["view"]))
        # What is far from the better flight is taken, though the numbers are others.
        expect(0 < second["domains_reused"] < second["domains"], "replaced: %s" % second)
        at = submit(d, "s", "new.csv=15", "--at", "1")
        expect(at["job"] == first["job"], "generation 1: %s" % at)
        # A third file that the pattern means joins a job, but not one that was there.
        more = [(*p[:2], 3, 1) for p in old[::50]]
        d.ctl("push", "s", write(base, "new2.csv", more)).ok()
        compare(submit(d, "s", "new*=15"), [(old, 0), (better, 15), (more, 15)], "three files")
        compare(submit(d, "s", "new.csv=15"), [(old, 0), (better, 15), (more, 0)], "two of three files")
        d.ctl("dataset", "revert", "s", "3").ok()
        d.ctl("dataset", "revert", "s", "2").ok()
        again = submit(d, "s", "new.csv=15")
        expect(again["view"] == first["view"] and again["job"] != first["job"], again)
        expect(same(again) == same(first) and again["domains_reused"] == again["domains"] > 1, "reverted: %s" % again)
        fresh = submit(d, "s", "new.csv=15", "--at", "2", "--new")
        expect(same(fresh) == same(second), "generation 2: %s" % fresh)


def same_content():
    """The same points from other files are other sources: what is stored for one is not taken for the other."""
    rng = random.Random(8)
    old, new = flights(rng, 20000)
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        a, b = write(base, "old.csv", old), write(base, "new.csv", new)
        d.ctl("push", "s", a, b).ok()
        plain = d.ctl("submit", "s", "--wait", "--json").ok().json()
        got = submit(d, "s", "new.csv=15")
        # A dataset in which the numbers are exchanged: the views have the same text.
        d.ctl("push", "t", b, a).ok()
        other = submit(d, "t", "old.csv=15")
        mine = submit(d, "t", "new.csv=15")
        texts = {job["view"]: job for job in (got, other, mine)}
        expect(len(texts) == 2, "views %s" % list(texts))
        compare(other, [(old, 15), (new, 0)], "exchanged")
        expect(same(mine) == same(got) and other["digest"] not in (got["digest"], plain["digest"]), "%s\n%s\n%s" % (got, other, mine))
        # Selections likewise.
        crop = ("--crop", "0,0,900,900")
        first, second = submit(d, "s", "new.csv=15", *crop), submit(d, "t", "old.csv=15", *crop)
        expect(first["digest"] != second["digest"], "selections: %s" % first)
        expect(same(submit(d, "t", "new.csv=15", *crop)) == same(first), "a selection of another dataset")


def named():
    """People read names of files where views have numbers; programs read the view."""
    rng = random.Random(10)
    old, new = flights(rng, 500)
    metres = ("--assume-crs", "EPSG:2154", "--assume-units", "m,m")
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        a, b = write(base, "old.csv", old), write(base, "new: #1.csv", new)
        d.ctl("push", "s", a, b, *metres).ok()
        one = submit(d, "s", "new*=15")
        d.ctl("push", "s", "--replace", write(base, "new: #1.csv", new[1:]), *metres).ok()
        files = [write(base, "f%d.csv" % i, [(i, 0, 0, 1)]) for i in range(4)]
        d.ctl("push", "s", *files, *metres).ok()
        two = submit(d, "s", "*.csv=15,77=3")
        for job, want in ((one, "weight=new: #1.csv:15"), (two, "weight=77:3,old.csv+new: #1.csv+f0.csv and 3 more:15")):
            told = d.ctl("show", str(job["job"])).ok().out
            expect(any(line.startswith("view") and line.endswith(want) for line in told.splitlines()), "not %s: %s" % (want, told))
        expect(d.ctl("show", str(two["job"]), "--json").ok().json()["view"] == two["view"], two["view"])
        told = d.ctl("volume", str(one["job"]), str(two["job"])).ok().err
        expect("weight=new: #1.csv:15" in told and "old.csv+new: #1.csv+f0.csv and 3 more" in told, told)


def commands():
    rng = random.Random(9)
    old, new = flights(rng, 2000)
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        a, b = write(base, "x/old, v=1.csv", old), write(base, "y/new.csv", new)
        # Without a dataset.
        out = os.path.join(base, "x.ply")
        r = d.ctl("mesh", a, b, "--weight", "y/=20", "-o", out, "--json").ok().json()
        compare(r, [(old, 0), (new, 20)], "mesh")
        odd, there = write(base, 'x/q"\\\u00e4.csv', old), os.path.join(base, "odd.geojson")
        d.ctl("mesh", odd, b, "--weight", "new.csv=20", "--format", "null", "--weight-report", there).ok()
        expect({p[5] for p in places_of(there)} == {'q"\\\u00e4.csv'}, {p[5] for p in places_of(there)})
        r = d.ctl("mesh", a, b, "--weight", "old? v=1.csv=20", "-o", out, "--json").ok().json()
        compare(r, [(old, 20), (new, 0)], "a comma in the name is a ?")
        d.ctl("push", "s", a, b).ok()
        expect(d.ctl("plan", "s", "--weight", "new.csv=20", "--json").ok().json()["points"] == len(old) + len(new), "plan")
        with open(os.path.join(base, "lines.csv"), "w") as f:
            f.write("x,y,z,name\n1,1,5,a\n90,80,5,a\n")
        d.ctl("push", "s", "--lines-as", "hard", f.name).ok()
        write(base, "y/new.csv", new[1:])
        shutil.copy(b, os.path.join(base, "y/newer.csv"))
        d.ctl("push", "s", "--replace", "--replaces", b, os.path.join(base, "y/newer.csv")).ok()
        for weight, status, said in (("nwe.csv=5", 4, "newer.csv"), ("new.csv=5", 4, "--at"), ("lines.csv=5", 4, "lines"), ("z/=5", 4, "generation 3"),
                                     ("old*=5,x/=6", 2, "two radii"), ("newer.csv=-1", 2, "length"), ("newer.csv", 2, "radius"),
                                     ("=5", 2, "radius"), ("300=5", 2, "radius"), ("newer.csv=2000000000", 2, "2^30"),
                                     ("n" * 5000 + "=5", 2, "5000 bytes"), (",".join(["new?*.csv=5"] * 1001), 1, "1000 files")):
            for command in ("submit", "plan"):
                r = d.ctl(command, "s", "--no-breaklines", "--weight", weight)
                expect(r.status == status and said in r.err, "%s %.99s: %d, %s" % (command, weight, r.status, r.err))
        compare(submit(d, "s", "old*=5,x/=5", "--no-breaklines"), [(old, 5), (new[1:], 0)], "named twice with one radius")


def note():
    """Weights by class on points without a class."""
    rng = random.Random(10)
    old, new = flights(rng, 300)
    raw = [(*p[:3], 1) for p in old]
    good = [(*p[:3], 9) for p in new]
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        d.ctl("push", "s", write(base, "raw.csv", raw), write(base, "good.csv", good)).ok()
        for weight, more, said in (("9=5", (), True), ("9=5", ("--not-class", "1"), False), ("9=5", ("--class", "9"), False),
                                   ("9=5,1=2", (), False), ("good.csv=5", (), False), ("9=5,raw.csv=1", (), False),
                                   ("9=5,good.csv=7", (), True), ("9=0", (), False), ("9=5", ("--crop", "0,0,99,99"), True)):
            got = submit(d, "s", weight, *more)
            expect(("not classified" in str(got["notes"])) == said, "%s %s: %s" % (weight, more, got["notes"]))
        r = d.ctl("submit", "s", "--wait", "--weight", "9=5").ok()
        expect("note: points that are not classified" in r.err + r.out, r.err)
        d.ctl("push", "t", write(base, "good.csv", good)).ok()
        expect(submit(d, "t", "9=5")["notes"] == [], "all have a class")
        # Some without a class among classified points: the note about the ground is worth more.
        ground = [(*p[:3], 2) for p in old]
        d.ctl("push", "u", write(base, "ground.csv", ground), write(base, "few.csv", [(*p[:3], 1) for p in new])).ok()
        for weight, said in (("2=5", "--ground"), ("9=5", "not classified"), ("few.csv=5", "--ground")):
            got = submit(d, "u", weight)
            expect(len(got["notes"]) == 1 and said in got["notes"][0], "%s: %s" % (weight, got["notes"]))


def places_of(path):
    with open(path) as f:
        rows = json.load(f)["features"]
    return sorted((*r["geometry"]["coordinates"], r["properties"]["class"], r["properties"]["source"], r["properties"]["file"]) for r in rows)


def hidden_of(parts, mesh):
    """The places that a report must have: positions without a vertex, each with the record that the view prefers. Parts are files:
    their points, radius (or radii of classes), number and name."""
    best = {}
    for points, of, source, name in parts:
        for x, y, z, cls in points:
            radius = of.get(cls, 0) if isinstance(of, dict) else of
            row = (-radius, z, cls, source, name)
            best[x, y] = min(best.get((x, y), row), row)
    with open(mesh) as f:
        there = {tuple(map(float, line.split()[1:3])) for line in f if line.startswith("v ")}
    return sorted((*at, z, cls, source, name) for at, (_, z, cls, source, name) in best.items() if at not in there)


def report(d, base, job, parts, what):
    mesh, to = os.path.join(base, "mesh.obj"), os.path.join(base, "hidden.geojson")
    d.ctl("fetch", str(job["job"]), "-o", mesh, "--weight-report", to).ok()
    got, want = places_of(to), hidden_of(parts, mesh)
    expect(len(got) == job["removed"]["weight"], "%s: %d places, %s" % (what, len(got), job["removed"]))
    expect(got == want, "%s: %s, not %s" % (what, list(set(got) - set(want))[:5], list(set(want) - set(got))[:5]))
    return len(got)


def chosen(d, base, job, files, what):
    """Of a rule that takes some points: each place is a point of the file that is named."""
    to = os.path.join(base, "hidden.geojson")
    d.ctl("fetch", str(job["job"]), "--format", "null", "--weight-report", to).ok()
    got, there = places_of(to), {name: set(points) for name, points in files.items()}
    expect(len(got) == job["removed"]["weight"] > 100, "%s: %d places, %s" % (what, len(got), job["removed"]))
    for x, y, z, cls, source, name in got:
        expect((x, y, z, cls) in there.get(name, ()) and source == 1 + list(files).index(name), "%s: %s" % (what, (x, y, z, cls, name)))


def hidden_places():
    """The positions that are hidden are named, each once, with class and file."""
    with e2e.Folder() as base:
        rng = random.Random(11)
        old, new = flights(rng, 40000)
        seen = set()
        for memory, threads in (("24M", 1), ("256M", 2)):
            with e2e.Daemon(base, memory=memory, threads=threads, name=memory) as d:
                a, b = write(base, "old.csv", old), write(base, "new.csv", new)
                d.ctl("push", "s", a, b).ok()
                job = submit(d, "s", "new.csv=20")
                expect(report(d, base, job, [(old, 0, 1, "old.csv"), (new, 20, 2, "new.csv")], memory) > 2000, job)
                by_class = submit(d, "s", "2=15,new.csv=0")
                report(d, base, by_class, [(old, {2: 15}, 1, "old.csv"), (new, 0, 2, "new.csv")], "by class")
                # A selection has no files: they are looked up in the generation. The second time nothing is selected again.
                job = submit(d, "s", "new.csv=20", "--crop", "0,0,900,900")
                crop = [[p for p in points if p[0] <= 900 and p[1] <= 900] for points in (old, new)]
                report(d, base, job, [(crop[0], 0, 1, "old.csv"), (crop[1], 20, 2, "new.csv")], "crop")
                for rule in ("--every", "--thin"):
                    chosen(d, base, submit(d, "s", "new.csv=20", rule, "3"), {"old.csv": old, "new.csv": new}, rule)
                out = os.path.join(base, "one.geojson")
                got = d.ctl("mesh", a, b, "--weight", "new.csv=20", "--format", "null", "--weight-report", out, "--json").ok().json()
                places = places_of(out)
                expect(len(places) == got["removed"]["weight"] and {p[4] for p in places} == {1}, "mesh: %d" % len(places))
                seen.add(str(places))
                for args, status in ((["mesh", a, "--format", "null", "--weight-report", out], 2),
                                     (["fetch", str(d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]), "--format", "null", "--weight-report", out], 2)):
                    r = d.ctl(*args)
                    expect(r.status == status and "nothing is hidden" in r.err, "%s: %d, %s" % (args, r.status, r.err))
                refused_reports(d, base, a, job["job"])
        expect(len(seen) == 1, "places differ with the memory")


def refused_reports(d, base, path, job):
    """What makes no report is said before the mesh is written."""
    mesh, there = os.path.join(base, "refused.ply"), os.path.join(base, "there.geojson")
    with open(there, "w") as f:
        f.write("kept")
    new = os.path.join(base, "r.geojson")
    for more, to, said in ((["--weight", "2=5", "--bbox", "0,0,9,9"], new, "window"), (["--weight", "2=0"], new, "nothing is hidden"),
                           (["--weight", "2=0.000000001"], new, "nothing is hidden"), (["--weight", "2=5"], os.path.join(base, "none/r.geojson"), "none"),
                           (["--weight", "2=5"], mesh, "of its own"), (["--weight", "2=5"], base + "/./refused.ply", "of its own"),
                           (["--weight", "2=5", "--no-clobber"], there, "--no-clobber"), (["--weight", "2=5"], path, "one of the inputs")):
        r = d.ctl("mesh", path, *more, "-o", mesh, "--weight-report", to)
        expect(r.status in (2, 74) and said in r.err and not os.path.exists(mesh), "%s %s: %d, %s" % (more, to, r.status, r.err))
        if more[2:] or more[1] != "2=5" or to == path:
            continue
        r = d.ctl("fetch", str(job), "-o", mesh, "--weight-report", to)
        expect(r.status in (2, 74) and said in r.err and not os.path.exists(mesh), "fetch %s: %d, %s" % (to, r.status, r.err))
    r = d.ctl("mesh", path, "--weight", "2=5", "-o", "-", "--format", "ply", "--weight-report", "/dev/stdout")
    expect(r.status == 2 and "standard output" in r.err, "%d, %s" % (r.status, r.err[:200]))
    with open(there) as f:
        expect(f.read() == "kept" and not os.path.exists(new), "a report was written")


def tiny_places():
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        n = 0
        for seed in range(25):
            rng = random.Random(seed)
            size = rng.choice([1, 3, 5, 9])
            name, parts, rules = "t%d" % seed, [], []
            for i in range(3):
                points = [(rng.randrange(size), rng.randrange(size), rng.randrange(3), rng.randrange(3)) for _ in range(rng.randrange(1, 30))]
                d.ctl("push", name, write(base, "%s/f%d.csv" % (name, i), points)).ok()
                radius = rng.randrange(size + 1)
                rules.append("f%d.csv=%d" % (i, radius))
                parts.append((points, radius, i + 1, "f%d.csv" % i))
            if any(p[1] for p in parts):
                n += report(d, base, submit(d, name, ",".join(rules)), parts, str(parts))
        expect(n > 50, "only %d" % n)


if __name__ == "__main__":
    e2e.main(tiny, any_memory, selected, generations, same_content, named, commands, note, hidden_places, tiny_places)
