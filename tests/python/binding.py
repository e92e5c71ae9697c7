"""The Python module and acutctl on one daemon give the same views, meshes, changes and errors. Callbacks that raise, threads,
and resources that must be closed. Run under -X dev -W error, where a warning is an exception."""
import contextlib
import gc
import grp
import gzip
import inspect
import io
import json
import os
import pathlib
import pickle
import pwd
import shutil
import signal
import struct
import threading
import zipfile

import acut
import e2e
from e2e import Daemon, Folder, expect
from module import SMALL, lost, raises, synth


def descriptors():
    gc.collect()
    return len(os.listdir("/proc/self/fd"))


def resident():
    gc.collect()
    return e2e.resident(os.getpid())


def read_ply(path):
    """(vertices, triangles) of a file of acutctl."""
    with open(path, "rb") as f:
        data = f.read()
    head, body = data.split(b"end_header\n", 1)
    sizes = {"double": "d", "float": "f", "int": "i", "uint": "I", "uchar": "B"}
    counts, kinds, at = {}, {}, None
    for line in head.decode().splitlines():
        words = line.split()
        if words[0] == "element":
            at = words[1]
            counts[at], kinds[at] = int(words[2]), []
        elif words[0] == "property" and words[1] != "list":
            kinds[at].append((words[2], sizes[words[1]]))
    v = struct.Struct("<" + "".join(k for _, k in kinds["vertex"]))
    names = [n for n, _ in kinds["vertex"]]
    pick = [names.index(a) for a in "xyz"]
    vertices = [[row[i] for i in pick] for row in v.iter_unpack(body[:v.size * counts["vertex"]])]
    t = struct.Struct("<B3I" + "".join(k for _, k in kinds["face"]))
    rest = body[v.size * counts["vertex"]:]
    return vertices, [list(row[1:4]) for row in t.iter_unpack(rest[:t.size * counts["face"]])]


def same_mesh():
    """Digests, and arrays compared with the PLY; blocks are together the same as the whole mesh."""
    with Folder() as base, Daemon(base, **SMALL) as d, acut.connect(d.socket) as c:
        files = [synth(os.path.join(base, "%d.las" % i), 22000, i, "--origin", "%d,5400000" % (500000 + 60 * i), "--format", "6") for i in (1, 2)]
        pushed = c.push("s", files)
        expect(pushed.points == 44000 and pushed.exit_status == 0 and [f.state for f in pushed.files] == ["staged"] * 2, pushed)
        expect([f.state for f in c.push("s", files).files] == ["known"] * 2, "the same files again")
        r = d.ctl("submit", "s", "--wait", "--json").ok().json()
        job = c.wait(c.submit("s"))
        expect(job.id == r["job"], "another job for the same view")
        mesh = c.mesh(job)
        expect((mesh.digest, mesh.vertex_digest) == (r["digest"], r["vertex_digest"]) ==
               (job.report.digest, job.report.vertex_digest),
               "digests")
        expect(mesh.vertices.shape == (r["vertices"], 3) and mesh.triangles.shape == (r["triangles"], 3), "shapes")
        shown, of = d.ctl("dataset", "show", "s", "--json").ok().json(), c.dataset("s")
        for one in (mesh.head, of):
            expect((one.wkt, one.epsg, one.epsg_z, one.vertical, one.geoid) ==
                   (shown["wkt"], 32633, 0, shown["vertical"], "") and one.wkt.startswith("COMPD_CS["), "the system: %s" % shown)
        expect((mesh.vertices.format, mesh.lattice.format, mesh.triangles.format) == ("d", "i", "Q"), "formats")
        ply = os.path.join(base, "m.ply")
        d.ctl("fetch", str(job.id), "-o", ply).ok()
        vertices, triangles = read_ply(ply)
        # The file has the triangles of the stream, some of them moved to the front.
        expect(sorted(triangles) == sorted(mesh.triangles.tolist()), "the triangles of the PLY are others")
        expect(vertices == mesh.vertices.tolist(), "the vertices of the PLY are others: %r %r"
               % (vertices[:1], mesh.vertices.tolist()[:1]))
        for i in (0, len(vertices) - 1):
            for axis in range(3):
                n, v = mesh.lattice[i, axis], mesh.vertices[i, axis]
                expect(mesh.head.coordinate(axis, n) == v == float(mesh.head.coordinate_text(axis, n)), "lattice and coordinate")
        with c.fetch(job) as blocks:
            expect(blocks.head.box == mesh.head.box and blocks.tail is None, "head first")
            got = list(blocks)
        expect(len(got) == blocks.tail.blocks > 1, "%d blocks" % len(got))
        expect(sum((b.triangles.tolist() for b in got), []) == mesh.triangles.tolist(), "by blocks")
        for b in got:
            f, n = b.foreign.tolist(), b.first
            local = [[f[v] if v < len(f) else n + v - len(f) for v in t] for t in b.local_triangles.tolist()]
            expect(local == b.triangles.tolist(), "local numbers")
        # Resuming in the middle.
        with c.fetch(job) as blocks:
            some = [next(blocks)]
            state = blocks.state()
        with acut.connect(d.socket) as other, other.fetch(resume=state) as rest:
            some += list(rest)
            expect(rest.tail.digest == r["digest"], "the digest of a fetch that went on")
        expect([b.vertices.tolist() for b in some] == [b.vertices.tolist() for b in got], "blocks of a fetch that went on")
        # A state must be of this fetch, and after the blocks that were taken.
        early = c.fetch(job)
        while not early._pieces:
            early._step()
        raises(acut.UsageError, early.state)
        next(early)
        expect(early.state() == state, "the state behind the first block")
        list(early)
        early.state()
        later = c.fetch(job)
        list(later)
        later.state()
        raises(acut.UsageError, early.state)
        # A window gives the mesh that acutctl has for it.
        box = (500070, 5400010, 500090, 5400030)
        w = c.mesh(job, bbox=box)
        out = d.ctl("fetch", str(job.id), "--bbox", ",".join(map(str, box)), "--format", "null", "--json").ok().json()
        expect(0 < len(w.triangles) < len(mesh.triangles) and w.digest == out["digest"], "a window: %s %s" % (w.digest, out["digest"]))
        expect(c.mesh(job).digest == mesh.digest, "the window stayed")


