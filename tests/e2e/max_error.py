"""Views with max-error and max-points: no point is further from the mesh than the bound (acut-verify, which shares no code with the
engine), the same mesh whatever memory, threads, order of pushes and interruptions, lines whole, and a report that agrees with the
mesh. What was made in part is continued, and what is complete is used again."""
import json
import os
import random
import re
import shutil
import signal
import struct

import e2e
from e2e import expect

ALL = ["--keep-withheld", "--keep-noise"]


def synth(base, name, points, *options):
    path = os.path.join(base, name)
    e2e.run([e2e.SYNTH, "--points", points, *options, path]).ok()
    return path


def read_ply(path):
    """Vertices, triangles, and the edges that are marked as pieces of lines, by their ends."""
    with open(path, "rb") as f:
        data = f.read()
    head, _, body = data.partition(b"end_header\n")
    vertices, faces = (int(re.search(rb"element %s (\d+)" % what, head).group(1)) for what in (b"vertex", b"face"))
    edges = b"ushort edges" in head
    points = list(struct.iter_unpack("<3d", body[:24 * vertices]))
    marked, triangles = set(), []
    for i in range(faces):
        row = struct.unpack_from("<B3iH" if edges else "<B3i", body, 24 * vertices + i * (15 if edges else 13))
        triangles.append(row[1:4])
        for k in range(3):
            if edges and row[4] >> k & 1:
                marked.add(frozenset(points[row[1 + (k + j) % 3]][:2] for j in (1, 2)))
    return points, triangles, marked


def verify(mesh, bound, *more):
    got = e2e.run([e2e.VERIFY, "--json", "--max-error", str(bound), mesh, *more])
    expect(got.status == 0, "%s: %s%s" % (mesh, got.out, got.err))
    return got.json()


def agrees(job, checked, asked=None):
    """The report of a job with what the mesh has."""
    bound = job["bound"]
    expect(bound["kept"] == job["vertices"] == job["used"] == checked["vertices"], "%s %s" % (job, checked))
    expect(abs(bound["percent"] - 100 * bound["kept"] / bound["positions"]) < 1e-9, str(bound))
    expect(job["used"] + sum(job["removed"].values()) == job["points"], str(job))
    expect(job["removed"]["error"] == bound["positions"] - bound["kept"], str(job))
    expect(checked["positions"] is None or checked["positions"] == bound["positions"], "%s %s" % (bound, checked))
    expect(asked is None or bound["max_error"] == asked, "%s, not %s" % (bound, asked))
    expect(checked["largest_error"] <= bound["max_error"], "%s %s" % (bound, checked))
    # Rounded up to a thousandth of the lattice, whose step is a centimetre or less.
    expect(-1e-9 <= bound["largest_error"] - checked["largest_error"] < 1e-5 + 1e-9, "%s %s" % (bound, checked))


def within_the_bound():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        out = os.path.join(base, "m.ply")
        surveys = [synth(base, "survey.las", 60000, "--density", 2), synth(base, "corridor.las", 30000, "--distribution", "corridor-diagonal"),
                   synth(base, "grid.las", 20000, "--distribution", "grid", "--step", 3),
                   synth(base, "clustered.las", 30000, "--distribution", "clustered", "--range", 50000),
                   synth(base, "duplicates.las", 30000, "--distribution", "duplicates", "--range", 300)]
        for path in surveys:
            for options, bound in (([], 0.1), (["--ground"] if "survey" in path else ["--duplicates", "highest"], 0.4),
                                   (["--thin", "1.5"], 0.05), (["--every", "3"], 0), (["--zmin", "230", "--surface"], 2)):
                job = d.ctl("mesh", path, "-o", out, "--json", "--max-error", str(bound), *options).ok().json()
                view = ["--view", text_of(d, path, bound, options)]
                if not job["triangles"]:
                    continue
                checked = verify(out, bound, *view, path)
                agrees(job, checked, bound)
                print("%-18s %-36s %5.1f %%  %d rounds" % (os.path.basename(path), " ".join(options + [str(bound)]), job["bound"]["percent"],
                                                          job["bound"]["rounds"]), flush=True)


