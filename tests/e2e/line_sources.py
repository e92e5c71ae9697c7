"""Files of lines as sources of a dataset: whatever is pushed, replaced, reverted, pruned, copied or interrupted, the mesh is that of
a dataset that got the same files at once, in any order. Texts of lines are written here by hand (docs/formats/lines.md)."""
import json
import os
import random
import shutil
import signal

import e2e
from e2e import expect
from resume import Half, pending
from survey import las, says, show

try:
    from acut_wire import Client, Refused, pb
except ImportError as e:
    e2e.skip("python3-xxhash and python3-protobuf are needed: %s" % e)

KEYS = ("digest", "vertex_digest", "vertices", "triangles", "points")


def cloud(base, name="cloud.las", seed=1, n=4000):
    rng = random.Random(seed)
    return las(os.path.join(base, name), [(rng.randrange(10000), rng.randrange(10000), rng.randrange(1000)) for _ in range(n)])


def lines(base, name, *features, head=()):
    """A text: each feature is (number, kind, vertices), a ring unless its kind is hard."""
    rows = ["acut-lines 1"] + list(head)
    for number, kind, vertices in features:
        rows += ["feature %d %s" % (number, kind), "line" if kind == "hard" else "ring"]
        rows += ["%.2f %.2f %.2f" % v for v in vertices]
    path = os.path.join(base, name)
    with open(path, "w") as f:
        f.write("\n".join(rows) + "\n")
    return path


RIDGE = (17, "hard", [(10, 12, 5), (50, 55, 6), (90, 60, 7)])
ROAD = (1, "hard", [(12, 80, 3), (85, 20, 3.5)])
POND = (2, "lake", [(30, 30, 4), (40, 31, 4), (38, 42, 4)])


def push(d, name, *paths, more=()):
    return d.ctl("push", name, "--scale", "0.01,0.01", *more, *paths)


def mesh(d, name, *options):
    job = d.ctl("submit", name, "--wait", "--new", *options).ok().out.split()[0]
    got = d.ctl("show", job, "--json").ok().json()
    return {k: got[k] for k in KEYS}


def fresh(d, *paths, known={}):
    key = (d.socket,) + tuple(sorted((p, open(p, "rb").read()) for p in paths))
    if key not in known:
        name = "fresh%d" % len(known)
        push(d, name, *paths).ok()
        known[key] = mesh(d, name)
    return known[key]


def files(d, name, generation):
    c = Client(d.socket)
    got = list(c.ask("files_request", pb.FilesRequest(dataset=name, generation=generation)).files)
    c.close()
    return got


def folder(d, name):
    """The files of the dataset in its folder, without its segments and its manifest."""
    return sorted(n for n in os.listdir(os.path.join(d.state, "datasets", str(show(d, name)["id"])))
                  if not n.startswith("manifest-") and not n.endswith(".seg"))


def settled(d, name, want):
    e2e.until(lambda: folder(d, name) == want, lambda: "the folder has %s, not %s" % (folder(d, name), want))


