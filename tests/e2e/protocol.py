"""The protocol, driven by the second implementation (acut_wire.py) against a real acutd: every request, and a mesh that is
checked from its bytes up, with a brute-force Delaunay test. Without acutctl and libacut."""
import os
import random
import struct
import sys
import time

import e2e
from e2e import Fault, Folder, expect, main, skip

try:
    import xxhash  # noqa: F401 (acut_wire needs it)
    import acut_wire
    from acut_wire import Client, Refused, pb
except ImportError as e:
    skip("python3-xxhash and python3-protobuf are needed: %s" % e)


def write_las(path, points, scale=0.01, offset=(500000.0, 5000000.0, 0.0), classes=None):
    """LAS 1.2, record format 0. `points`: raw integers x, y, z."""
    axes = list(zip(*points))
    header = bytearray(227)
    header[0:4] = b"LASF"
    header[24:26] = bytes((1, 2))
    struct.pack_into("<HHHIIBHI", header, 90, 1, 2026, 227, 227, 0, 0, 20, len(points))
    struct.pack_into("<5I", header, 111, len(points), 0, 0, 0, 0)
    struct.pack_into("<3d3d", header, 131, *([scale] * 3 + list(offset)))
    struct.pack_into("<6d", header, 179, *(f(axes[a]) * scale + offset[a] for a in range(3) for f in (max, min)))
    with open(path, "wb") as out:
        out.write(header)
        for i, (x, y, z) in enumerate(points):
            out.write(struct.pack("<iiiHBBbBH", x, y, z, 0, 0x09, classes[i] if classes else 2, 0, 0, 0))