def same_views():
    """Every option gives the same canonical view as in acutctl, and the same combinations are refused."""
    geojson = {"type": "FeatureCollection", "features": [
        {"type": "Feature", "properties": {}, "geometry": None},
        {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [
            [[500001.25, 5400001.5], [500040, 5400002], [500030.5, 5400040.75], [500001.25, 5400001.5]],
            [[500010, 5400008], [500020, 5400008], [500015, 5400012.125], [500010, 5400008]]]}},
        {"type": "Feature", "geometry": {"type": "MultiPolygon", "coordinates": [[[[500000, 5400045], [500005, 5400045], [500003, 5400049]]]]}}]}
    with Folder() as base, Daemon(base, **SMALL) as d, acut.connect(d.socket) as c:
        c.push("s", synth(os.path.join(base, "a.las")))
        gj, wkt = os.path.join(base, "a.geojson"), os.path.join(base, "a,b,c,d.wkt")
        with open(gj, "w") as f:
            json.dump(geojson, f)
        with open(wkt, "w") as f:
            f.write("POLYGON Z ((500001.25 5400001.5 3, 500040 5400002 3, 5.000305E5 5400040.75 1, 500001.25 5400001.5 3));\n"
                    "MultiPolygon(((500000 5400045,500005 5400045,500003 5400049)),((500041 5400045,500045 5400045,500043 5400049)))")
        rows = [
            ({}, []),
            ({"class_": [2, 8]}, ["--class", "2,8"]), ({"class_": 2}, ["--class", "2"]), ({"not_class": "3-5,9"}, ["--not-class", "3-5,9"]),
            ({"ground": True}, ["--ground"]), ({"surface": True}, ["--surface"]), ({"returns": "first"}, ["--returns", "first"]),
            ({"returns": "last", "keep_withheld": True}, ["--returns", "last", "--keep-withheld"]),
            ({"keep_noise": True, "drop_overlap": True}, ["--keep-noise", "--drop-overlap"]),
            ({"duplicates": "highest", "every": 7}, ["--duplicates", "highest", "--every", "7"]),
            ({"zmin": 160, "zmax": 180.25}, ["--zmin", "160", "--zmax", "180.25"]), ({"thin": "3ft"}, ["--thin", "3ft"]),
            ({"thin": 2.5, "thin_pick": "median"}, ["--thin", "2.5", "--thin-pick", "median"]),
            ({"thin": "2m", "surface": True}, ["--thin", "2m", "--surface"]),
            ({"crop": (500001, 5400001.5, 500030, "5400020.25")}, ["--crop", "500001,5400001.5,500030,5400020.25"]),
            ({"crop": "500001,5400001.5,500030,5400020.25"}, ["--crop", "500001,5400001.5,500030,5400020.25"]),
            ({"crop": gj}, ["--crop", gj]), ({"crop": geojson}, ["--crop", gj]), ({"crop": wkt}, ["--crop", wkt]),
            ({"bbox": (500001, 5400001, 500030, 5400020)}, ["--bbox", "500001,5400001,500030,5400020"]),
            ({"polygon": gj, "ground": True}, ["--polygon", gj, "--ground"]), ({"no_breaklines": True}, ["--no-breaklines"]),
            ({"breakline_clear": "0.5m", "duplicates": "highest"}, ["--breakline-clear", "0.5m", "--duplicates", "highest"]),
            ({"weight": {2: 1.5, 9: "0.3m"}}, ["--weight", "9=0.3m,2=1.5"]), ({"weight": "2=1"}, ["--weight", "2=1"]),
            ({"weight": {"a.las": 2, 2: "1m"}}, ["--weight", "2=1m,a.las=2"]), ({"weight": "*.las=3"}, ["--weight", "./a.las=3"]),
            ({"max_error": "0.25ft", "every": 3}, ["--max-error", "0.25ft", "--every", "3"]), ({"max_points": 500}, ["--max-points", "500"]),
            ({"metric": (-6, 2, 5)}, ["--metric=3,-1,5"]), ({"metric": "1,0,1"}, ["--metric", "0,1,1"]),
            # Values that change nothing contradict nothing.
            ({"metric": (1, 0, 1), "max_error": 1}, ["--metric", "1,0,1", "--max-error", "1"]),
            ({"weight": {2: 1}, "polygon": gj}, ["--weight", "2=1", "--polygon", gj]),
            ({"weight": {0: 0}, "bbox": (500001, 5400001, 500030, 5400020)}, ["--weight", "0=0", "--bbox", "500001,5400001,500030,5400020"]),
            ({"breakline_clear": "0.0m", "no_breaklines": True}, ["--breakline-clear", "0.0m", "--no-breaklines"]),
        ]
        known = set(inspect.signature(acut._view.view_text).parameters)
        expect({w for words, _ in rows for w in words} == known - {"hidden"}, "rows for %s" % sorted(known))
        for words, options in rows:
            job = c.submit("s", **words)
            r = d.ctl("submit", "s", "--json", *options).ok().json()
            expect(job.view == r["view"] and job.id == r["job"], "%r: %s, %s" % (words, job.view[:100], r["view"][:100]))
        expect(c.submit("s", view=job.view).id == job.id, "a view by its text")
        expect(c.plan("s", ground=True).points == 20000, "a plan")
        for bound, rounded in (("0.25ft", True), (1, False), ("0.0251", True), (0, False), ("10m", False)):
            notes = d.ctl("submit", "s", "--json", "--max-error=%s" % bound).ok().json()["notes"]
            notes = [n for n in notes if "rounded down" in n]  # not what its report says
            expect(bool(notes) == rounded, "%s: %s" % (bound, notes))
            for got in (c.submit("s", max_error=bound), c.plan("s", max_error=bound)):
                expect(["--max-error" + n[len("max_error"):] for n in got.notes] == notes, "%s: %s, %s" % (bound, got.notes, notes))
        for words, options in [
                ({"ground": True, "surface": True}, ["--ground", "--surface"]), ({"thin_pick": "median"}, ["--thin-pick", "median"]),
                ({"surface": True, "returns": "last"}, ["--surface", "--returns", "last"]), ({"thin": "0"}, ["--thin", "0"]),
                ({"ground": True, "duplicates": "highest"}, ["--ground", "--duplicates", "highest"]), ({"class_": "2,x"}, ["--class", "2,x"]),
                ({"class_": 256}, ["--class", "256"]), ({"zmin": 5, "zmax": 4}, ["--zmin", "5", "--zmax", "4"]),
                ({"returns": "some"}, ["--returns", "some"]), ({"every": 0}, ["--every", "0"]), ({"zmin": "x y"}, ["--zmin", "x y"]),
                ({"bbox": (3, 0, 2, 1)}, ["--bbox", "3,0,2,1"]), ({"breakline_clear": -1}, ["--breakline-clear=-1"]),
                ({"weight": {256: 1}}, ["--weight", "256=1"]), ({"weight": "0=0,0=2"}, ["--weight", "0=0,0=2"]), ({"weight": {}}, ["--weight", ""]),
                ({"weight": {"a.las": ""}}, ["--weight", "a.las="]), ({"weight": {"+7": 1}}, ["--weight", "+7=1"]), ({"weight": "2"}, ["--weight", "2"]),
                ({"weight": {2: -1}}, ["--weight", "2=-1"]),
                ({"no_breaklines": True, "breakline_clear": 1}, ["--no-breaklines", "--breakline-clear", "1"]),
                ({"max_error": -1}, ["--max-error=-1"]), ({"max_error": 1, "max_points": 9}, ["--max-error", "1", "--max-points", "9"]),
                ({"max_points": 0}, ["--max-points", "0"]),
                ({"max_error": 1, "metric": (1, 0, 2)}, ["--max-error", "1", "--metric", "1,0,2"]),
                ({"metric": (0, 0, 2)}, ["--metric", "0,0,2"]), ({"metric": (1, 0, 0)}, ["--metric", "1,0,0"]),
                ({"metric": (1, 0.5, 2)}, ["--metric", "1,0.5,2"]), ({"metric": "1,2"}, ["--metric", "1,2"]),
                ({"metric": (1, 2, 10001)}, ["--metric", "1,2,10001"])]:
            expect(raises(acut.UsageError, c.submit, "s", **words).exit_status == d.ctl("submit", "s", *options).status == 2, words)
        job = c.wait(c.submit("s", weight={2: 3}, hidden=True))
        with c.fetch(job) as blocks:
            origins = [o for b in blocks for o in b.origins]
        expect(job.report.triangles == 0 and job.report.vertices == len(origins) > 0 and {s for _, s in origins} == {1}, "%d hidden" % len(origins))
        raises(acut.UsageError, c.submit, "s", hidden=True)
        expect(raises(acut.NotFoundError, c.submit, "s", weight={"b.las": 1}).exit_status == d.ctl("submit", "s", "--weight", "b.las=1").status, "no file")
        with open(gj, "w") as f:
            f.write('{"type": "LineString", "coordinates": []}')
        e = raises(acut.InputError, c.submit, "s", crop=gj)
        expect(e.file == gj and d.ctl("submit", "s", "--crop", gj).status == e.exit_status, e)
        raises(TypeError, c.submit, "s", no_such_word=1)
        for words in ({"weight": 5}, {"weight": [2, 1]}, {"weight": None, "max_points": "x"}, {"max_points": 1.5}, {"every": "7"}, {"every": float("inf")},
                      {"weight": {2: None}}, {"metric": 5}):
            e = raises(acut.UsageError, c.submit, "s", **words)
            expect(list(words)[-1] in e.message, "%s: %s" % (words, e))