def any_order():
    """Points and lines in any order, at once or one by one, make the same mesh; and what is known is not read again."""
    with e2e.Folder() as base:
        a, b, c = cloud(base), lines(base, "ridge.txt", RIDGE), lines(base, "road.txt", ROAD, POND)
        with e2e.Daemon(base) as d:
            push(d, "plain", a).ok()
            without = mesh(d, "plain")
            want = fresh(d, a, b, c)
            expect(want["digest"] != without["digest"], "lines change nothing")
            for i, order in enumerate(((a, b, c), (c, b, a), (b, a, c))):
                name = "order%d" % i
                for p in order:
                    push(d, name, p).ok()
                expect(mesh(d, name) == want, "%s: %s, not %s" % (order, mesh(d, name), want))
            says(push(d, "order0", a, b, c), 0, "there already")
            expect(show(d, "order0")["generation"] == 3, "what was there made a generation")
            expect(show(d, "order0")["points"] == 4000, "line vertices count as points")
            # What it says of its files.
            got = files(d, "order0", 3)
            expect([f.name for f in got] == ["road.txt"], got)
            expect(list(got[0].lines.features) == [1, 1, 0, 0] and got[0].lines.lines == 2 and got[0].lines.vertices == 5 and got[0].points == 0, got)
            cl = Client(d.socket)
            # For people, as JSON, and in Python.
            want_lines = {"hard": 1, "lake": 1, "boundary": 0, "hole": 0, "lines": 2, "vertices": 5}
            changes = [g["files"] for g in map(json.loads, d.ctl("dataset", "log", "order0", "--files", "--json").ok().out.splitlines())]
            expect([c[0]["lines"] and c[0]["lines"]["vertices"] for c in changes] == [None, 3, 5] and changes[2][0]["lines"] == want_lines, changes)
            rows = d.ctl("dataset", "log", "order0", "--files").ok().out.splitlines()
            sources = [str(c[0]["source"]) for c in changes]
            expect([r.split("\t")[4:] for r in rows] == [["4000", changes[0][0]["hash"], "-", "-", sources[0]],
                                                         ["-", changes[1][0]["hash"], "-", "1 hard: 1 line, 3 vertices", sources[1]],
                                                         ["-", changes[2][0]["hash"], "-", "1 hard, 1 lake: 2 lines, 5 vertices", sources[2]]], rows)
            got = show(d, "order0")
            expect(got["lines"] == {"files": 2, "hard": 2, "lake": 1, "boundary": 0, "hole": 0, "lines": 3, "vertices": 8} and got["files"] == 3, got)
            then = [d.ctl("dataset", "show", "order0", "--at", g, "--json").ok().json()["lines"] for g in "12"]
            expect(then[0] is None and then[1]["files"] == 1 and then[1]["vertices"] == 3, then)
            says(d.ctl("dataset", "show", "order0"), 0, "2 files of lines, 2 hard, 1 lake: 3 lines, 8 vertices")
            expect("of lines" not in d.ctl("dataset", "show", "plain").ok().out, "a dataset without lines has some")
            log = cl.ask("log_request", pb.LogRequest(dataset="order0")).generations
            expect([(g.files, g.points_added, g.lines_added) for g in log] == [(1, 4000, 0), (1, 0, 1), (1, 0, 2)], log)
            # The road crosses the ridge.
            places = cl.ask("places_request", pb.PlacesRequest(dataset="order0"))
            expect(places.total == len(places.places) and any(p.kind == "crossing" and p.lower < p.upper for p in places.places), places)
            # They are kept with the line set: for an earlier generation it is made by a mesh.
            e2e.until(lambda: len([n for n in folder(d, "order0") if n.startswith("lineset-")]) == 1, "line sets stay")
            try:
                cl.ask("places_request", pb.PlacesRequest(dataset="order0", generation=2))
                expect(False, "places of a line set that is not there")
            except Refused as e:
                expect(e.code == "not-found" and "--at" in e.error.hint, e)
            mesh(d, "order0", "--at", "2")
            expect(not cl.ask("places_request", pb.PlacesRequest(dataset="order0", generation=2)).total, "the ridge alone crosses nothing")
            one = cl.ask("places_request", pb.PlacesRequest(dataset="order0", after=1, limit=1))
            expect(list(one.places) == list(places.places)[1:2] and one.total == places.total, one)
            try:
                cl.ask("places_request", pb.PlacesRequest(dataset="order0", generation=9))
                expect(False, "a generation that never was has places")
            except Refused as e:
                expect(e.code == "not-found", e)
            cl.close()


