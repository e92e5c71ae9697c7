"""fetch --changed-since. A client that holds the old mesh by regions, removes the regions that are gone and adds the new ones,
has the new mesh, triangle by triangle, with heights. So does a client that holds it without regions and decides by circumcentres,
also on borders. Cases: new points, changed heights, a revert, no change, a resumed stream, and refusals."""
import json
import os
import random
import shutil
import struct
from fractions import Fraction

import e2e
from e2e import Daemon, Folder, expect

try:
    import xxhash
    from acut_wire import Client, Digest, Mesh, PipeReader, pb, read_all
    from life_shapes import centre_in
except ImportError as e:
    e2e.skip("python3-xxhash and python3-protobuf are needed: %s" % e)

SMALL = {"memory": "24M", "threads": 2}
POINTS = 84000  # four regions of 21,000 at the least memory; 42,000 would not fit
SIDE = 1000


def write_points(path, points):
    with open(path, "w") as f:
        for x, y, z in points:
            f.write("%.2f %.2f %.2f\n" % (x, y, z))
    return path


def survey(base):
    rng = random.Random(5)
    return write_points(os.path.join(base, "survey.xyz"),
                        [(rng.uniform(0, SIDE), rng.uniform(0, SIDE), rng.uniform(0, 50)) for _ in range(POINTS)])


def corner(base, name="corner.xyz", n=300, at=0.0, seed=6):
    rng = random.Random(seed)
    return write_points(os.path.join(base, name),
                        [(at + rng.uniform(0, 30), at + rng.uniform(0, 30), rng.uniform(0, 50)) for _ in range(n)])


def job_of(d, generation, *options):
    return int(d.ctl("submit", "s", "--at", str(generation), "--wait", *options).ok().out.split()[0])


def digests(regions):
    """Both digests of a mesh by regions."""
    triangles, vertices, seen = Digest(), Digest(), set()
    for rows in regions.values():
        for t in rows:
            triangles.add_triangle(*t)
            seen.update(t)
    for p in seen:
        vertices.add(struct.pack("<3q", *p))
    return str(triangles), str(vertices)


def same(a, b):
    return a.keys() == b.keys() and all(rows == b[region] or set(rows) == set(b[region]) for region, rows in a.items())


def sum_of(rows):
    d = Digest()
    for t in rows:
        d.add_triangle(*t)
    return str(d)


def apply(held, changes):
    """The mesh that a holder of regions has afterwards."""
    held = dict(held)
    for region, (triangles, digest) in changes.gone.items():
        expect(len(held[region]) == triangles and sum_of(held[region]) == digest, "a region that is gone was another: %s" % (region,))
        del held[region]
    expect(changes.base.kept == len(held) and changes.base.kept_triangles == sum(map(len, held.values())), "what is kept")
    for region, rows in changes.regions.items():
        expect(region not in held, "a region comes that holds: %s" % (region,))
        held[region] = rows
    return held


def check(c, old, since, new, new_job):
    """Applies the changes; (base, the stream)."""
    changes = c.fetch(new_job, since)
    b = changes.base
    expect(changes.kind == 3 and b.generation == since, "head and base")
    expect((b.old_digest, b.old_vertex_digest) == (str(old.digest), str(old.vertex_digest)), "the old mesh")
    expect((b.digest, b.vertex_digest) == (str(new.digest), str(new.vertex_digest)), "the new mesh")
    got = apply(old.regions, changes)
    expect(same(got, new.regions), "the regions are not those of the new mesh")
    return b, changes, got


def pushed(d, *paths):
    for p in paths:
        d.ctl("push", "s", p).ok()


def noted_otherwise(path):
    """The same domains as another version of the store would have them: with other checksums (format.md, Plans)."""
    with open(path, "rb") as f:
        data = bytearray(f.read())
    count = 0
    for at in range(0, len(data), 104):
        if data[at + 6] == 5:
            data[at + 72] ^= 1
            data[at + 96:at + 104] = struct.pack("<Q", xxhash.xxh3_64_intdigest(bytes(data[at:at + 96]), seed=0))
            count += 1
    expect(count > 1, "%d domains are noted in the plan" % count)
    with open(path, "wb") as f:
        f.write(data)