def changes():
    """The old mesh, kept by regions, with the changes applied is the new mesh."""
    def named(blocks):
        numbers, regions = [], {}
        for b in blocks:
            numbers += map(tuple, b.vertices.tolist())
            if b.region and len(b.triangles):
                regions.setdefault(b.region, set()).update(tuple(numbers[v] for v in t) for t in b.triangles.tolist())
        return regions

    with Folder() as base, Daemon(base, **SMALL) as d, acut.connect(d.socket) as c:
        c.push("s", synth(os.path.join(base, "a.las"), 64000))
        old_job = c.wait(c.submit("s"))
        c.push("s", synth(os.path.join(base, "b.las"), 300, 2, "--area", "5x5"))
        job = c.wait(c.submit("s"))
        with c.fetch(old_job) as blocks:
            held = named(blocks)
        with c.fetch(job) as blocks:
            want = named(blocks)
        with c.fetch(job, since=1) as blocks:
            new = named(blocks)
            b, tail, gone = blocks.base, blocks.tail, blocks.gone
        expect(b.generation == 1 and b.job == old_job.id and b.digest == job.report.digest and tail is not None, b)
        expect(0 < b.gone == len(gone) and b.kept > 0, "%d gone, %d kept" % (b.gone, b.kept))
        for region in gone:
            expect(len(held.pop(region.box)) == region.triangles, "a region that is gone")
        held.update(new)
        expect(held == want, "the changes do not lead to the new mesh")
        raises(acut.NotFoundError, lambda: list(c.fetch(job, since=77)))