def reverts_and_replacements():
    with e2e.Folder() as base:
        a, b, c = cloud(base), lines(base, "ridge.txt", RIDGE), lines(base, "road.txt", ROAD)
        with e2e.Daemon(base) as d:
            for p in (a, b, c):
                push(d, "d", p).ok()
            both, one, none = fresh(d, a, b, c), fresh(d, a, b), fresh(d, a)
            expect(mesh(d, "d") == both and mesh(d, "d", "--at", "2") == one and mesh(d, "d", "--at", "1") == none, "generations")
            d.ctl("dataset", "revert", "d").ok()
            expect(mesh(d, "d") == one, "a revert of lines")
            d.ctl("dataset", "revert", "d", "2").ok()
            expect(mesh(d, "d") == none, "all lines reverted")
            d.ctl("dataset", "revert", "d", "5").ok()
            expect(mesh(d, "d") == one, "lines are back")
            d.ctl("dataset", "revert", "d", "4").ok()
            expect(mesh(d, "d") == both, "all lines are back")
            # Another road in place of the old one.
            lines(base, "road.txt", (1, "hard", [(12, 70, 3), (85, 30, 3.5)]))
            says(push(d, "d", c), 1, "has a file of this name already")
            push(d, "d", c, more=["--replace"]).ok()
            expect(mesh(d, "d") == fresh(d, a, b, c) != both, "a replacement of lines")
            expect(mesh(d, "d", "--at", "7") == both, "the generation before")
            d.stop()
            d.start()
            expect(mesh(d, "d") == fresh(d, a, b, c) and mesh(d, "d", "--at", "7") == both, "after a restart")
            # What is pruned goes with its files.
            d.ctl("dataset", "prune", "d", "--keep", "1").ok()
            expect(mesh(d, "d") == fresh(d, a, b, c), "after a prune")
            settled(d, "d", ["lines-2", "lines-9", "lineset-10", "places-10"])
            d.ctl("cache", "verify").ok()


def never_together():
    """A revert makes the line set of lines that were in no generation together: that of a dataset which got these files only."""
    with e2e.Folder() as base:
        a, b, c, more = cloud(base), lines(base, "ridge.txt", RIDGE), lines(base, "road.txt", ROAD, POND), cloud(base, "more.las", 2, 500)
        bank = lines(base, "bank.txt", (3, "hard", [(5, 5, 1), (6, 90, 1), (80, 92, 2)]))
        with e2e.Daemon(base) as d:
            for p in (a, b, c, bank):
                push(d, "d", p).ok()
            got = d.ctl("dataset", "revert", "d", "2", "--json").ok().json()
            expect(got["generation"] == 5 and got["undone"] == 2, got)
            without = fresh(d, a, c, bank)
            expect(mesh(d, "d") == without, "a revert of the first lines")
            # Only the newest generation keeps its line set.
            kept = lambda: [n for n in folder(d, "d") if n.startswith("lineset-")]
            e2e.until(lambda: kept() == ["lineset-8"], "line sets stay")
            d.ctl("dataset", "revert", "d").ok()
            expect(mesh(d, "d") == fresh(d, a, b, c, bank), "all lines are back")
            d.ctl("dataset", "revert", "d").ok()
            expect(mesh(d, "d") == without, "and gone again")
            e2e.until(lambda: len(kept()) == 1, "line sets stay")
            # Others are made again for those who ask, once, and stay until the lines change again.
            expect(mesh(d, "d", "--at", "3") == fresh(d, a, b, c) and mesh(d, "d", "--at", "2") == fresh(d, a, b), "earlier generations")
            d.ctl("cache", "gc", "--all").ok()
            expect(mesh(d, "d", "--at", "4") == fresh(d, a, b, c, bank), "an earlier generation, by a revert")
            expect(mesh(d, "d", "--at", "1") == fresh(d, a) and mesh(d, "d", "--at", "5") == without, "without lines, and as the newest")
            some = kept()
            expect(len(some) == 5, some)
            expect(mesh(d, "d", "--at", "3", "--thin", "1") == mesh(d, "d", "--at", "3", "--thin", "1"), "a selection")
            expect(kept() == some, kept())
            # A replacement, then what was before it without the file that came in between.
            lines(base, "road.txt", (1, "hard", [(12, 70, 3), (85, 30, 3.5)]))
            push(d, "d", c, more=["--replace"]).ok()
            d.ctl("dataset", "revert", "d", "4").ok()
            expect(mesh(d, "d") == fresh(d, a, c), "the replacement alone")
            d.stop()
            d.start()
            expect(mesh(d, "d") == fresh(d, a, c) and mesh(d, "d", "--at", "7") == without, "after a restart")
            push(d, "d", more).ok()
            d.ctl("dataset", "prune", "d", "--keep", "1").ok()
            expect(mesh(d, "d") == fresh(d, a, c, more), "after a prune")
            d.ctl("cache", "verify").ok()


