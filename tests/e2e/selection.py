"""Views that crop, take every so many, or thin: the mesh of a view is the mesh of the points that a second selection,
written here from the rules alone, leaves in a file of its own. And what the daemon keeps of a selection: made once,
used again, made again when it is gone, never left half made."""
import json
import os
import random
import shutil
import signal
import struct

import e2e
from e2e import expect

try:
    import xxhash
except ImportError:
    e2e.skip("python3-xxhash is not there")

POINTS = 200000
OVER = 32 << 20  # what VmHWM may exceed `memory` by


class Survey:
    """A LAS file of point format 1, and its points as (x, y, z, class, returns, flags), lattice numbers."""

    def __init__(self, path, points=POINTS, *options):
        e2e.run([e2e.SYNTH, "--points", points, *options, path]).ok()
        with open(path, "rb") as f:
            data = f.read()
        self.path = path
        offset, = struct.unpack_from("<I", data, 96)
        length, = struct.unpack_from("<H", data, 105)
        expect(data[104] == 1, "point format %d" % data[104])
        self.head, self.length, self.body = data[:offset], length, data[offset:]
        scale, _, _, ox, oy, oz = struct.unpack_from("<6d", data, 131)
        self.scale = scale
        self.k = [round(o / scale) for o in (ox, oy, oz)]
        self.points = []
        for i in range(points):
            x, y, z, _, returns, cls = struct.unpack_from("<iiiHBB", self.body, i * length)
            flags = (cls >> 7) | (cls >> 5 & 1) << 1 | (cls >> 6 & 1) << 2
            self.points.append((x + self.k[0], y + self.k[1], z + self.k[2], cls & 31,
                                (returns & 7) | (returns >> 3 & 7) << 4, flags))

    def box(self):
        xs, ys = [p[0] for p in self.points], [p[1] for p in self.points]
        return min(xs), min(ys), max(xs), max(ys)

    def text(self, number):
        """A lattice number as the coordinate of the file, exactly."""
        return "%d.%02d" % (number // 100, number % 100) if number >= 0 else "-" + self.text(-number)

    def write(self, path, chosen):
        head = bytearray(self.head)
        struct.pack_into("<I", head, 107, len(chosen))
        with open(path, "wb") as f:
            f.write(head)
            for i in chosen:
                f.write(self.body[i * self.length:(i + 1) * self.length])


def in_polygon(ring, x, y):
    """Closed, in whole numbers."""
    odd = False
    for (ax, ay), (bx, by) in zip(ring, ring[1:] + ring[:1]):
        cross = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        if cross == 0 and min(ax, bx) <= x <= max(ax, bx) and min(ay, by) <= y <= max(ay, by):
            return True
        if (ay > y) != (by > y) and (cross > 0) == (by > ay):
            odd = not odd
    return odd


def select(survey, classes=None, box=None, ring=None, every=1, cell=0, pick="lowest"):
    """Numbers of the records that the rules leave, by the words of the manual."""
    cells, chosen = {}, []
    for i, (x, y, z, cls, returns, flags) in enumerate(survey.points):
        if classes and cls not in classes or not classes and cls in (7, 18) or flags & 1:
            continue
        if box and not (box[0] <= x <= box[2] and box[1] <= y <= box[3]):
            continue
        if ring and not in_polygon(ring, x, y):
            continue
        if every > 1 and xxhash.xxh3_64_intdigest(struct.pack("<qq", x, y)) % every:
            continue
        if cell:
            cells.setdefault((x // cell, y // cell), []).append((-z if pick == "highest" else z, cls, returns, flags, x, y, i))
        else:
            chosen.append(i)
    for points in cells.values():
        points.sort()
        chosen.append(points[(len(points) - 1) // 2 if pick == "median" else 0][-1])
    return chosen


def views(survey):
    """(options, what select takes)."""
    x1, y1, x2, y2 = survey.box()
    w, h = x2 - x1, y2 - y1
    small = (x1 + w // 2, y1 + h // 3, x1 + w // 2 + w // 10, y1 + h // 3 + h // 10)
    ring = [(x1 + w // 5, y1 + h // 5), (x1 + w * 4 // 5, y1 + h // 4), (x1 + w // 2, y1 + h * 9 // 10), (x1 + w // 2, y1 + h // 2)]
    wkt = survey.path + ".wkt"
    with open(wkt, "w") as f:
        f.write("POLYGON ((%s))" % ", ".join("%s %s" % (survey.text(x), survey.text(y)) for x, y in ring + ring[:1]))
    crop = ["--crop", ",".join(survey.text(v) for v in small)]
    return [
        (crop, dict(box=small)),
        (["--crop", wkt], dict(ring=ring)),
        (["--every", "10"], dict(every=10)),
        (["--thin", "2.5"], dict(cell=250)),
        (["--thin", "2.5", "--thin-pick", "highest"], dict(cell=250, pick="highest")),
        (["--thin", "0.7", "--thin-pick", "median"], dict(cell=70, pick="median")),
        (["--class", "2,3", "--crop", wkt, "--every", "3", "--thin", "1.5", "--thin-pick", "median"],
         dict(classes=(2, 3), ring=ring, every=3, cell=150, pick="median")),
    ]


SAME = ("digest", "vertex_digest", "triangles", "vertices", "hull")


def mesh(d, base, *args):
    out = os.path.join(base, "out.obj")
    got = d.ctl("mesh", "--json", "-o", out, *args).ok().json()
    os.unlink(out)
    return got


def plain(d, base, survey, chosen):
    """The mesh of these records and no rule."""
    path = os.path.join(base, "chosen.las")
    survey.write(path, chosen)
    got = mesh(d, base, "--keep-withheld", "--keep-noise", path)
    expect(got["points"] == len(chosen), "the file of chosen points has %d, not %d" % (got["points"], len(chosen)))
    return got


def same_as_a_selection_of_our_own():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        s = Survey(os.path.join(base, "survey.las"))
        for options, rules in views(s):
            want = plain(d, base, s, select(s, **rules))
            got = mesh(d, base, *options, s.path)
            for k in SAME:
                expect(got[k] == want[k], "%s: %s %s, not %s" % (" ".join(options), k, got[k], want[k]))
            expect(got["points"] == POINTS, "%d points" % got["points"])
            expect(got["used"] + sum(got["removed"].values()) == POINTS, "the counts of %s do not add up: %s" % (options, got))
            print("%-70s used %6d %s" % (" ".join(options).replace(base, ""), got["used"], got["digest"]), flush=True)
        # No file of a one-step dataset remains, nor its selection.
        left = lambda: [n for _, _, files in os.walk(d.cache) for n in files if n not in ("lock", "acut-cache")]
        e2e.until(lambda: not left(), lambda: "left in the cache: %s" % left())


def one_digest():
    """Whatever the memory, the threads, the order of pushes; and bounded."""
    with e2e.Folder() as base:
        s = Survey(os.path.join(base, "survey.las"), 2 * POINTS)
        parts, n = [], len(s.points)
        order = list(range(n))
        random.Random(3).shuffle(order)
        for i in range(3):
            parts.append(os.path.join(base, "part%d.las" % i))
            s.write(parts[-1], order[n * i // 3:n * (i + 1) // 3])
        seen = {}
        for memory, threads in (("24M", 1), ("256M", 2)):
            with e2e.Daemon(base, memory=memory, threads=threads, name="-" + memory) as d:
                for number, pushes in enumerate(([[s.path]], [[parts[0]], [parts[1]], [parts[2]]], [[parts[2], parts[0]], [parts[1]]])):
                    name = "d%d" % number
                    for p in pushes:
                        d.ctl("push", name, *p).ok()
                    for options, _ in views(s)[1:]:
                        job = d.ctl("submit", name, "--wait", *options).ok().out.split()[0]
                        got = d.ctl("show", job, "--json").ok().json()
                        key = " ".join(options)
                        seen.setdefault(key, set()).add((got["digest"], got["vertex_digest"], json.dumps(got["removed"])))
                        expect(len(seen[key]) == 1, "%s with %s: %s" % (key, memory, seen[key]))
                    shutil.rmtree(os.path.join(d.cache, "domains"))
                    os.mkdir(os.path.join(d.cache, "domains"))
                limit = {"24M": 24 << 20, "256M": 256 << 20}[memory] + OVER
                expect(d.vmhwm() <= limit, "VmHWM %d with memory=%s" % (d.vmhwm(), memory))


def selections(d):
    folder = os.path.join(d.cache, "selected")
    return sorted(os.listdir(folder)) if os.path.isdir(folder) else []


def kept_and_used_again():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        s = Survey(os.path.join(base, "survey.las"))
        d.ctl("push", "valley", s.path).ok()
        view = ["--thin", "2.5", "--thin-pick", "median", "--every", "2"]

        def job(*options):
            number = d.ctl("submit", "valley", "--new", "--wait", *options).ok().out.split()[0]
            return number, d.ctl("show", number, "--json").ok().json()

        plan = d.ctl("plan", "valley", "--json", *view).ok().json()
        made = selections(d)
        expect(len(made) == 1, "a plan left %s" % made)
        first, want = job(*view)
        expect(plan["points"] == want["used"], "the plan counts on %s points, %s were used" % (plan["points"], want["used"]))
        expect(selections(d) == made, "a job made another selection than its plan: %s" % selections(d))
        stamp = os.stat(os.path.join(d.cache, "selected", made[0], "manifest")).st_mtime_ns
        for options in (view, view + ["--duplicates", "highest"]):
            _, got = job(*options)
            expect(got["digest"] == want["digest"] and got["removed"] == want["removed"], "%s: %s" % (options, got))
        expect(selections(d) == made, "%s" % selections(d))
        expect(os.stat(os.path.join(d.cache, "selected", made[0], "manifest")).st_mtime_ns == stamp, "it was made twice")
        # Damage is noticed, absence is mended, a restart changes nothing.
        out = os.path.join(base, "m.ply")
        for harm in ("counts", "manifest", "selection.seg", "all"):
            path = os.path.join(d.cache, "selected", made[0], harm)
            shutil.rmtree(os.path.join(d.cache, "domains"))
            os.mkdir(os.path.join(d.cache, "domains"))
            if harm == "all":
                d.stop()
                shutil.rmtree(d.cache)
                d.start()
            else:
                with open(path, "r+b") as f:
                    f.seek(60)
                    f.write(b"\xee\xee\xee")
            d.ctl("fetch", first, "-o", out).ok()
            expect(selections(d) == made, "after %s: %s" % (harm, selections(d)))
        # A block in the middle of it: said once, then made again.
        shutil.rmtree(os.path.join(d.cache, "domains"))
        os.mkdir(os.path.join(d.cache, "domains"))
        with open(os.path.join(d.cache, "selected", made[0], "selection.seg"), "r+b") as f:
            f.seek(os.path.getsize(f.name) // 3)
            f.write(b"\xee" * 64)
        said = d.ctl("fetch", first, "-o", out)
        expect(said.status == 74 and "makes it new" in said.out + said.err, "%d %s%s" % (said.status, said.out, said.err))
        e2e.until(lambda: not selections(d), "a damaged selection stays")
        d.ctl("fetch", first, "-o", out).ok()
        chosen = os.path.join(base, "chosen.las")
        s.write(chosen, select(s, every=2, cell=250, pick="median"))
        e2e.run([e2e.VERIFY, out, chosen]).ok()


def of_another_system():
    """The same file pushed under two systems: what a mesh says of its coordinates is its own dataset's, whoever made the
    selection first."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, out = os.path.join(base, "points.xyz"), os.path.join(base, "m.ply")
        with open(path, "w") as f:
            f.writelines("%d.%02d %d.5 %d\n" % (500000 + i % 50, i % 100, 5400000 + i // 50, i % 7) for i in range(2000))
        for name in ("EPSG:25832", "EPSG:25833"):
            d.ctl("push", name[5:], "--assume-crs", name, path).ok()
            job = d.ctl("submit", name[5:], "--wait", "--every", "2").ok().out.split()[0]
            d.ctl("fetch", job, "-o", out).ok()
            with open(out, "rb") as f:
                said = [line for line in f.read(4096).split(b"\n") if line.startswith(b"comment acut-crs")]
            expect(len(said) == 1 and name.encode() in said[0], "%s: %s" % (name, said))
        expect(len(selections(d)) == 2, str(selections(d)))


def nothing_and_everything():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        s = Survey(os.path.join(base, "survey.las"), 20000)
        got = mesh(d, base, "--crop", "0,0,10,10", s.path)
        expect(got["triangles"] == 0 and got["used"] == 0 and got["removed"]["crop"] == 20000, str(got))
        said = d.ctl("mesh", "-o", os.path.join(base, "m.obj"), "--crop", "0,0,10,10", s.path).ok()
        expect("fewer than three" in said.out + said.err, said.out + said.err)
        want = mesh(d, base, s.path)
        for options in (["--thin", "0.01"], ["--every", "1"]):
            got = mesh(d, base, *options, s.path)
            for k in SAME:
                expect(got[k] == want[k], "%s: %s differs" % (options, k))


def killed_and_cancelled():
    with e2e.Folder() as base:
        gate = e2e.Gate(base)
        with e2e.Daemon(base, memory="24M", threads=1, env=gate.env) as d:
            killed_and_cancelled_in(base, gate, d)


def killed_and_cancelled_in(base, gate, d):
    path = os.path.join(base, "big.las")
    e2e.run([e2e.SYNTH, "--points", 300000, path]).ok()
    d.ctl("push", "big", path).ok()
    view = ["--thin", "1.1", "--thin-pick", "median"]

    def caught():
        """A job in the middle of its selection, until the gate is opened."""
        gate.close("pwrite", "/selected/tmp-", 1)
        job = d.ctl("submit", "big", "--new", *view).ok().out.split()[0]
        expect(gate.wait(), "no selection began")
        return job

    job = caught()
    shown = d.ctl("show", job, "--json").json()
    expect(shown["progress"]["phase"] == "select" and shown["state"] == "planning", str(shown))
    d.ctl("cancel", job).ok()
    gate.open()
    expect(d.ctl("wait", job).status == 1, "a cancelled job")
    expect(not any(n.startswith("tmp-") for n in selections(d)), "after a cancel: %s" % selections(d))
    shutil.rmtree(os.path.join(d.cache, "selected"))
    job = caught()
    d.stop(signal.SIGKILL)
    gate.open()
    expect(any(n.startswith("tmp-") for n in selections(d)), "no file is left")
    d.start()
    d.ctl("wait", job).ok()
    got = d.ctl("show", job, "--json").ok().json()
    expect(len(selections(d)) == 1 and not selections(d)[0].startswith("tmp-"), str(selections(d)))
    with e2e.Daemon(base, name="-b") as other:
        want = mesh(other, base, *view, path)
    expect(got["digest"] == want["digest"] and got["removed"] == want["removed"], "%s\n%s" % (got, want))
    # Two jobs that want the same selection: it is made once, both are done.
    shutil.rmtree(os.path.join(d.cache, "selected"))
    jobs = [d.ctl("submit", "big", "--new", *view).ok().out.split()[0] for _ in range(2)]
    d.ctl("wait", *jobs).ok()
    expect(len(selections(d)) == 1, str(selections(d)))


def domains_from_files_alone():
    """acut-domain on every region of such a view, from the dataset's manifest and from the selection's: together the
    triangles and the digest of the daemon's mesh."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        s = Survey(os.path.join(base, "survey.las"))
        d.ctl("push", "valley", s.path).ok()
        job = d.ctl("submit", "valley", "--wait", "--thin", "0.6", "--thin-pick", "highest").ok().out.split()[0]
        want = d.ctl("show", job, "--json").ok().json()
        d.stop()
        view = want["view"]
        manifests = [os.path.join(top, n) for top, _, files in os.walk(d.state) for n in files if n.startswith("m")
                     and e2e.run([e2e.DOMAIN, "--plan", os.path.join(top, n), ""]).status == 0]
        expect(len(manifests) == 1, "manifests: %s" % manifests)
        made = e2e.run([e2e.DOMAIN, "--select", manifests[0], view, os.path.join(base, "selected")]).ok().out
        manifest, rest = made.rstrip("\n").split("\t")
        out = os.path.join(base, "out")
        os.mkdir(out)
        plan = e2e.run([e2e.DOMAIN, "--memory", "16M", "--plan", manifests[0], view]).ok().out.splitlines()
        again = e2e.run([e2e.DOMAIN, "--memory", "16M", "--plan", manifest, rest]).ok().out.splitlines()
        expect(plan == again and len(plan) > 1, "%d regions, and %d" % (len(plan), len(again)))
        for source, words in ((manifests[0], view), (manifest, rest)):
            halves, count = [0, 0], 0
            for line in plan:
                got = e2e.run([e2e.DOMAIN, "--memory", "16M", source, words, line.split()[0], out]).ok().out.split()
                count += int(got[got.index("triangles") + 1])
                digest = got[got.index("digest") + 1]
                halves = [(h + int(part, 16)) % 2**64 for h, part in zip(halves, (digest[:16], digest[16:]))]
            expect(count == want["triangles"], "%d triangles, not %d" % (count, want["triangles"]))
            expect("%016x%016x" % tuple(halves) == want["digest"], "the digests do not add up")
        expect(sum(len(files) for _, _, files in os.walk(out)) == len(plan), "the two ways gave domains of different keys")


e2e.main(same_as_a_selection_of_our_own, one_digest, kept_and_used_again, of_another_system, nothing_and_everything, killed_and_cancelled,
         domains_from_files_alone)