class Shape:
    def __init__(self, geometry):
        self.__geo_interface__ = geometry


def volumes():
    """The same numbers and errors as acutctl; polygons of all kinds."""
    with Folder() as base, Daemon(base, **SMALL) as d, acut.connect(d.socket) as c:
        for i in (1, 2):
            c.push("d%d" % i, synth(os.path.join(base, "%d.las" % i), 4000, i), override_units="m,m")
        jobs = [c.submit("d%d" % i) for i in (1, 2)]
        found = c.volume(*jobs)
        said = d.ctl("volume", *(str(j.id) for j in jobs), "--json").ok().json()
        one = said["volumes"][0]
        expect(len(found) == 1 and all(getattr(found[0], k) == (v or "" if k == "name" else v) for k, v in one.items()), "%s %s" % (found, one))
        expect((found.unit_volume, found.unit_area, found.unit_level, found.level) == ("m3", "m2", "", None), found)
        expect([m.job for m in found.meshes] == [j.id for j in jobs] and found.meshes[0].digest == said["meshes"][0]["digest"], found)
        expect(c.volume(jobs[0], level="210.125", unit="ft").unit_level == "m", "the unit of a level")
        ring = [[500010 + x, 5400010 + y] for x, y in ((0, 0), (20, 0), (20, 20), (0, 20), (0, 0))]
        polygon = {"type": "Polygon", "coordinates": [ring]}
        feature = {"type": "Feature", "properties": {"name": "a", "id": 7}, "geometry": polygon}
        path = os.path.join(base, "p.geojson")
        with open(path, "w") as f:
            json.dump({"type": "FeatureCollection", "features": [feature, feature]}, f)
        want = c.volume(*jobs, within=path)
        expect([v.name for v in want] == ["a", "a"] and 100 < want[0].area < 400.001, want)
        for within, names in ((polygon, [""]), (feature, ["a"]), ([polygon, feature], ["", "a"]), (Shape(polygon), [""]), ([Shape(polygon)], [""]),
                              ({"type": "FeatureCollection", "features": [Shape(feature)]}, ["a"]), (pathlib.Path(path), ["a", "a"]),
                              ((Shape(p) for p in (feature, polygon)), ["a", ""])):
            got = c.volume(*jobs, within=within)
            expect([v.name for v in got] == names and all(v.fill == want[0].fill and v.cut == want[0].cut for v in got), "%s: %s" % (within, got))
        expect(c.volume(*jobs, within=[feature], name_field="id")[0].name == "7", "a field that is a number")
        image = os.path.join(base, "d.tif")
        expect(c.volume(*jobs, output=image, cell="5m").outputs == [image] and os.path.getsize(image) > 100, "no image")
        e = raises(acut.UsageError, c.volume, *jobs, within=[feature], name_field="nom")
        expect(e.file == "within" and "nom" in e.message and "name, id" in e.hint, repr(e))
        expect("no job 99" in raises(acut.NotFoundError, c.volume, jobs[0], 99).message, "job 99")
        expect("--level" in raises(acut.UsageError, c.volume, jobs[0]).hint, "one job")
        raises(acut.UsageError, c.volume, *jobs, within=7)
        raises(acut.UsageError, c.volume, *jobs, within=[7])
        raises(acut.ReadWriteError, c.volume, *jobs, within=os.path.join(base, "none.geojson"))
        program, os.environ["ACUTCTL"] = os.environ["ACUTCTL"], os.path.join(base, "none")
        expect("ACUTCTL" in raises(acut.InternalError, c.volume, *jobs).hint, "no program")
        os.environ["ACUTCTL"] = other = os.path.join(base, "other")
        for text in ('{"volumes": [{}], "meshes": []}', '{"volumes": []}', '{"volumes": [1], "meshes": []}'):
            with open(other, "w") as f:
                f.write("#!/bin/sh\necho '%s'\n" % text)
            os.chmod(other, 0o755)
            expect("another release" in raises(acut.InternalError, c.volume, *jobs).hint, text)
        os.environ["ACUTCTL"] = program
        c.close()
        raises(acut.UsageError, c.volume, *jobs)