def copies():
    """Backups and exports have the files of lines, and a damaged one is refused."""
    with e2e.Folder() as base:
        a, b, c = cloud(base), lines(base, "ridge.txt", RIDGE), lines(base, "road.txt", ROAD, POND)
        with e2e.Daemon(base) as d:
            push(d, "d", a, b).ok()
            push(d, "d", c).ok()
            want, before = mesh(d, "d"), mesh(d, "d", "--at", "1")
            out = os.path.join(base, "out")
            d.ctl("dataset", "export", "d", out).ok()
            d.ctl("dataset", "import", out, "e").ok()
            expect(mesh(d, "e") == want and mesh(d, "e", "--at", "1") == before, "an import")
            push(d, "e", lines(base, "more.txt", (3, "hard", [(5, 5, 1), (6, 90, 1)]))).ok()
            expect(mesh(d, "e") == fresh(d, a, b, c, os.path.join(base, "more.txt")), "lines after an import")
            victim = next(n for n in sorted(os.listdir(out)) if n.startswith("lines-"))
            path = os.path.join(out, victim)
            with open(path, "rb") as f:
                good = f.read()
            bad = bytearray(good)
            bad[-5000] ^= 1
            os.unlink(path)
            with open(path, "wb") as f:
                f.write(bad)
            says(d.ctl("dataset", "import", out, "f"), 74, "damaged", victim)
            with open(path, "wb") as f:
                f.write(good)
            # Line sets are not believed, nor the records of their vertices: they are made of the lines. Here are those of another dataset.
            push(d, "other", lines(base, "other.txt", (7, "hard", [(5, 5, 1), (95, 90, 1)]))).ok()
            forged = os.path.join(d.state, "datasets", str(show(d, "other")["id"]))
            for kind in ("lineset-", "vertices-"):
                with open(os.path.join(forged, next(n for n in os.listdir(forged) if n.startswith(kind))), "rb") as f:
                    theirs = f.read()
                for mine in [os.path.join(out, n) for n in os.listdir(out) if n.startswith(kind)]:
                    size = os.stat(mine).st_size
                    os.unlink(mine)
                    with open(mine, "wb") as f:
                        f.write((theirs + bytes(size))[:size])
            d.ctl("dataset", "import", out, "g").ok()
            expect(not [n for n in os.listdir(os.path.join(d.state, "datasets", str(show(d, "g")["id"]))) if n[:7] in ("lineset", "vertice", "places-")],
                   "a line set was taken")
            d.ctl("cache", "gc", "--all").ok()
            expect(mesh(d, "g") == want and mesh(d, "g", "--at", "1") == before, "a forged line set counts")
            d.ctl("dataset", "export", "g", os.path.join(base, "again")).ok()
            d.ctl("cache", "verify").ok()
            to = os.path.join(base, "backup")
            d.ctl("backup", to, "--copy").ok()
            # Damage is found, and stays.
            path = os.path.join(d.state, "datasets", str(show(d, "d")["id"]), "lines-2")
            with open(path, "r+b") as f:
                f.seek(4096 + 100)
                f.write(b"x")
            says(d.ctl("cache", "verify"), 1, "lines-2")
        with e2e.Folder() as other:
            shutil.copytree(to, os.path.join(other, "state"))
            with e2e.Daemon(other) as r:
                expect(mesh(r, "d") == want and mesh(r, "d", "--at", "1") == before, "a backup")