def follows():
    with Folder() as base, Daemon(base, **SMALL) as d, Client(d.socket) as c:
        pushed(d, survey(base), corner(base))
        one, two = job_of(d, 1), job_of(d, 2)
        first, second = c.fetch(one), c.fetch(two)
        b, changes, got = check(c, first, 1, second, two)
        expect(digests(got) == (str(second.digest), str(second.vertex_digest)), "the digests are not those of the new mesh")
        whole = len(second.regions)
        expect(0 < b.gone <= whole // 2 and b.kept > 0, "300 points in a corner: %d of %d regions are gone" % (b.gone, whole))
        print("%d regions gone, %d kept, %d new with %d triangles" % (b.gone, b.kept, len(changes.regions), len(changes.triangles)))
        # And back.
        back, _, _ = check(c, second, 2, first, one)
        expect(back.kept == b.kept, "the way back keeps other regions")
        # Lower points of positions that are there: heights, and no triangle.
        rows = [l.split() for l in open(os.path.join(base, "survey.xyz")) if float(l.split()[0]) < 20 and float(l.split()[1]) > 980]
        pushed(d, write_points(os.path.join(base, "low.xyz"), [(float(x), float(y), -5 - i) for i, (x, y, _) in enumerate(rows[:7])]))
        three = job_of(d, 3)
        third = c.fetch(three)
        b, changes, _ = check(c, second, 2, third, three)
        expect(b.old_digest == b.digest and b.old_vertex_digest != b.vertex_digest, "heights alone")
        expect(0 < b.gone and b.gone_triangles == len(changes.triangles), "heights alone: %d regions gone, %d new; %d triangles, %d" % (b.gone, len(changes.regions), b.gone_triangles, len(changes.triangles)))
        # Over two generations at once, and against itself.
        check(c, first, 1, third, three)
        b, changes, _ = check(c, third, 3, third, three)
        expect(not b.gone and not changes.triangles and not changes.indexes and b.kept, "nothing has changed")
        # The stored domains may be removed, and the daemon restarted.
        d.stop()
        shutil.rmtree(os.path.join(base, "cache"), ignore_errors=True)
        noted_otherwise(os.path.join(d.state, "plans", "plan-%d" % one))
        with Daemon(base, **SMALL) as again, Client(again.socket) as c:
            b, _, _ = check(c, first, 1, second, two)
            expect(b.kept == back.kept, "domains of an older version of the store: %d kept, not %d" % (b.kept, back.kept))


def selected():
    """Changes of meshes whose views select points. The selections exist, so they are not charged again."""
    with Folder() as base, Daemon(base, **SMALL) as d, Client(d.socket) as c:
        pushed(d, survey(base), corner(base))
        for view in ("--crop=-9,-9,2000,2000",), ("--every", "4"), ("--thin", "1"):
            two = job_of(d, 2, *view)
            if view[0].startswith("--crop"):
                one = job_of(d, 1, *view)
                b, _, _ = check(c, c.fetch(one), 1, c.fetch(two), two)
                expect(b.gone and b.kept, "%d regions are gone, %d hold" % (b.gone, b.kept))
            # The same mesh again: everything holds. acutctl compares the digests.
            got = d.ctl("fetch", str(two), "--changed-since", "2", "--format", "null", "--json").ok().json()["changes"]
            expect(got["kept"] and not got["gone"] and not got["new"], "%s: nothing has changed: %s" % (view, got))
        metric = ("--metric", "3,1,4")
        two = job_of(d, 2, *metric)
        one = job_of(d, 1, *metric)
        b, _, _ = check(c, c.fetch(one), 1, c.fetch(two), two)
        expect(b.gone and b.kept, "a metric: %d regions are gone, %d hold" % (b.gone, b.kept))
        changed_command(base, d, one, two, metric=(3, 1, 4))
        # Points so far away that the plane has another origin: its regions are others.
        pushed(d, corner(base, "far.xyz", 20, at=4e6), corner(base, "far2.xyz", 20, at=4e6 + 50))
        three, four = job_of(d, 3, *metric), job_of(d, 4, *metric)
        changed_command(base, d, three, four, 3, (3, 1, 4))
        refused(d.ctl("fetch", str(four), "--changed-since", "1", "--format", "null"), 1, "another origin", "the whole mesh")


def frames(source):
    """Head, base and lists; blocks; tail; as bytes."""
    parts = []
    while not parts or parts[-1][0] != 3:
        header = read_all(source, 32)
        expect(len(header) == 32, "the stream ended")
        kind, length = struct.unpack_from("<HQ", header, 6)
        parts.append((kind, header + read_all(source, length)))
    return [p for k, p in parts if k in (1, 4, 5)], [p for k, p in parts if k == 2], parts[-1][1]


def fetch_frames(c, **fields):
    _, fd = c.ask("fetch", pb.Fetch(**fields))
    try:
        return frames(PipeReader(fd, e2e.PATIENCE))
    finally:
        os.close(fd)


class Head:
    """Only the head of a stream."""

    def __init__(self, c, **fields):
        _, fd = c.ask("fetch", pb.Fetch(**fields))
        try:
            source = PipeReader(fd, e2e.PATIENCE)
            header = read_all(source, 32)
            high, low = struct.unpack_from("<QQ", read_all(source, struct.unpack_from("<Q", header, 8)[0]), 8)
            self.stream_id = "%016x%016x" % (high, low)
        finally:
            os.close(fd)


def goes_on():
    with Folder() as base, Daemon(base, **SMALL) as d, Client(d.socket) as c:
        pushed(d, survey(base))
        pushed(d, write_points(os.path.join(base, "all.xyz"), [(10 * i + 3.33, 10 * j + 3.33, 1) for i in range(99) for j in range(99)]))
        one, two = job_of(d, 1), job_of(d, 2)
        changes = c.fetch(two, 1)
        front, blocks, tail = fetch_frames(c, job=two, changed_since=1)
        expect(len(blocks) == len(changes.indexes) > 2, "%d blocks" % len(blocks))
        for n in (1, len(blocks) // 2, len(blocks)):
            got = fetch_frames(c, job=two, changed_since=1, from_block=n, stream_id=changes.stream_id)
            expect(got == (front, blocks[n:], tail), "from block %d" % n)
        others = {Head(c, job=two).stream_id, Head(c, job=one, changed_since=2).stream_id,
                  Head(c, job=two, changed_since=2).stream_id, "0" * 32}
        expect(len(others | {changes.stream_id}) == 5, "one id for several streams")
        for wrong in others:
            _, fd = c.ask("fetch", pb.Fetch(job=two, changed_since=1, from_block=1, stream_id=wrong))
            try:
                Mesh(PipeReader(fd, e2e.PATIENCE))
            except Exception as e:
                expect(getattr(e, "code", "") == "stream-gone", repr(e))
            else:
                expect(False, "it went on with another stream")
            finally:
                os.close(fd)


def refused(run, status, *texts):
    expect(run.status == status, "%d, not %d: %s" % (run.status, status, run.err))
    for text in texts:
        expect(text in run.err, "no %r in %s" % (text, run.err))


def circumcentre(a, b, c):
    """Twice the circumcentre, exactly."""
    ax, ay = a
    bx, by, cx, cy = b[0] - ax, b[1] - ay, c[0] - ax, c[1] - ay
    d = 2 * (bx * cy - by * cx)
    b2, c2 = bx * bx + by * by, cx * cx + cy * cy
    return 2 * ax + 2 * Fraction(cy * b2 - by * c2, 1) / d, 2 * ay + 2 * Fraction(bx * c2 - cx * b2, 1) / d


def read_obj(path):
    vertex, triangles = [], []
    with open(path) as f:
        for line in f:
            word = line.split()
            if word[0] == "v":
                vertex.append(tuple(round(float(w) * 100) for w in word[1:]))  # two decimals: exact
            elif word[0] == "f":
                t = tuple(vertex[int(w) - 1] for w in word[1:])
                triangles.append(min(t, t[1:] + t[:1], t[2:] + t[:2]))
    return triangles


def doubled(regions):
    """Regions of the list beside the output, read as fractions, in doubled hundredths."""
    out = [[v if v is None else v * 200 for v in r] for r in regions]
    expect(all(v is None or v % 2 == 1 for r in out for v in r), "borders are halves: %s" % out)
    return [[v if v is None else int(v) for v in r] for r in out]


def changed_command(base, d, one, two, since=1, metric=(1, 0, 1)):
    """The file of changes: a client without regions applies the changes since a generation, and has the mesh of job two. With a
    metric regions are of the mapped plane."""
    p, q, k = metric

    def placed(t, regions):
        return centre_in([(p * x + q * y, k * (p * y - q * x)) for x, y, _ in t], regions)
    old, new, out = (os.path.join(base, n) for n in ("old.obj", "new.obj", "out.obj"))
    d.ctl("fetch", str(one), "-o", old).ok()
    d.ctl("fetch", str(two), "-o", new).ok()
    got = d.ctl("fetch", str(two), "--changed-since", str(since), "-o", out, "--json").ok().json()
    was, now, came = (read_obj(p) for p in (old, new, out))
    with open(out + ".changes.geojson") as f:
        index = json.load(f, parse_float=Fraction)
    gone = doubled(f["properties"]["region"] for f in index["features"] if f["properties"]["change"] == "gone")
    fresh = [f["properties"] for f in index["features"] if f["properties"]["change"] == "new"]
    expect(len(came) == sum(p["triangles"] for p in fresh) == got["changes"]["new_triangles"], got["changes"])
    expect(len(gone) == got["changes"]["gone"] == index["acut"]["gone"], got["changes"])
    expect(got["changes"]["since"] == since and got["changes"]["old_job"] == one and got["digest"] == index["acut"]["digest"], got)
    kept = [t for t in was if not placed(t, gone)]
    expect(len(was) - len(kept) == got["changes"]["gone_triangles"], "circumcentres in regions that are gone")
    expect(sorted(kept + came) == sorted(now), "without regions it is not the new mesh")
    places = doubled(f["region"] for f in fresh)
    expect(index["acut"].get("metric") == (None if k == 1 else [p, q, k]), index["acut"])
    expect(all(placed(t, places) for t in came), "what came lies in no new region")
    return out


def beside_borders():
    """Parts of a small grid, at random: many circumcentres lie on borders, where the corners decide. On the lower border few do:
    holes of the grid, whose circles have their centre on the border and three points on them."""
    middle, radius2 = 417, 2210  # doubled
    holes = {(middle, n): ((19, -43), (41, -23), (47, 1)) for n in (101, 201, 301)}
    holes.update({(n, middle): ((47, 1), (41, 23), (19, 43)) for n in (101, 201, 301)})
    places = [(x, y) for x in range(420) for y in range(420)
              if all((2 * x - i) ** 2 + (2 * y - j) ** 2 > radius2 for i, j in holes)]
    on_holes = [((i + x) // 2, (j + y) // 2) for (i, j), corners in holes.items() for x, y in corners]
    with Folder() as base, Daemon(base, **SMALL) as d, Client(d.socket) as c:
        rng = random.Random(8)

        def write(name, places):
            return write_points(os.path.join(base, name), [(x / 100, y / 100, rng.uniform(0, 50)) for x, y in places])
        pushed(d, write("half.xyz", rng.sample(places, POINTS) + on_holes),
               write("corner.xyz", [(x, y) for x in range(40) for y in range(40)]))
        one, two = job_of(d, 1), job_of(d, 2)
        mesh, ties = c.fetch(one), [0] * 4
        for r, rows in mesh.regions.items():
            box = [None if abs(v) >= (1 << 63) - 1 else v + 2 * mesh.k[i % 2] for i, v in enumerate(r)]
            for t in rows:
                expect(centre_in(t, [box]), "%s by its circumcentre is not in its region %s" % (t, box))
                for i, v in enumerate(circumcentre(*(p[:2] for p in t)) * 2):
                    ties[i] += v == box[i]
        expect(min(ties) >= 3, "triangles beside a border that their circumcentre is on: %s" % ties)
        changed_command(base, d, one, two)


def command():
    """acutctl alone, and a holder without regions."""
    with Folder() as base, Daemon(base, **SMALL) as d:
        pushed(d, survey(base), corner(base))
        one, two = job_of(d, 1), job_of(d, 2)
        out = changed_command(base, d, one, two)
        # In other formats; nothing; and what cannot be.
        fetch = ["fetch", str(two), "--changed-since"]
        d.ctl(*fetch, "1", "-o", os.path.join(base, "c.ply"), "--canonical", "--origin", "auto").ok()
        empty = d.ctl(*fetch, "2", "-o", os.path.join(base, "none.ply")).ok()
        expect("nothing has changed" in empty.out + empty.err, empty.out + empty.err)
        for n in (1, 2):
            d.ctl("push", "tiny", corner(base, "tiny%d.xyz" % n, 50, seed=n)).ok()
            tiny = d.ctl("submit", "tiny", "--wait").ok().out.split()[0]
        said = d.ctl("fetch", tiny, "--changed-since", "1", "-o", os.path.join(base, "tiny.ply")).ok().out
        expect("1 region is gone, with" in said and "; 0 hold" in said and "new: 1 region, with" in said, said)
        got = d.ctl(*fetch, "2", "--format", "null", "--json").ok().json()
        expect(got["changes"]["gone"] == 0 and got["changes"]["new_triangles"] == 0 and got["changes"]["kept"] > 0, got["changes"])
        expect(d.ctl("fetch", str(two), "--format", "null", "--json").ok().json()["changes"] is None, "null, not absent")
        refused(d.ctl(*fetch, "1", "-o", "-", "--format", "ply"), 2, "standard output")
        refused(d.ctl(*fetch, "1", "-o", out, "--resume"), 2, "--resume")
        refused(d.ctl(*fetch, "1", "-o", out, "--tile", "100"), 2, "--tile")
        refused(d.ctl(*fetch, "1", "-o", out, "--bbox", "0,0,9,9"), 2, "--bbox")
        refused(d.ctl(*fetch, "0", "-o", out), 2, "--changed-since")
        refused(d.ctl(*fetch, "1", "-o", out, "--no-clobber"), 2, "--no-clobber")
        os.unlink(out)
        refused(d.ctl(*fetch, "1", "-o", out, "--no-clobber"), 2, "--no-clobber", "changes.geojson")
        expect(not os.path.exists(out), "half an output")
        other = job_of(d, 1, "--class", "2-9")
        refused(d.ctl("fetch", str(other), "--changed-since", "2", "-o", out), 1, "no job of generation 2", "acutctl submit s --at 2")
        # One that never was: which there are, and which will do.
        refused(d.ctl(*fetch, "7", "-o", out), 4, "no generation 7", "it has 1 to 2", "--changed-since 1 can be had")
        refused(d.ctl("fetch", str(other), "--changed-since", "7", "-o", out), 4, "it has 1 to 2", "fetch the whole mesh")
        expect(not os.path.exists(out), "an output of a refused fetch")
        # A record of the old mesh is lost: no changes, rather than wrong ones.
        plan = os.path.join(base, "state", "plans", "plan-%d" % one)
        size = os.path.getsize(plan)
        os.truncate(plan, size - 104)
        refused(d.ctl(*fetch, "1", "-o", out), 1, "no job of generation 1")
        d.ctl("rm", str(one)).ok()
        refused(d.ctl(*fetch, "1", "-o", out), 1, "no job of generation 1")
        job_of(d, 1, "--new")
        d.ctl(*fetch, "1", "-o", out).ok()


def pruned():
    """A pruned generation cannot be the base: the error offers the generations that exist."""
    with Folder() as base, Daemon(base, **SMALL) as d:
        pushed(d, survey(base), corner(base))
        pushed(d, corner(base, "third.xyz", 200, 500.0, 9))
        out = os.path.join(base, "out.ply")
        one, two, three = job_of(d, 1), job_of(d, 2), job_of(d, 3)
        d.ctl("dataset", "prune", "s", "--before", "3").ok()
        # Its mesh is known all the same, as long as its job is.
        d.ctl("fetch", str(three), "--changed-since", "1", "-o", out).ok()
        r = d.ctl("fetch", str(one), "--format", "null")
        refused(r, 4, "generation 1 of the dataset s was pruned", "it has generations 3 to 3")
        expect("manifest" not in r.err, "a file of the daemon's own is named: " + r.err)
        d.ctl("rm", str(one)).ok()
        r = d.ctl("fetch", str(three), "--changed-since", "1", "-o", out)
        refused(r, 1, "generation 1 of s was pruned", "generations 3 to 3", "--changed-since 2 can be had")
        expect("submit" not in r.err, "told to make what cannot be made: " + r.err)
        d.ctl("fetch", str(three), "--changed-since", "2", "-o", out).ok()
        d.ctl("rm", str(two)).ok()
        refused(d.ctl("fetch", str(three), "--changed-since", "2", "-o", out), 1, "was pruned", "fetch the whole mesh")


if __name__ == "__main__":
    e2e.main(follows, selected, goes_on, command, beside_borders, pruned)