def rights():
    """Owner, group and mode of datasets; metrics and checks compared with those of acutctl."""
    with Folder() as base, Daemon(base, **SMALL) as d, acut.connect(d.socket) as c:
        a = synth(os.path.join(base, "a.las"), 3000)

        def shown(name):
            return d.ctl("dataset", "show", name, "--json").ok().json()["mode"]

        before = os.umask(0o027)
        try:
            c.push("plain", a)
            expect(c.dataset("plain").mode == 0o640, "the umask, in the mode of a new dataset")
            c.push("mine", a, mode=0o600)
            c.create_dataset("ours", mode="g+w,o=")
            c.create_dataset("after")
        finally:
            os.umask(before)
        c.push("named", a, override_crs="EPSG:25832", override_units=("m", "ft"))
        named = c.dataset("named")
        expect((named.crs, named.unit_xy, named.unit_z) == ("EPSG:25832", "metre", "foot"), "what overrides: %s" % (named,))
        change = c.dataset_log("named", files=True)[0].changes[0]
        expect(change.overridden.startswith("EPSG:"), "what the file says: %s" % (change,))
        c.remove_dataset("named")
        modes = {s.name: s.mode for s in c.datasets()}
        expect(modes == {"plain": 0o640, "mine": 0o600, "ours": 0o660, "after": 0o640}, modes)
        expect(c.chmod_dataset("mine", 0o644).mode == 0o644 and shown("mine") == "0644", "chmod by a number: " + shown("mine"))
        expect(c.chmod_dataset("mine", "g+w,o=").mode == 0o660 and shown("mine") == "0660", "chmod by a text: " + shown("mine"))
        found = c.dataset("mine")
        expect((found.uid, found.gid) == (os.getuid(), os.getgid()), found)
        group, user = grp.getgrgid(os.getgid()).gr_name, pwd.getpwuid(os.getuid()).pw_name
        expect(c.chgrp_dataset("mine", group).gid == os.getgid() == c.chgrp_dataset("mine", os.getgid()).gid, "chgrp")
        expect(c.chown_dataset("mine", user).uid == os.getuid() == c.chown_dataset("mine", str(os.getuid())).uid, "chown")
        for bad in ("9z", "", 0o10000, -1, 0o4755):
            raises(acut.UsageError, c.chmod_dataset, "mine", bad)
        raises(acut.UsageError, c.push, "new", a, mode="nothing")
        for bad in ("no such name", -1, 2 ** 32 - 1):
            raises(acut.UsageError, c.chown_dataset, "mine", bad)
            raises(acut.UsageError, c.chgrp_dataset, "mine", bad)
        raises(acut.NotFoundError, c.chmod_dataset, "nothing", 0o640)
        expect(shown("mine") == "0660", "what was refused changed something")

        text = d.ctl("metrics").ok().out
        samples = [m for m in c.metrics() if m.labels.get("dataset") == "plain"]
        expect(samples and {m.type for m in samples} <= {"counter", "gauge"}, samples)
        names = {m.name for m in c.metrics()}
        expect(all("# TYPE %s " % n in text for n in names) and len(names) > 20, names)
        checks = {s["name"]: s["state"] for s in d.ctl("doctor", "--json").ok().json()["checks"]}
        told = {s.name: s.state for s in c.doctor()}
        expect(told and {n: checks.get(n) for n in told} == told, "%r %r" % (told, checks))