def interrupted():
    """A push of points and lines that was killed goes on; one that is dropped leaves nothing."""
    with e2e.Folder() as base:
        a, b, c = cloud(base), lines(base, "ridge.txt", RIDGE), lines(base, "road.txt", ROAD, POND)
        with e2e.Daemon(base) as d:
            push(d, "d", a).ok()
            want = fresh(d, a, b, c)
            half = Half(d, "d", [b, c], 1)
            d.stop(signal.SIGKILL)
            half.c.close()
            d.start()
            expect("1 files" in pending(d, "d"), pending(d, "d"))
            says(push(d, "d", b, c), 0, "not read again")
            expect(mesh(d, "d") == want, "a push that was continued")
            e2e.until(lambda: not [n for n in folder(d, "d") if n.startswith("push-")], lambda: "what was taken over stays: %s" % folder(d, "d"))
            # Refused, or left: nothing stays.
            before = folder(d, "d")
            tilted = lines(base, "tilted.txt", (4, "lake", [(60, 60, 1), (70, 60, 1), (70, 70, 2)]))
            says(push(d, "d", tilted), 1, "feature 4", "it is a lake", "--lake-level")
            settled(d, "d", before)
            half = Half(d, "d", [tilted, lines(base, "other.txt", (5, "hard", [(1, 1, 1), (2, 2, 2)]))], 0)
            half.vanish()
            settled(d, "d", before)


def what_the_text_asks_for():
    """Levels of lakes, points along lines, strictness."""
    with e2e.Folder() as base:
        a = cloud(base)
        lake = [(60, 60, 1), (70, 60, 1.01), (70, 70, 2.5)]
        with e2e.Daemon(base) as d:
            for level, z in (("min", 1), ("max", 2.5), ("mean", 1.5)):
                tilted = lines(base, level + ".txt", (4, "lake", lake), head=["lake-level " + level])
                flat = lines(base, "flat-%s.txt" % level, (4, "lake", [(x, y, z) for x, y, _ in lake]))
                expect(fresh(d, a, tilted) == fresh(d, a, flat), level)
            there = lines(base, "there.txt", (1, "hard", [(10, 10, 1), (10, 31, 2)]), head=["densify 5"])
            back = lines(base, "back.txt", (1, "hard", [(10, 31, 2), (10, 10, 1), (10, 10, 1)]), head=["densify 5"])
            made = lines(base, "made.txt", (1, "hard", [(10, 10, 1), (10, 14.2, 1.2), (10, 18.4, 1.4), (10, 22.6, 1.6), (10, 26.8, 1.8), (10, 31, 2)]))
            expect(fresh(d, a, there) == fresh(d, a, back) == fresh(d, a, made), "points along a line")
            c = Client(d.socket)
            begun = c.ask("push_begin", pb.PushBegin(dataset="counts", scale_xy="0.01", scale_z="0.01"))
            for p in (a, back):
                with open(p, "rb") as f:
                    c.ask("probe", pb.Probe(push=begun.push, name=p), f.fileno())
            c.ask("push_plan", pb.PushPlan(push=begun.push))
            for p in (a, back):
                with open(p, "rb") as f:
                    done = c.ask("file", pb.File(push=begun.push, name=p), f.fileno())
            expect((done.lines.lines, done.lines.vertices, done.lines.dropped, done.lines.added) == (1, 6, 1, 4), done)
            got = c.ask("push_commit", pb.PushCommit(push=begun.push))
            expect((got.line_set.pieces, got.line_set.positions, got.line_set.crossings, got.points) == (5, 6, 0, 4000), got)
            c.close()
            # Lines that cross at two heights, and vertices of two heights.
            crossing = lines(base, "crossing.txt", RIDGE, ROAD)
            says(push(d, "strict", a, crossing, more=["--strict"]), 1, "lines cross at", "with heights", "--strict")
            uneven = lines(base, "uneven.txt", (1, "hard", [(10, 10, 1), (20, 20, 1)]), (2, "hard", [(20, 20, 2), (30, 5, 1)]))
            says(push(d, "strict2", a, uneven, more=["--strict"]), 1, "vertices of lines at 20 20 have heights 1 and 2")
            push(d, "strict2", a, uneven).ok()