def text_of(d, path, bound, options):
    """The canonical text of the view, by a job on a dataset of the same file."""
    name = re.sub(r"\W", "", os.path.basename(path))
    if name not in d.__dict__.setdefault("pushed", set()):
        d.ctl("push", name, path).ok()
        d.pushed.add(name)
    return d.ctl("submit", name, "--json", "--new", "--max-error", str(bound), *options).ok().json()["view"]


def settled(d, name, *options):
    return d.ctl("submit", name, "--new", "--wait", "--json", *options).ok().json()


def mesh_of(job):
    return json.dumps([job[k] for k in ("digest", "vertex_digest", "triangles", "bound", "removed")])


def split(base, path, parts):
    """The file's records in other files, in another order."""
    with open(path, "rb") as f:
        data = f.read()
    offset, = struct.unpack_from("<I", data, 96)
    length, = struct.unpack_from("<H", data, 105)
    records = [data[i:i + length] for i in range(offset, len(data), length)]
    random.Random(5).shuffle(records)
    for i in range(parts):
        head, mine = bytearray(data[:offset]), records[len(records) * i // parts:len(records) * (i + 1) // parts]
        struct.pack_into("<I", head, 107, len(mine))
        with open(os.path.join(base, "part%d.las" % i), "wb") as f:
            f.write(bytes(head) + b"".join(mine))
        yield f.name


def one_digest():
    views = (["--max-error", "0.1"], ["--ground", "--thin", "0.9", "--max-error", "0.03"], ["--max-points", "9000"])
    with e2e.Folder() as base:
        path = synth(base, "survey.las", 120000, "--density", 2)
        parts = list(split(base, path, 3))
        seen = {}
        for memory, threads in (("24M", 1), ("24M", 4), ("256M", 2), ("1G", 3)):
            with e2e.Daemon(base, memory=memory, threads=threads, name="-%s-%d" % (memory, threads)) as d:
                pushes = ([[path]], [[parts[2], parts[0]], [parts[1]]])[threads % 2]
                for p in pushes:
                    d.ctl("push", "t", *p).ok()
                for view in views:
                    job = settled(d, "t", *view)
                    seen.setdefault(" ".join(view), set()).add(mesh_of(job))
                    expect(len(seen[" ".join(view)]) == 1, "%s with %s, %d threads: %s" % (view, memory, threads, seen[" ".join(view)]))
                limit = {"24M": 24 << 20, "256M": 256 << 20, "1G": 1 << 30}[memory] + (32 << 20)
                expect(d.vmhwm() <= limit or e2e.sanitized(), "VmHWM %d with memory=%s" % (d.vmhwm(), memory))


def selections(d, prefix=""):
    folder = os.path.join(d.cache, "selected")
    return sorted(n for n in os.listdir(folder) if n.startswith(prefix)) if os.path.isdir(folder) else []


def parts_of(d):
    """Files of a simplification that is not complete -> inode."""
    found = {}
    for name in selections(d, "part-"):
        folder = os.path.join(d.cache, "selected", name)
        try:
            found.update({n: os.stat(os.path.join(folder, n)).st_ino for n in os.listdir(folder)})
        except FileNotFoundError:
            pass
    return found


def continued():
    """Killed and stopped again and again, with other memory and threads each time: it goes on where it was."""
    with e2e.Folder() as base:
        path = synth(base, "survey.las", 250000, "--density", 1)
        view = ["--max-error", "0.05"]
        with e2e.Daemon(base, name="-a") as d:
            d.ctl("push", "t", path).ok()
            want = mesh_of(settled(d, "t", *view))
        rng, kept, ends = random.Random(11), 0, 0
        gate = e2e.Gate(base)
        for memory, threads, signals in (("24M", 1, [signal.SIGKILL]), ("256M", 2, [signal.SIGKILL, signal.SIGTERM])):
            d = e2e.Daemon(base, memory=memory, threads=threads, name="-" + memory, env=gate.env)
            d.start()
            try:
                d.ctl("push", "t", path).ok()
                # So many files get their names, and no more.
                gate.close("renameat", "/selected/part-", 1 + rng.randrange(12))
                job = d.ctl("submit", "t", *view).ok().out.split()[0]
                while gate.wait(lambda: selections(d) != selections(d, "part-")):
                    d.process.send_signal(rng.choice(signals))
                    gate.open()
                    d.process.wait(e2e.PATIENCE)
                    before = parts_of(d)
                    ends += 1
                    expect(ends < 200, "it does not go on where it was")
                    gate.close("renameat", "/selected/part-", 1 + rng.randrange(12))
                    d.start()
                    after = parts_of(d)
                    kept += len([n for n in before if after.get(n) == before[n]])
                gate.open()
                d.ctl("wait", job).ok()
                expect(mesh_of(d.ctl("show", job, "--json").ok().json()) == want, "after %d ends" % ends)
                expect(not selections(d, "part-"), str(selections(d)))
            finally:
                d.stop()
        print("%d ends, %d files were still there" % (ends, kept))
        expect(ends > 5 and kept > ends, "%d ends, %d files kept: the test saw nothing" % (ends, kept))


def caught(d, gate, *view):
    """A job that is held in the middle of its simplification."""
    gate.close("renameat", "/selected/part-", 4)
    job = d.ctl("submit", "t", "--new", *view).ok().out.split()[0]
    gate.wait()
    expect(len(parts_of(d)) > 3, str(parts_of(d)))
    return job


def cancelled_and_damaged():
    with e2e.Folder() as base:
        gate = e2e.Gate(base)
        with e2e.Daemon(base, memory="24M", threads=1, env=gate.env) as d:
            cancelled_and_damaged_in(base, d, gate)


def cancelled_and_damaged_in(base, d, gate):
    d.ctl("push", "t", synth(base, "survey.las", 150000, "--density", 1)).ok()
    view = ["--max-error", "0.05"]
    want = mesh_of(settled(d, "t", *view))
    d.ctl("cache", "gc", "--all").ok()
    job = caught(d, gate, *view)
    shown = d.ctl("show", job, "--json").json()
    expect(shown["progress"]["phase"] in ("simplify", "check") and shown["state"] == "planning", str(shown))
    d.ctl("cancel", job).ok()
    gate.open()
    expect(d.ctl("wait", job).status == 1, "a cancelled job")
    part = selections(d)
    expect(len(part) == 1 and part[0].startswith("part-"), "what was done is kept: %s" % part)
    expect(d.ctl("cache", "verify", "--json").ok().json()["derived_damaged"] == 0, "a part is no damage")
    # Damage in what is kept: it begins again.
    folder = os.path.join(d.cache, "selected", part[0])
    for name in os.listdir(folder):
        with open(os.path.join(folder, name), "r+b") as f:
            f.write(b"\xee" * 40)
    expect(mesh_of(settled(d, "t", *view)) == want, "after damage of a part")
    kinds = d.ctl("cache", "stat", "--json").ok().json()["kinds"]["selections"]
    expect(kinds["entries"] == len(selections(d)) == 1, "%s, %s" % (kinds, selections(d)))
    # Two jobs for one selection; one of another bound beside them.
    shutil.rmtree(os.path.join(d.cache, "selected"))
    jobs = [d.ctl("submit", "t", "--new", *v).ok().out.split()[0] for v in (view, view, ["--max-error", "0.5"])]
    d.ctl("wait", *jobs).ok()
    expect(len(selections(d)) == 2, str(selections(d)))
    expect([mesh_of(d.ctl("show", j, "--json").ok().json()) == want for j in jobs] == [True, True, False], "two of one")
    # What nobody continues is evicted as other derived files are.
    shutil.rmtree(os.path.join(d.cache, "selected"))
    job = caught(d, gate, *view)
    d.ctl("cancel", job).ok()
    gate.open()
    d.ctl("wait", job)
    d.ctl("cache", "gc", "--all").ok()
    expect(not selections(d), str(selections(d)))
    # The whole cache may go while it works.
    job = caught(d, gate, *view)
    shutil.rmtree(os.path.join(d.cache, "selected"))
    gate.open()
    d.ctl("wait", job).ok()
    expect(mesh_of(d.ctl("show", job, "--json").ok().json()) == want, "after the cache was removed")


def damaged_while_it_runs():
    """A task fails: all begins again, and what failed is forgotten."""
    with e2e.Folder() as base:
        gate = e2e.Gate(base)
        with e2e.Daemon(base, memory="24M", threads=1, env=gate.env) as d:
            d.ctl("push", "t", synth(base, "survey.las", 300000, "--density", 1)).ok()
            view = ["--max-error", "0.05"]
            want = mesh_of(settled(d, "t", *view))
            for _ in range(3):
                d.ctl("cache", "gc", "--all").ok()
                job = caught(d, gate, *view)
                with open(os.path.join(d.cache, "selected", selections(d, "part-")[0], "blocks"), "r+b") as f:
                    f.write(b"\xee" * 40)
                gate.open()
                d.ctl("wait", job).ok()
                expect(mesh_of(d.ctl("show", job, "--json").ok().json()) == want, "after damage of the blocks")
            expect(d.log_text().count("it begins again") == 3, "what was damaged was taken")


def without_room():
    """A simplification that does not fit on the disk waits, keeps what was done, and ends when there is room, with the same mesh."""
    with e2e.Folder() as base:
        path, view = synth(base, "survey.las", 400000, "--density", 1), ["--max-error", "0.02"]
        with e2e.Daemon(base, name="-a") as d:
            d.ctl("push", "t", path).ok()
            want = mesh_of(settled(d, "t", *view))
        d = e2e.Daemon(base, memory="64M", args=["--disk", "100M"])
        d.start()
        try:
            d.ctl("push", "t", path).ok()
            quota = d.ctl("cache", "stat", "--json").ok().json()["state_disk"]["used"] + (3 << 20)
            d.stop()
            d.command[d.command.index("100M")] = str(quota)
            d.start()
            job = d.ctl("submit", "t", *view).ok().out.split()[0]
            shown = e2e.until(lambda: [j for j in [d.ctl("show", job, "--json").ok().json()] if j["state"] in ("waiting-space", "done")],
                              "it neither waits nor ends")[0]
            expect(shown["state"] == "waiting-space" and shown["lacks_space"] > 0, str(shown))
            status = d.ctl("cache", "stat", "--json").ok().json()["state_disk"]
            expect(status["used"] <= quota, str(status))
            d.stop()
            kept = parts_of(d)
            d.command[d.command.index(str(quota))] = "100M"
            d.start()
            d.ctl("wait", job).ok()
            expect(kept, "nothing was done before there was no room")
            expect(mesh_of(d.ctl("show", job, "--json").ok().json()) == want, "after there is room")
            # What the accounts say is on the disk: the next pass over the cache finds nothing else.
            kinds = d.ctl("cache", "stat", "--json").ok().json()["kinds"]["selections"]
            folder = os.path.join(d.cache, "selected")
            expect(kinds["entries"] == len(os.listdir(folder)) == 1, "%s, %s" % (kinds, os.listdir(folder)))
        finally:
            d.stop()


def used_again():
    """One selection for plans, jobs, windows, tiles and changes; damage is mended."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, out, plain = synth(base, "survey.las", 80000, "--density", 2), os.path.join(base, "m.ply"), os.path.join(base, "p.ply")
        d.ctl("push", "t", path).ok()
        view = ["--every", "2", "--max-error", "0.1"]
        plan = d.ctl("plan", "t", "--json", *view).ok().json()
        made = selections(d)
        expect(len(made) == 2, "a plan leaves its selection and that below it: %s" % made)
        job = settled(d, "t", *view)
        number = str(job["job"])
        expect(plan["points"] == job["used"] and selections(d) == made, "%s %s" % (plan, selections(d)))
        d.ctl("fetch", number, "-o", out).ok()
        whole = set(map(frozenset, positions(out)))
        box = "500020,5400020,500090,5400070"
        got = d.ctl("fetch", number, "-o", plain, "--bbox", box, "--json").ok().json()
        expect(got["bound"] == job["bound"], "%s, not %s" % (got["bound"], job["bound"]))
        part = set(map(frozenset, positions(plain)))
        expect(part and part < whole, "%d of %d triangles in a window" % (len(part), len(whole)))
        window = settled(d, "t", *view, "--bbox", box)
        expect(window["triangles"] == len(part) and window["bound"] == job["bound"], "%s %s" % (window, job))
        expect(selections(d) == made, "a window makes no selection of its own: %s" % selections(d))
        got = d.ctl("fetch", number, "-o", os.path.join(base, "tiles"), "--tile", "60", "--json").ok().json()
        expect(got["triangles"] == job["triangles"], str(got))
        for name in os.listdir(os.path.join(base, "tiles")):
            if name.endswith(".ply"):
                expect(verify(os.path.join(base, "tiles", name), 0.1, "--view", job["view"], path)["outside"] > 0, name)
        for harm in ("counts", "report", "manifest", "simplified.seg"):
            target = [os.path.join(d.cache, "selected", n, harm) for n in made]
            with open([t for t in target if os.path.exists(os.path.join(os.path.dirname(t), "report"))][0], "r+b") as f:
                f.seek(60)
                f.write(b"\xee" * 3)
            e2e.lose_domains(d)
            again = settled(d, "t", *view)
            expect(mesh_of(again) == mesh_of(job) and selections(d) == made, "after damage of %s: %s" % (harm, selections(d)))
        # Changes between two generations are changes of the simplified meshes.
        d.ctl("push", "t", synth(base, "more.las", 3000, "--density", 5, "--origin", "500100,5400100", "--seed", 9)).ok()
        later = settled(d, "t", *view)
        d.ctl("fetch", str(later["job"]), "-o", out, "--changed-since", "1").ok()
        expect(later["digest"] != job["digest"], "a push changes it")
        d.ctl("fetch", str(later["job"]), "-o", plain).ok()
        expect(set(map(frozenset, positions(out))) <= set(map(frozenset, positions(plain))), "changes are triangles of the later mesh")


def positions(path):
    points, triangles, _ = read_ply(path)
    return [[points[v] for v in t] for t in triangles]


def lines_whole():
    """Pieces of lines and their vertices are kept, and points beside them are within the bound of the constrained mesh."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        rng, path = random.Random(4), synth(base, "survey.las", 40000, "--density", 2, "--no-crs")
        lines, plain, out = (os.path.join(base, n) for n in ("lines.csv", "p.ply", "m.ply"))
        with open(lines, "w") as f:
            f.write("line,x,y,z\n")
            for n in range(12):
                x, y = 500000 + rng.uniform(0, 130), 5400000 + rng.uniform(0, 130)
                for _ in range(8):
                    f.write("%d,%.2f,%.2f,%.2f\n" % (n, x, y, rng.uniform(230, 245)))
                    x, y = x + rng.uniform(-12, 12), y + rng.uniform(-12, 12)
        d.ctl("push", "t", path).ok()
        d.ctl("push", "t", lines, "--lines-as", "hard").ok()
        number = settled(d, "t", *ALL)["job"]
        d.ctl("fetch", str(number), "-o", plain).ok()
        all_points, _, pieces = read_ply(plain)
        expect(len(pieces) > 80, "%d pieces" % len(pieces))
        for bound in (0, 0.1, 1, 50):
            job = settled(d, "t", *ALL, "--max-error", str(bound))
            d.ctl("fetch", str(job["job"]), "-o", out).ok()
            agrees(job, verify(out, bound, plain), bound)
            points, _, marked = read_ply(out)
            expect(marked == pieces, "bound %s: %d pieces, not %d" % (bound, len(marked), len(pieces)))
            ends = {p for piece in pieces for p in piece}
            expect({p for p in all_points if p[:2] in ends} <= set(points), "vertices of lines with their heights")
        expect(job["bound"]["kept"] < len(all_points) / 10, "a coarse bound leaves little: %s" % job["bound"])


def lakes_and_boundaries():
    """What is out of the mesh has no error; a lake's ring is whole, and all of it is at one height."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, ring, lake, plain, out = (os.path.join(base, n) for n in ("survey.las", "ring.csv", "lake.csv", "p.ply", "m.ply"))
        synth(base, "survey.las", 40000, "--density", 2, "--no-crs")
        corners = [(500010, 5400015), (500128, 5400020), (500120, 5400118), (500066, 5400101), (500020, 5400122)]
        shore = [(500050, 5400050), (500080, 5400048), (500084, 5400071), (500055, 5400075)]
        for name, places, z in ((ring, corners, 236), (lake, shore, 237)):
            with open(name, "w") as f:
                f.write("line,x,y,z\n" + "".join("1,%d,%d,%d\n" % (x, y, z) for x, y in places + places[:1]))
        d.ctl("push", "t", path).ok()
        d.ctl("push", "t", lake, "--lines-as", "lake").ok()
        d.ctl("push", "t", ring, "--lines-as", "boundary").ok()
        number = settled(d, "t", *ALL)["job"]
        d.ctl("fetch", str(number), "-o", plain).ok()
        area = lambda mesh: sum((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) for a, b, c in positions(mesh))
        for bound in (0.05, 0.5, 20):
            job = settled(d, "t", *ALL, "--max-error", str(bound))
            d.ctl("fetch", str(job["job"]), "-o", out).ok()
            checked = verify(out, bound, plain)
            expect(checked["outside"] == 0 and checked["vertices"] == job["vertices"], "%s" % checked)
            expect(read_ply(out)[2] == read_ply(plain)[2], "the rings")
            expect(abs(area(out) - area(plain)) < 1e-3, "%s, not %s" % (area(out), area(plain)))
            inside = [p for p in read_ply(out)[0] if 500060 < p[0] < 500075 and 5400055 < p[1] < 5400070]
            expect(not inside, "points in a lake: %s" % inside)


def as_many_as_asked():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, out = synth(base, "survey.las", 60000, "--density", 2), os.path.join(base, "m.ply")
        d.ctl("push", "t", path).ok()
        last = None
        for most in (100000, 30000, 8000, 2000):
            job = settled(d, "t", "--ground", "--max-points", str(most))
            d.ctl("fetch", str(job["job"]), "-o", out).ok()
            bound = job["bound"]
            checked = verify(out, bound["max_error"], "--ground", path)
            agrees(job, checked)
            expect(bound["kept"] <= most, "%s, %d were asked for" % (bound, most))
            expect(last is None or bound["max_error"] >= last["max_error"], "%s, then %s" % (last, bound))
            # That bound, when it is known from the start, is reached with other points, and about as many.
            same = settled(d, "t", "--ground", "--max-error", repr(bound["max_error"]))["bound"]
            expect(abs(same["kept"] - bound["kept"]) < bound["kept"] / 10, "%s %s" % (same, bound))
            last = bound
            print(most, bound, flush=True)
        # The least bound is near: a tenth less is too many points.
        less = settled(d, "t", "--ground", "--max-error", "%.2f" % (last["max_error"] * 0.9))
        expect(less["bound"]["kept"] > 2000, "%s would do as well as %s" % (less["bound"], last))
        few = d.ctl("submit", "t", "--wait", "--max-points", "3")
        expect(few.status not in (0, 3) and "3" in few.out + few.err, "%d %s%s" % (few.status, few.out, few.err))


def refused():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = os.path.join(base, "a.xyz")
        with open(path, "w") as f:
            f.writelines("%d %d %d\n" % (i % 30, i // 30, i * i % 7) for i in range(900))
        d.ctl("push", "t", path).ok()
        d.ctl("push", "metres", "--assume-units", "ft,m", path).ok()
        d.ctl("push", "feet", "--assume-units", "m,ft", path).ok()
        for words, status, text in (
                (["--max-error", "-1"], 2, "not a length"), (["--max-error=-1"], 2, "not a length"), (["--max-error", "x"], 2, "not a length"),
                (["--max-error", ""], 2, "not a length"), (["--max-points", "0"], 2, "max-points"), (["--max-points", "-4"], 2, "max-points"),
                (["--max-error", "1", "--max-points", "9"], 2, "bound"), (["--max-error", "0.1m"], 1, "unit of the heights is unknown"),
                (["--max-error", "1e12"], 2, "higher than any dataset"),
                (["--max-error", "0.9"], 2, "less than a step")):
            got = d.ctl("submit", "t", *words)
            expect(got.status == status and text in got.out + got.err, "%s: %d %s%s" % (words, got.status, got.out, got.err))
        lines = [settled(d, name, "--max-error", "4ft") for name in ("metres", "feet")]
        expect([j["view"] for j in lines] == ["view 1 max-error=1", "view 1 max-error=4"], str([j["view"] for j in lines]))
        # A bound that is no multiple of the step is rounded down, and the user is told.
        note = "--max-error 4ft is rounded down to 1, a multiple of the step of the heights (1)"
        expect([j["notes"] for j in lines] == [[note], []], str([j["notes"] for j in lines]))
        got = d.ctl("submit", "metres", "--max-error", "4ft").ok()
        expect(note in got.err, got.err)
        for name, notes in (("metres", [note]), ("feet", [])):
            expect(d.ctl("plan", name, "--max-error", "4ft", "--json").ok().json()["notes"] == notes, "a plan of %s" % name)
        expect(note in d.ctl("plan", "metres", "--max-error", "4ft").ok().err, "a plan without a note")
        expect(d.ctl("plan", "metres", "--json").ok().json()["notes"] == [], "a note without a bound")
        for bound, notes in (("2.5", [note.replace("4ft", "2.5").replace("to 1", "to 2")]), ("2.0", [])):
            got = d.ctl("mesh", path, "--format", "null", "--json", "--max-error", bound).ok()
            expect(got.json()["notes"] == notes and got.json()["bound"]["max_error"] == 2, str(got.json()))
        # Nothing, a line, and what is flat.
        for points, used in (([], 0), ([(1, 1, 1)], 1), ([(i, 2 * i, i % 3) for i in range(50)], 50), ([(i % 9, i // 9, 5) for i in range(81)], 4)):
            with open(path, "w") as f:
                f.writelines("%d %d %d\n" % p for p in points or [(0, 0, 0)])
            got = d.ctl("mesh", path, "--format", "null", "--json", "--max-error", "0", *([] if points else ["--zmin", "9"])).ok().json()
            expect(got["used"] == used, "%d of %d points are used: %s" % (got["used"], len(points), got))


if __name__ == "__main__":
    e2e.main(within_the_bound, one_digest, continued, cancelled_and_damaged, damaged_while_it_runs, without_room, used_again, lines_whole, lakes_and_boundaries, as_many_as_asked,
             refused)
