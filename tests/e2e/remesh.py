"""Incremental re-meshing: whatever was pushed, replaced or reverted, the mesh is that of a build from scratch, and only domains
with changed input are made."""
import os
import struct

import e2e
from e2e import expect

POINTS = 200000
SAME = ("digest", "vertex_digest", "vertices", "triangles", "hull", "points", "used", "removed")


def synth(base, name, points, x, y, seed, *more):
    path = os.path.join(base, name)
    e2e.run([e2e.SYNTH, "--points", points, "--seed", seed, "--origin", "%d,%d,0" % (500000 + x, 5400000 + y), *more, path]).ok()
    return path


def changed(path, to, change):
    """A copy of a file whose records went through `change`: x, y, z, class, in numbers of the file."""
    with open(path, "rb") as f:
        data = bytearray(f.read())
    offset, = struct.unpack_from("<I", data, 96)
    length, = struct.unpack_from("<H", data, 105)
    count, = struct.unpack_from("<I", data, 107)
    for at in range(offset, offset + count * length, length):
        x, y, z = struct.unpack_from("<3i", data, at)
        x, y, z, data[at + 15] = change(x, y, z, data[at + 15])
        struct.pack_into("<3i", data, at, x, y, z)
    with open(to, "wb") as f:
        f.write(data)
    return to


class Grown:
    """A dataset, and the files that should be in it."""

    def __init__(self, d, name):
        self.d, self.name, self.files = d, name, []

    def mesh(self, what, most, view=()):
        """The job's report. At most this share or number of its domains may have been made."""
        got = self.d.ctl("submit", self.name, "--wait", "--json", *view).ok().json()
        want = self.d.ctl("mesh", "--format", "null", "--json", *view, *self.files).ok().json()
        for key in SAME:
            expect(got[key] == want[key], "%s: %s is %s, from nothing %s" % (what, key, got[key], want[key]))
        made = got["domains"] - got["domains_reused"]
        print("     %-28s %3d of %3d domains made" % (what, made, got["domains"]))
        expect(made <= (most if isinstance(most, int) else most * got["domains"]),
               "%s: %d of %d domains made" % (what, made, got["domains"]))
        return got

    def push(self, path, *options):
        self.files.append(path)
        self.d.ctl("push", *options, self.name, path).ok()


def side(points):
    return int((points / 8) ** 0.5)


def grow(base, d, name):
    whole, s = synth(base, name + "-whole.las", POINTS, 0, 0, 1), side(POINTS)
    few, g = POINTS // 100, Grown(d, name)
    g.push(whole)
    first = g.mesh("all", 1.0)
    expect(first["domains"] >= 6 and first["domains_reused"] == 0, "%d domains, %d reused" % (first["domains"], first["domains_reused"]))
    again = d.ctl("submit", name, "--new", "--wait", "--json").ok().json()
    expect(again["domains_reused"] == again["domains"], "the same once more: %d made" % (again["domains"] - again["domains_reused"]))
    g.push(synth(base, name + "-corner.las", few, 0, 0, 2))
    g.mesh("corner", 0.45)
    g.push(synth(base, name + "-far.las", few, s - 20, s - 20, 3))
    g.mesh("far corner", 0.45)
    g.push(synth(base, name + "-middle.las", few, s // 2 + 3, s // 2 + 5, 4))
    g.mesh("middle", 0.6)
    g.push(changed(g.files[1], os.path.join(base, name + "-low.las"), lambda x, y, z, c: (x, y, z - 5, c)))
    g.mesh("lower duplicates", 0.45)
    g.push(changed(g.files[1], os.path.join(base, name + "-high.las"), lambda x, y, z, c: (x, y, z + 5, c)))
    before = g.mesh("higher duplicates", 0.45)
    g.push(changed(g.files[2], os.path.join(base, name + "-noise.las"), lambda x, y, z, c: (x + 1, y, z, 7)))
    g.mesh("noise, which is left out", 0.45)
    # Taken back: all was made before.
    d.ctl("dataset", "revert", name).ok()
    g.files.pop()
    back = g.mesh("taken back", 1)
    expect(back["digest"] == before["digest"], "taken back: another digest")
    # What stands out of the hull is seen along all borders that run to infinity on that side: those of empty regions only.
    g.push(synth(base, name + "-beside.las", few, s + 40, s // 2, 5))
    g.mesh("beside the old box", 0.3)
    # Another delivery of the corner, a metre lower in one half.
    new = os.path.join(base, "other", os.path.basename(g.files[1]))
    os.makedirs(os.path.dirname(new), exist_ok=True)
    changed(g.files[1], new, lambda x, y, z, c: (x, y, z - 100 if x & 64 else z, c))
    d.ctl("push", "--replaces", g.files[1], name, new).ok()
    g.files[1] = new
    g.mesh("a file replaced", 0.45)
    return g


def small_domains():
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M", threads=1) as d:
        g = grow(base, d, "a")
        # Streams give the same mesh, from whole domains of any generation.
        job = d.ctl("submit", "a", "--wait", "--json").ok().json()
        got = d.ctl("fetch", str(job["job"]), "--format", "null", "--json").ok().json()
        expect(got["digest"] == job["digest"], "a stream of domains that are used again has another digest")
        # A cache that is gone costs time only.
        e2e.lose_domains(d)
        os.chown(os.path.join(d.cache, "domains"), os.stat(d.cache).st_uid, os.stat(d.cache).st_gid) # in its sandbox it has a user of its own
        got = d.ctl("fetch", str(job["job"]), "--format", "null", "--json").ok().json()
        expect(got["digest"] == job["digest"], "a stream of domains that were lost has another digest")
        again = d.ctl("submit", "a", "--new", "--wait", "--json").ok().json()
        expect(again["digest"] == job["digest"], "another digest")
        plan = d.ctl("plan", "a", "--json").ok().json()
        expect(plan["domains_reused"] == plan["domains"], "the plan finds %d of %d" % (plan["domains_reused"], plan["domains"]))
        expect(g.files, "no files")


def of_selections():
    """Domains of a view that selects points are reused, too, by the selected points."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M", threads=2) as d:
        g, s = Grown(d, "v"), side(POINTS)
        g.push(synth(base, "whole.las", POINTS, 0, 0, 1))
        view = ("--crop", "%d,%d,%d,%d" % (500000, 5400000, 500000 + s * 9 // 10, 5400000 + s))
        g.mesh("a crop", 1.0, view)
        g.push(synth(base, "corner.las", POINTS // 100, 0, 0, 2))
        g.mesh("a crop, grown", 0.45, view)
        # Outside of the crop nothing changes for it.
        g.push(synth(base, "out.las", POINTS // 100, s - 8, s - 60, 3))
        g.mesh("a crop, grown outside", 0.35, view)


e2e.main(small_domains, of_selections)