def far_away():
    """Lines beyond the lattice are refused with their file and feature, whatever digits they have; the points beside them are taken."""
    with e2e.Folder() as base:
        a = cloud(base)
        with e2e.Daemon(base) as d:
            near = "feature 4 hard\nline\n1 1 1\n2 2 2\n"
            for i, (before, rows) in enumerate((("", "9000000000 5 1\n9000000001 6 1"), ("", "9000000000.5 5 1\n9000000001 6 1"),
                                                ("", "9000000000.123456789 5 1\n9000000001 6 1"), ("", "5 5 9000000000\n6 6 9000000000"),
                                                (near, "5 5 1\n6 -9e9 2"))):
                far = os.path.join(base, "far%d.txt" % i)
                with open(far, "w") as f:
                    f.write("acut-lines 1\n%sfeature 17 hard\nline\n%s\n" % (before, rows))
                for order in ((a, far), (far, a)):
                    name = "f%d%d" % (i, order[0] == a)
                    says(d.ctl("push", name, *order), 3, far + ": with the scale 0.01", "does not fit")
                    expect(show(d, name)["points"] == 4000, "the points were left out")
                says(push(d, "scaled%d" % i, a), 0)
                says(d.ctl("push", "scaled%d" % i, far), 1, far + ": feature 17:", "beyond the middle of the lattice")


def walk(rng, n):
    """A line of short steps."""
    x, y, out = rng.random() * 100, rng.random() * 100, []
    for _ in range(n):
        x, y = x + rng.random() * .2 - .1, y + rng.random() * .2 - .1
        out.append((x, y, rng.random()))
    return out


def little_memory():
    """The line set is made in memory that the stage gives up; lines that cross too often are refused, with what would suffice."""
    with e2e.Folder() as base, e2e.Folder() as other:
        a, rng = cloud(base), random.Random(3)
        many = lines(base, "many.txt", *[(i, "hard", walk(rng, 40)) for i in range(500)])
        wild = lines(base, "wild.txt", *[(i, "hard", [(rng.random() * 100, rng.random() * 100, 1) for _ in range(40)]) for i in range(500)])
        with e2e.Daemon(base, memory="64M") as d, e2e.Daemon(other, memory="256M") as large:
            push(d, "d", a, many).ok()
            push(large, "d", a, many).ok()
            expect(mesh(d, "d") == mesh(large, "d"), "the mesh depends on the memory")
            before = folder(d, "d")
            says(push(d, "d", wild), 1, "line set", "run with memory=")
            e2e.until(lambda: not [n for n in folder(d, "d") if not n.startswith("push-") and n not in before], "leftovers: %s" % folder(d, "d"))


def revert_in_little_memory():
    """A revert asks for the memory of a line set; where that cannot be had it is refused, and changes nothing."""
    with e2e.Folder() as base:
        a, rng = cloud(base), random.Random(5)
        one, two = (lines(base, "many%d.txt" % i, *[(k, "hard", walk(rng, 80)) for k in range(1500)]) for i in range(2))
        with e2e.Daemon(base) as d:
            for p in (a, one, two):
                push(d, "d", p).ok()
            e2e.until(lambda: len([n for n in folder(d, "d") if n.startswith("lineset-")]) == 1, "line sets stay")
            d.stop()
        with e2e.Daemon(base, memory="24M") as d:
            before = folder(d, "d")
            says(d.ctl("dataset", "revert", "d", "2"), 1, "making the line set", "run with memory=")
            settled(d, "d", before)
            expect(show(d, "d")["generation"] == 3, show(d, "d"))
            d.stop()
        with e2e.Daemon(base) as d:
            d.ctl("dataset", "revert", "d", "2").ok()
            expect(mesh(d, "d") == fresh(d, a, two), "with enough memory")


e2e.main(any_order, reverts_and_replacements, never_together, copies, interrupted, what_the_text_asks_for, far_away, little_memory, revert_in_little_memory)