def some_points(n, seed, step=1, size=100000):
    """Distinct positions on a grid of `step`."""
    rng = random.Random(seed)
    xy = set()
    while len(xy) < n:
        xy.add((rng.randrange(size) // step * step, rng.randrange(size) // step * step))
    return [(x, y, rng.randrange(3000)) for x, y in sorted(xy, key=lambda p: rng.random())]


def expect_refused(code, call, *args):
    try:
        call(*args)
    except Refused as e:
        expect(e.code == code, "refused with %s, not %s: %s" % (e.code, code, e))
        expect(e.error.message, "an error without a sentence")
        return e.error
    raise Fault("nothing was refused; %s was expected" % code)


def in_circle(a, b, c, p):
    """> 0: p lies inside the circle of a, b, c (counter-clockwise). Exact."""
    rows = [(q[0] - p[0], q[1] - p[1]) for q in (a, b, c)]
    (ax, ay), (bx, by), (cx, cy) = rows
    a2, b2, c2 = (x * x + y * y for x, y in rows)
    return ax * (by * c2 - b2 * cy) - ay * (bx * c2 - b2 * cx) + a2 * (bx * cy - by * cx)


def check_delaunay(mesh, points, brute):
    """`points`: absolute lattice numbers, distinct in xy."""
    got = sorted(tuple(p[a] + mesh.k[a] for a in range(3)) for p in mesh.positions)
    expect(got == sorted(points), "the vertices are not the points")
    n, h, t = len(points), mesh.hull, len(mesh.triangles)
    expect(t == 2 * n - 2 - h, "%d triangles of %d points with %d on the hull" % (t, n, h))
    edges = {}
    for a, b, c in mesh.triangles:
        for e in ((a, b), (b, c), (c, a)):
            expect(e not in edges, "edge %s twice" % (e,))
            edges[e] = {a, b, c} - set(e)
    border = sum((b, a) not in edges for a, b in edges)
    expect(border == h, "%d border edges, hull %d" % (border, h))
    xy = [p[:2] for p in mesh.positions]
    for tri in mesh.triangles:
        a, b, c = (xy[i] for i in tri)
        if brute:
            others = range(n)
        else:
            others = [next(iter(edges[e])) for e in ((tri[1], tri[0]), (tri[2], tri[1]), (tri[0], tri[2])) if e in edges]
        expect(all(in_circle(a, b, c, xy[p]) <= 0 for p in others), "triangle %s is not Delaunay" % (tri,))


BASE = None
DAEMON = None


def client(**kw):
    return Client(DAEMON.socket, **kw)


def small_requests():
    with client() as c:
        expect(c.hello.version_min <= 1 <= c.hello.version_max and c.hello.build, "Hello")
        expect(set(c.hello.features) >= {"push", "mesh", "mode", "decimal-comma", "override"}, str(c.hello.features))
        c.ping()
        status = c.ask("status_request", pb.StatusRequest())
        expect(status.pid == DAEMON.process.pid, "Status.pid")
        expect(status.memory == 256 << 20, "Status.memory")
        expect(status.connections >= 1 and status.ledger, "Status: %s" % status)
        expect_refused("not-found", c.ask, "wait", pb.Wait(job=1 << 40))
        expect_refused("not-found", c.ask, "fetch", pb.Fetch(job=1 << 40))
        expect_refused("not-found", c.ask, "cancel", pb.Cancel(job=1 << 40))
        expect_refused("not-found", c.ask, "submit", pb.Submit(view="view 1", dataset="nobody"))
        expect_refused("not-found", c.ask, "datasets_request", pb.DatasetsRequest(name="nobody"))
        expect_refused("not-found", c.ask, "plan_request", pb.PlanRequest(view="view 1", dataset="nobody"))
        c.ping()


def one_step():
    """Push, submit, fetch; the mesh is compared with brute force."""
    path = os.path.join(BASE, "small.las")
    points = some_points(400, 1)
    write_las(path, points)
    with client() as c:
        committed = c.push([path])
        expect(committed.points == 400 and committed.dataset, "PushCommitted: %s" % committed)
        job = c.ask("submit", pb.Submit(view="view 1", dataset=committed.dataset, bound=True))
        mesh = c.fetch(job.id)
        job = c.wait(job.id)
        expect(job.state == "done" and job.report.triangles == len(mesh.triangles), "Job: %s" % job)
        expect(job.report.digest == str(mesh.digest), "the report's digest")
        expect(job.report.vertex_digest == str(mesh.vertex_digest), "the report's vertex digest")
        expect(mesh.scales == ["0.01", "0.01"], "scales %s" % mesh.scales)
        shift = (50000000, 500000000, 0)
        check_delaunay(mesh, [tuple(p[a] + shift[a] for a in range(3)) for p in points], True)


def named_dataset():
    """Two pushes, two generations; the second mesh has all points; jobs and datasets are listed."""
    points = some_points(30000, 2, step=3)
    paths = [os.path.join(BASE, n) for n in ("a.las", "b.las", "c.las")]
    write_las(paths[0], points[:12000])
    write_las(paths[1], points[12000:20000])
    write_las(paths[2], points[20000:])
    with client() as c:
        first = c.push(paths[:2], dataset="survey")
        expect((first.dataset, first.generation) == ("survey", 1), "PushCommitted: %s" % first)
        expect(all(n <= 2 for n in c.durable.values()), "Durable: %s" % c.durable)
        second = c.push(paths[2:], dataset="survey")
        expect(second.generation == 2, "generation %d" % second.generation)
        plan = c.ask("plan_request", pb.PlanRequest(view="view 1", dataset="survey"))
        expect(plan.points == 30000 and plan.domains >= 1 and plan.memory_bytes, "Plan: %s" % plan)
        new = c.ask("submit", pb.Submit(view="view 1", dataset="survey"))
        same = c.ask("submit", pb.Submit(view="view 1", dataset="survey"))
        expect(new.id == same.id, "the same question gave another job")
        old = c.ask("submit", pb.Submit(view="view 1", dataset="survey", generation=1))
        expect(old.id != new.id, "another generation gave the same job")
        mesh = c.fetch(new.id)
        shift = (50000000, 500000000, 0)
        check_delaunay(mesh, [tuple(p[a] + shift[a] for a in range(3)) for p in points], False)
        expect(len(c.fetch(old.id).positions) == 20000, "points of generation 1")
        again = c.fetch(new.id)
        expect((again.stream_id, again.triangles) == (mesh.stream_id, mesh.triangles), "a second fetch differs")
        jobs, after = [], 0
        while True:
            page = c.ask("jobs_request", pb.JobsRequest(after=after, limit=1))
            jobs += [j.id for j in page.jobs]
            if not page.more:
                break
            after = jobs[-1]
        expect(jobs == sorted(jobs) and {new.id, old.id} <= set(jobs), "Jobs: %s" % jobs)
        named, counted = [c.ask("jobs_request", pb.JobsRequest(counts=counts)) for counts in (False, True)]
        expect(not named.rules and list(counted.rules) == "crop class noise returns withheld overlap z every thin duplicate line area error weight".split(),
               "rules: %s" % counted.rules)
        for a, b in zip(named.jobs, counted.jobs):
            removed = list(zip(counted.rules, b.report.removed_counts))
            expect([(r.rule, r.count) for r in a.report.removed] == removed and not b.report.removed, "removed: %s" % removed)
            a.report.ClearField("removed")
            b.report.ClearField("removed_counts")
            expect(a == b, "the same job: %s, %s" % (a, b))
        listed = c.ask("datasets_request", pb.DatasetsRequest())
        expect([d.points for d in listed.datasets if d.name == "survey"] == [30000], "Datasets: %s" % listed)
        c.ask("remove", pb.Remove(job=old.id))
        expect_refused("not-found", c.ask, "wait", pb.Wait(job=old.id))


def pipelined():
    """Requests sent before earlier ones are answered."""
    with client() as c:
        ids = [c.send("ping", pb.Ping()) for _ in range(50)]
        for request in reversed(ids):
            c.answer(request, "done")
        path = os.path.join(BASE, "pipe.las")
        write_las(path, some_points(1000, 3))
        begun = c.ask("push_begin", pb.PushBegin())
        with open(path, "rb") as f:
            probes = [c.send("probe", pb.Probe(push=begun.push, name="p%d" % i), f.fileno()) for i in range(8)]
            for request in probes:
                probed, _ = c.answer(request, "probed")
                expect(probed.points == 1000 and probed.format == "las", "Probed: %s" % probed)
        c.ask("push_abort", pb.PushAbort(push=begun.push))


def bad_inputs():
    """A broken file is an error of that file; the push goes on without it."""
    good, bad, empty = (os.path.join(BASE, n) for n in ("good.las", "bad.las", "empty.las"))
    write_las(good, some_points(100, 4))
    with open(good, "rb") as f:
        data = f.read()
    with open(bad, "wb") as f:
        f.write(data[:227 + 20 * 50 + 7])
    open(empty, "wb").close()
    with client() as c:
        begun = c.ask("push_begin", pb.PushBegin())
        with open(good, "rb") as g, open(bad, "rb") as b, open(empty, "rb") as e:
            error = None
            try:
                c.ask("probe", pb.Probe(push=begun.push, name="bad.las"), b.fileno())
            except Refused as refused:
                error = refused.error
            expect_refused("truncated", c.ask, "probe", pb.Probe(push=begun.push, name="empty.las"), e.fileno())
            c.ask("probe", pb.Probe(push=begun.push, name="good.las"), g.fileno())
            c.ask("push_plan", pb.PushPlan(push=begun.push))
            if error is None:
                try:
                    c.ask("file", pb.File(push=begun.push, name="bad.las"), b.fileno())
                except Refused as refused:
                    error = refused.error
            expect(error is not None and error.code == "truncated", "the cut file: %s" % error)
            expect("bad.las" in error.file, "the error does not name its file: %s" % error)
            done = c.ask("file", pb.File(push=begun.push, name="good.las"), g.fileno())
            expect(done.points == 100, "FileDone: %s" % done)
        committed = c.ask("push_commit", pb.PushCommit(push=begun.push))
        expect(committed.points == 100, "PushCommitted: %s" % committed)
        info_name = "info.las"
        with open(good, "rb") as g:
            probed = c.ask("info_request", pb.InfoRequest(name=info_name), g.fileno())
        expect(probed.name == info_name and list(probed.scale)[:1] == ["0.01"], "Probed: %s" % probed)
        expect(abs(probed.min[0] - 500000) < 1000, "Probed.min: %s" % probed)


def durable():
    """A client whose push stalls is told within seconds that its file is durable."""
    path = os.path.join(BASE, "durable.las")
    write_las(path, some_points(1000, 6))
    with client() as c, open(path, "rb") as f:
        begun = c.ask("push_begin", pb.PushBegin(dataset="durable"))
        number = c.last
        c.ask("probe", pb.Probe(push=begun.push, name="d"), f.fileno())
        c.ask("push_plan", pb.PushPlan(push=begun.push))
        c.ask("file", pb.File(push=begun.push, name="d"), f.fileno())
        expect_refused("not-found", c.ask, "submit", pb.Submit(view="view 1", dataset="durable"))
        deadline = time.monotonic() + e2e.PATIENCE
        while c.durable.get(number, 0) < 1:
            expect(time.monotonic() < deadline, "no Durable")
            time.sleep(0.2)
            c.ping()
        expect(c.ask("push_commit", pb.PushCommit(push=begun.push)).generation == 1, "PushCommitted")


def views():
    """Valid and invalid texts of views."""
    path = os.path.join(BASE, "classes.las")
    points = some_points(600, 8)
    write_las(path, points, classes=[2 if i % 3 else 7 for i in range(600)])
    with client() as c:
        name = c.push([path]).dataset
        for view, want in (("view 1", 400), ("view 1 class=2", 400), ("view 1 keep-noise", 600), ("view 1 class=7", 200)):
            mesh = c.fetch(c.ask("submit", pb.Submit(view=view, dataset=name)).id)
            expect(len(mesh.positions) == want, "%s: %d vertices" % (view, len(mesh.positions)))
            expect(mesh.view == view, "the stream says %s" % mesh.view)
        expect(c.ask("submit", pb.Submit(dataset=name)).view == "view 1", "the view of nothing asked for")
        for view in ("view 2", "view 1 ", "view 1 keep-noise keep-withheld", "view 1 class=3,2", "class=2"):
            try:
                c.ask("submit", pb.Submit(view=view, dataset=name))
            except Refused:
                continue
            raise Fault("the view %r was taken" % view)


def fetch_and_cancel(socket, gate, reads):
    """The end of a fetch whose job is cancelled before anything is read."""
    with Client(socket) as c, Client(socket) as other:
        gate.close("pread", ".seg", reads)
        job = c.ask("submit", pb.Submit(dataset="cancelled", fresh=True))
        _, pipe = c.ask("fetch", pb.Fetch(job=job.id))
        request = c.last
        gate.wait()
        other.ask("cancel", pb.Cancel(job=job.id))
        gate.open()
        mesh = None
        try:
            mesh = acut_wire.Mesh(acut_wire.PipeReader(pipe, e2e.PATIENCE))
            outcome = "whole, %d vertices" % len(mesh.positions)
        except acut_wire.JobFailed as e:
            outcome = e.code + " in the tail"
        except acut_wire.Breach:
            outcome = expect_refused("cancelled", c.answer, request).code + " on the socket"
        os.close(pipe)
        job = c.wait(job.id)
        expect(job.final and job.state == ("done" if mesh else "cancelled"), "%s: %s" % (outcome, job))
        return outcome


def cancel():
    """A cancelled job is final, and a client that fetches it is told so, in the stream or beside it."""
    path = os.path.join(BASE, "cancel.las")
    e2e.run([e2e.SYNTH, "--points", "600k", "--distribution", "uniform", path]).ok()
    with Folder() as base:
        gate = e2e.Gate(base) # a daemon in its sandbox writes below its own base only
        with e2e.Daemon(base, memory="32M", env=gate.env) as small:
            with Client(small.socket) as c:
                c.push([path], dataset="cancelled")
            outcomes = [fetch_and_cancel(small.socket, gate, reads) for reads in (0, 50, 200)]
    print("     " + ", ".join(outcomes))
    expect(all(o.startswith("cancelled") for o in outcomes), "nothing was cancelled: %s" % outcomes)


def whole():
    global BASE, DAEMON
    with Folder() as base, e2e.Daemon(base, memory="256M") as daemon:
        BASE, DAEMON = base, daemon
        try:
            main(small_requests, one_step, named_dataset, pipelined, bad_inputs, durable, views, cancel)
        except SystemExit as e:
            status = e.code
    sys.exit(status)


if __name__ == "__main__":
    whole()