def inputs():
    """Paths, files, descriptors, pipes, bytes; broken inputs together with good ones."""
    with Folder() as base, Daemon(base, **SMALL) as d, acut.connect(d.socket) as c:
        paths = [synth(os.path.join(base, "%d.las" % i), 5000, i) for i in range(5)]
        with open(paths[1], "rb") as opened, open(paths[2], "rb") as whole:
            fd, (reading, writing) = os.open(paths[3], os.O_RDONLY), os.pipe()
            data = whole.read()
            feed = threading.Thread(target=write_and_close, args=(writing, open_and_read(paths[4])))
            feed.start()
            got = c.push("s", [paths[0], opened, io.BytesIO(data), fd, reading])
            feed.join()
            os.close(fd)
            os.close(reading)
            expect(not opened.closed, "a file of the caller was closed")
        expect(got.points == 25000 and [f.points for f in got.files] == [5000] * 5, got)
        expect([f.state for f in c.push("s", paths[:2]).files] == ["known"] * 2, "who an open file is")
        one = d.ctl("push", "t", *paths).ok() and d.ctl("submit", "t", "--wait", "--json").json()
        expect(c.wait(c.submit("s")).report.digest == one["digest"], "another mesh than from paths")
        log = c.dataset_log("s", files=True)
        expect([f.name for f in log[0].changes][:2] == ["0.las", "1.las"] and log[0].points_added == 25000, log)
        broken = os.path.join(base, "broken.las")
        with open(broken, "wb") as f:
            f.write(data[:90] + b"\xff" * 40 + data[130:])
        half = os.path.join(base, "half.las")
        with open(half, "wb") as f:
            f.write(data[:len(data) // 2])
        more = synth(os.path.join(base, "more.las"), 5000, 9)
        got = c.push("s", [broken, more, half, os.path.join(base, "none.las"), base])
        expect(got.exit_status == 3 and [f.state for f in got.files] == ["refused", "staged", "refused", "refused", "refused"], got)
        status = d.ctl("push", "u", "--json", broken, more, half)
        theirs = [json.loads(line)["error"] for line in status.out.splitlines()]
        for e, t in ((got.files[0].error, theirs[0]), (got.files[2].error, theirs[2])):
            expect((e.code, e.file, e.offset, e.field, e.message, e.hint) ==
                   (t["code"], t["file"], t["offset"], t["field"], t["message"], t["hint"]), "%r and %r" % (vars(e), t))
        expect(isinstance(got.files[2].error, acut.TruncatedError), got.files[2])
        e = raises(acut.InputError, c.push, "s", [broken, half])
        expect(e.exit_status == d.ctl("push", "s", broken, half).status == 1, e)
        again = pickle.loads(pickle.dumps(e))
        expect((type(again), str(again), again.file) == (type(e), str(e), e.file), "pickled")
        before = c.dataset("s")
        raises(acut.TruncatedError, c.push, "s", [synth(os.path.join(base, "last.las"), 5000, 11), half], strict=True)
        expect(c.dataset("s").points == before.points and not c.dataset("s").pending, "a strict push left something")
        packed = os.path.join(base, "more.las.gz")
        with gzip.open(packed, "wb") as f:
            f.write(data)
        with zipfile.ZipFile(os.path.join(base, "more.zip"), "w") as z:
            z.writestr("more.las", data)
        for path, says, todo in ((packed, "this is a gzip file", "gunzip -k more.las.gz"), (os.path.join(base, "more.zip"), "this is a zip archive", "unzip more.zip")):
            e = raises(acut.InputError, c.push, "s", path)
            expect(says in e.message and todo in e.hint and e.file == path, vars(e))
            e = raises(acut.InputError, c.push, "s", io.BytesIO(open_and_read(path)))
            expect(says in e.message, vars(e))
        raises(acut.UsageError, c.push, "s", more, add=True, replace=True)
        raises(acut.UsageError, c.push, "s", [])
        raises(acut.UsageError, c.push, "s", [3.5])
        synth(more, 6000, 10)
        expect(c.push("s", more, replace=True).files[0].replaced == 1 and c.dataset("s").points == before.points + 1000, "replace")
        expect(c.revert("s").undone == before.generation + 1 and c.dataset("s").points == before.points, "revert")
        expect(c.discard("s") == acut.Discarded(0, 0, 0, []) == c.discard("s", all=True), "discard without pending pushes")
        raises(acut.NotFoundError, c.discard, "none")
        expect(c.info(more).points == 6000 and c.inspect(more).points == 6000, "info")
        ridge = os.path.join(base, "ridge.txt")
        with open(ridge, "w") as f:
            f.write("acut-lines 1\nfeature 1 hard\nline\n1 1 1\n2 2 2\n3 2 1\n")
        d.ctl("push", "lines", ridge).ok()
        of = c.dataset_log("lines", files=True)[0].changes[0]
        expect(of.of_lines and of.features == (1, 0, 0, 0) and (of.lines, of.vertices, of.points) == (1, 3, 0), of)
        expect((lambda x: (x.line_files, x.features, x.lines, x.vertices))(c.dataset("lines")) == (1, (1, 0, 0, 0), 1, 3), c.dataset("lines"))
        expect(not c.dataset_log("s", files=True)[0].changes[0].of_lines and c.dataset("s").line_files == 0, "points")
        of_lines = os.path.join(base, "of_lines")
        d.ctl("dataset", "export", "lines", of_lines).ok()
        for name in "lines-1.new", "lines-", "sources-0-0123456789abcdef.new", ".a.seg":  # no files of the dataset
            shutil.copy(os.path.join(of_lines, "manifest"), os.path.join(of_lines, name))
        c.import_dataset(of_lines, "lines-again")
        expect((lambda x: (x.line_files, x.lines, x.vertices))(c.dataset("lines-again")) == (1, 1, 3), c.dataset("lines-again"))
        d.ctl("dataset", "rm", "lines").ok()
        d.ctl("dataset", "rm", "lines-again").ok()
        out = os.path.join(base, "out")
        d.ctl("dataset", "export", "s", out).ok()
        expect(c.import_dataset(out, "again").points == before.points, "import")
        names = []
        c.backup(lambda f: names.append((f.name, len(os.pread(f.fileno(), 1 << 24, 0)) == f.size)), dataset="s")
        expect(names[-1] == ("manifest", True) and all(ok for _, ok in names), names)
        c.pin_dataset("again")
        raises(acut.Error, c.remove_dataset, "again")
        c.unpin_dataset("again")
        expect(c.remove_dataset("again").until is not None and "again" in [x.name for x in c.datasets(removed=True)], "removed")
        expect(c.restore_dataset("again", as_="back").name == "back" and len(c.datasets()) == 4, c.datasets())
        expect(c.cache_verify().damaged == 0 and c.cache_gc(all=True) >= 0 and c.status().connections >= 1, "the disk")
        raises(acut.InputError, c.add_geoid, more)


def write_and_close(fd, data):
    with os.fdopen(fd, "wb") as f:
        f.write(data)


def open_and_read(path):
    with open(path, "rb") as f:
        return f.read()


def failures():
    with Folder() as base:
        missing = os.path.join(base, "no.sock")
        e = raises(acut.NoDaemonError, acut.connect, missing)
        expect(e.exit_status == e2e.run([e2e.ACUTCTL, "--socket", missing, "ping"]).status == 69 and isinstance(e, ConnectionError), e)
        gate = e2e.Gate(base)
        with Daemon(base, **SMALL, env=gate.env) as d:
            c = acut.connect(d.socket, program="a test")
            e = raises(acut.NotFoundError, c.dataset, "nothing")
            expect(e.exit_status == d.ctl("dataset", "show", "nothing").status == 4 and isinstance(e, LookupError), e)
            raises(acut.NotFoundError, c.job, 99)
            raises(acut.NotFoundError, c.mesh, 99)
            raises(acut.UsageError, c.dataset, "a\0b")
            expect(c.ping() < e2e.PATIENCE, "the connection goes on")
            settings = {s.name: s for s in c.config()}
            expect(settings["memory"].value.startswith("24") and settings["memory"].origin == "command_line", settings["memory"])
            # A job that is cancelled: wait raises its error, job() shows it.
            c.push("s", synth(os.path.join(base, "a.las"), 200000))
            gate.close("pread", ".seg")
            job = c.submit("s")
            gate.wait()
            c.cancel(job)
            gate.open()
            e = raises(acut.CancelledError, c.wait, job)
            expect(c.wait(job, check=False).error.code == e.code == "cancelled" and c.job(job).state == "cancelled", e)
            c.remove_job(job)
            raises(acut.NotFoundError, c.job, job)
            held = c.fetch(c.wait(c.submit("s")))
            raises(acut.UsageError, c.ping)
            held.close()
            c.ping()
            d.stop(signal.SIGKILL)
            raises(acut.NoDaemonError, c.ping)
            raises(acut.NoDaemonError, c.jobs)
            c.close()
            c.close()
            raises(acut.UsageError, c.ping)
            expect("closed" in repr(c), repr(c))


def the_page():
    """The examples of acut-python(7), run in order and unchanged."""
    with open(os.path.join(os.environ["ACUT_SOURCE"], "man/acut-python.7.scd")) as f:
        examples = f.read().split("```\n")[1::2]
    expect(len(examples) >= 5, "%d examples" % len(examples))
    with Folder() as base, Daemon(base, **SMALL) as d:
        a, b = (synth(os.path.join(base, n), 6000, i) for i, n in enumerate(("a.las", "b.las"), 1))
        with open(os.path.join(base, "broken.las"), "wb") as f:
            f.write(open_and_read(a)[:3000])
        here, out = os.getcwd(), io.StringIO()
        os.chdir(base)
        os.environ["ACUT_SOCKET"] = d.socket
        try:
            with contextlib.redirect_stdout(out):
                names = {}
                for example in examples:
                    exec(compile(example, "acut-python(7)", "exec"), names)
        finally:
            os.chdir(here)
            del os.environ["ACUT_SOCKET"]
        text = out.getvalue()
        for want in (" triangles, digest ", "generation ", "a.las known", "broken.las refused", "broken.las: byte", "lowest: ", "not-found", " edges of lines", "parcel fill ", " m3 within ", "above 210: "):
            expect(want in text, "%r is not in what the examples print:\n%s" % (want, text))


class Mine(Exception):
    pass


def callbacks():
    """An exception of a callback comes out of the call as the same object, and the connection can be used afterwards."""
    with Folder() as base:
        gate = e2e.Gate(base)
        with Daemon(base, **SMALL, env=gate.env) as d, acut.connect(d.socket) as c:
            callbacks_of(base, gate, d, c)


def callbacks_of(base, gate, d, c):
    big = synth(os.path.join(base, "a.las"), 400000)
    mine = Mine("enough")

    def fail(*args):
        gate.open()
        raise mine

    # The progress of a small push is only reported if it takes long.
    gate.close("pwrite", ".seg")
    calls = [lambda: c.push("s", big, progress=fail), lambda: c.backup(fail), lambda: c.cache_verify(progress=fail)]
    expect(raises(Mine, calls[0]) is mine, "push")
    expect("s" not in [x.name for x in c.datasets()] or c.dataset("s").points == 0, "it was pushed")
    c.push("s", big)
    for call in calls[1:]:
        expect(raises(Mine, call) is mine, "not what was raised")
        expect(c.ping() < e2e.PATIENCE, "the connection is gone")
    expect(raises(StopIteration, c.backup, lambda f: next(iter(()))) is not None, "what a generator cannot raise")
    # The callback is not called if the job ends at once.
    gate.close("pread", ".seg")
    job = c.submit("s")
    expect(raises(Mine, c.wait, job, changed=fail) is mine, "wait")
    expect(raises(acut.UsageError, c.wait, job, changed=lambda j: c.ping()), "a callback on its own connection")
    expect(raises(acut.UsageError, c.wait, c.submit("s", new=True), changed=lambda j: c.close()), "closed by a callback of its own")
    gate.open()
    seen = []
    c.wait(job, changed=lambda j: seen.append(j.state))
    expect(seen[-1:] in ([], ["done"]), seen)
    progress = []
    fresh = c.submit("s", new=True)
    expect(c.mesh(fresh, progress=progress.append).digest == c.job(job).report.digest, "a mesh that is made meanwhile")
    expect(all(isinstance(p, acut.Progress) for p in progress), progress)
    expect(not lost, lost)


def threads():
    with Folder() as base, Daemon(base, **SMALL) as d, acut.connect(d.socket) as c:
        c.push("s", synth(os.path.join(base, "a.las"), 60000))
        job = c.wait(c.submit("s"))
        got = []

        def work():
            with acut.connect(d.socket) as mine:
                got.extend(mine.mesh(job).digest for _ in range(3))

        many = [threading.Thread(target=work) for _ in range(4)]
        for t in many:
            t.start()
        for t in many:
            t.join()
        expect(got == [job.report.digest] * 12, got)
        os.kill(d.process.pid, signal.SIGSTOP)
        answers, refused = [], []

        def ask():
            try:
                answers.append(c.ping())
            except acut.UsageError as e:
                refused.append(e)

        # The second of the two threads is refused while the first one waits.
        two = [threading.Thread(target=ask) for _ in range(2)]
        for t in two:
            t.start()
        try:
            e2e.until(lambda: refused, "two threads use one connection")
        finally:
            os.kill(d.process.pid, signal.SIGCONT)
            for t in two:
                t.join()
        expect(len(answers) == 1 and len(refused) == 1 and not lost, lost)


def nothing_is_left():
    """1,000 connections, closed, dropped or refused, and unfinished fetches and pushes leave no descriptor and no connection."""
    with Folder() as base, Daemon(base, **SMALL) as d:
        with acut.connect(d.socket) as c:
            c.push("s", [synth(os.path.join(base, "a.las"), 84000)])
            job = c.wait(c.submit("s"))
        before = descriptors()
        for i in range(1000):
            if i == 200:
                memory, objects = resident(), len(gc.get_objects())
            c = acut.connect(d.socket)
            if i % 10 == 0:
                c.ping()
            if i % 2:
                c.close()
        del c
        gc.collect()
        expect(len(gc.get_objects()) < objects + 200, "%d objects more" % (len(gc.get_objects()) - objects))
        expect(resident() < memory + (3 << 20), "%d bytes more after 800 connections" % (resident() - memory))
        expect(descriptors() == before, "%d descriptors more after 1,000 connections" % (descriptors() - before))
        gc.disable()  # a dropped connection is closed at once, not by the garbage collector
        try:
            for _ in range(50):
                acut.connect(d.socket).ping()
            expect(len(os.listdir("/proc/self/fd")) == before, "a dropped connection waits for the collector")
        finally:
            gc.enable()
        for _ in range(50):
            raises(acut.NoDaemonError, acut.connect, d.socket + "x")
        with acut.connect(d.socket) as c:
            for i in range(30):
                f = c.fetch(job)
                next(f)
                if i % 3 == 0:
                    f.close()
                del f
                for b in c.fetch(job):
                    break
            for i in range(20):
                raises(Mine, leave, c, job)
            expect(c.ping() < e2e.PATIENCE, "the connection is gone")
            raises(acut.InputError, c.push, "t", io.BytesIO(b"\0" * 300000))
        e2e.until(lambda: descriptors() == before, lambda: "%d descriptors more" % (descriptors() - before))
        e2e.until(lambda: not [t for t in threading.enumerate() if t.name.startswith("acut")], "a copying thread is left")
        with acut.connect(d.socket) as c:
            e2e.until(lambda: c.status().connections == 1, lambda: "the daemon has %d connections" % c.status().connections)
        expect(not lost, lost)


def leave(c, job):
    with c.fetch(job) as blocks:
        for b in blocks:
            raise Mine


e2e.main(same_mesh, same_views, changes, volumes, rights, inputs, failures, the_page, callbacks, threads, nothing_is_left)
