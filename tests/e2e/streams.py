"""Resumed streams: from any block, after the daemon was killed, with another memory, without its cache, byte for byte; refusals;
live streams of running jobs; readers that are slow, stop, or die."""
import os
import shutil
import signal
import struct

import e2e
from e2e import Daemon, Fault, Folder, expect

try:
    import acut_wire
    from acut_wire import Breach, Client, Mesh, PipeReader, Refused, pb, read_all
except ImportError as e:
    e2e.skip("python3-xxhash and python3-protobuf are needed: %s" % e)

SANITIZED = e2e.sanitized()
# With two threads, 24M means the smallest domains.
SMALL = {"memory": "24M", "threads": 2}
POINTS = 150000 if SANITIZED else 300000


def survey(base, points=POINTS, name="survey.las", seed=1, *more):
    path = os.path.join(base, name)
    e2e.run([e2e.SYNTH, "--points", str(points), "--seed", str(seed)] + list(more) + [path]).ok()
    return path


class Stream:
    """The frames of a fetch as they come: (type, bytes)."""

    def __init__(self, d, job, block=0, stream_id="", timeout=e2e.PATIENCE):
        self.c = Client(d.socket, timeout=timeout)
        self.fd = -1
        _, self.fd = self.c.ask("fetch", pb.Fetch(job=job, from_block=block, stream_id=stream_id))
        self.pipe = PipeReader(self.fd, timeout)

    def frame(self):
        header = read_all(self.pipe, 32)
        if not header:
            return None
        if len(header) < 32:
            raise Breach("half a header")
        kind, length = struct.unpack_from("<H", header, 6)[0], struct.unpack_from("<Q", header, 8)[0]
        payload = read_all(self.pipe, length)
        if len(payload) < length:
            raise Breach("half a frame")
        return kind, header + payload

    def frames(self, most=1 << 60):
        got = []
        while len(got) < most:
            f = self.frame()
            if f is None:
                break
            got.append(f)
        return got

    def close(self):
        self.c.close()
        if self.fd >= 0:
            os.close(self.fd)
        self.fd = -1

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self.close()


def fetch(d, job, block=0, stream_id=""):
    with Stream(d, job, block, stream_id) as s:
        return s.frames()


def id_of(frames):
    return "%016x%016x" % struct.unpack_from("<QQ", frames[0][1], 32 + 8)


def whole(frames):
    """A complete stream, checked by the second implementation; returns its digests."""
    class Bytes:
        def __init__(self):
            self.left = b"".join(b for _, b in frames)

        def read(self, n):
            out, self.left = self.left[:n], self.left[n:]
            return out

    m = Mesh(Bytes())
    return str(m.digest), str(m.vertex_digest)


def digests(frames):
    """The digests in the tail."""
    f = acut_wire.Fields(frames[-1][1][32:])
    f.take("8s4Q"), f.take("6i")
    return "%016x%016x" % f.take("QQ"), "%016x%016x" % f.take("QQ")


def failure(frames):
    """The error code in the tail; the stream must have no blocks."""
    expect([k for k, _ in frames] == [1, 3], "a refused stream has frames %s" % [k for k, _ in frames])
    f = acut_wire.Fields(frames[1][1][32:])
    failed, _ = f.take("B7s")
    f.take("4Q"), f.take("6i"), f.take("4Q")
    expect(failed == 1, "a tail that says nothing of a failure")
    return f.text()


def same(got, want, what):
    expect([k for k, _ in got] == [k for k, _ in want], "%s: frames %s, not %s" %
           (what, [k for k, _ in got], [k for k, _ in want]))
    for i, (g, w) in enumerate(zip(got, want)):
        expect(g == w, "%s: frame %d of %d differs" % (what, i, len(want)))


def goes_on(d, job, all_frames, blocks, what):
    """From each of these blocks: the head, then exactly the bytes of the uninterrupted stream."""
    for b in blocks:
        got = fetch(d, job, b, id_of(all_frames))
        same(got, all_frames[:1] + all_frames[1 + b:], "%s, from block %d" % (what, b))


def submit(d, *args):
    return int(d.ctl("submit", *args).ok().out.split()[0])


def done(d, job):
    return d.ctl("wait", str(job), "--json", timeout=600).ok()


def from_every_block():
    with Folder() as base, Daemon(base, **SMALL) as d:
        d.ctl("push", "s", survey(base)).ok()
        job = submit(d, "s")
        done(d, job)
        w = fetch(d, job)
        n = len(w) - 2
        expect(n > (4 if SANITIZED else 8), "only %d blocks" % n)
        shown = d.ctl("show", str(job), "--json").ok().json()
        expect(whole(w) == digests(w) == (shown["digest"], shown["vertex_digest"]), "%s, not %s" % (digests(w), shown))
        same(fetch(d, job), w, "a second fetch")
        same(fetch(d, job, 0, id_of(w)), w, "a fetch that names its stream")
        goes_on(d, job, w, [1, 2, n // 2, n - 1, n], "in peace")
        # The plan of another run, another budget, without the store: the same bytes.
        for memory, threads, lose in (("24M", 1, False), ("96M", 2, False), ("24M", 2, True), ("200M", 1, True)):
            d.stop(signal.SIGKILL)
            if lose:
                shutil.rmtree(d.cache)
            d = Daemon(base, memory=memory, threads=threads).start()
            goes_on(d, job, w, [0, 1, n // 2, n], "with memory %s, %d threads%s" %
                    (memory, threads, ", without the cache" if lose else ""))
        d.stop()


def what_cannot_go_on():
    with Folder() as base, Daemon(base, memory="256M", threads=1) as d:
        d.ctl("push", "s", survey(base)).ok()
        job, other = submit(d, "s"), submit(d, "s", "--every", "3")
        done(d, job), done(d, other)
        w = fetch(d, job)
        n = len(w) - 2
        expect(failure(fetch(d, other, 1, id_of(w))) == "stream-gone", "the stream of another job")
        expect(failure(fetch(d, other, 0, id_of(w))) == "stream-gone", "the stream of another job, from its start")
        with Stream(d, job, n + 1, id_of(w)) as s:
            expect(failure(s.frames()) == "stream-gone", "behind the end")
        expect(failure(fetch(d, job, 1 << 63, id_of(w))) == "stream-gone", "far behind the end")
        for block, word in ((1, ""), (0, "xyz"), (1, id_of(w)[:31])):
            try:
                fetch(d, job, block, word)
            except Refused as e:
                expect(e.code == "usage", "%s %r: %s" % (block, word, e))
            else:
                raise Fault("from %d of %r was not refused" % (block, word))
        same(fetch(d, job, n, id_of(w)), [w[0], w[-1]], "nothing was harmed")
        # Less memory than a region of the plan needs: another plan, and so another stream, of the same mesh.
        d.stop()
        with Daemon(base, **SMALL) as small:
            expect(failure(fetch(small, job, 1, id_of(w))) == "stream-gone", "with less memory")
            v = fetch(small, job)
            expect(id_of(v) != id_of(w) and len(v) > len(w) and whole(v) == digests(w), "with less memory: the mesh")
            same(fetch(small, job), v, "with less memory, again")
            goes_on(small, job, v, [1, (len(v) - 2) // 2], "with less memory")
        # Once smaller, always smaller: also with all the memory.
        with Daemon(base, memory="256M", threads=2) as large:
            same(fetch(large, job), v, "with more memory again")
            large.stop(signal.SIGKILL)
        plan = os.path.join(d.state, "plans", "plan-%d" % job)
        with open(plan, "r+b") as f:
            f.seek(-40, os.SEEK_END)
            byte = f.read(1)[0]
            f.seek(-40, os.SEEK_END)
            f.write(bytes([byte ^ 1]))
        with Daemon(base, memory="256M", threads=2) as large:
            expect(digests(fetch(large, job)) == digests(w), "with a damaged plan")
            large.ctl("rm", str(job)).ok()
            e2e.until(lambda: not os.path.exists(plan), "the plan of a removed job stays")


def killed_while_it_streams():
    """Daemon and reader of a live stream are killed again and again; the joined pieces are the uninterrupted stream."""
    with Folder() as base:
        d = Daemon(base, **SMALL).start()
        path = survey(base, 4 * POINTS)
        d.ctl("push", "s", path).ok()
        job, got = submit(d, "s"), []
        expect(os.path.isdir(os.path.join(d.state, "plans")), "no folder of plans")
        for step in (3, 5, 9):
            with Stream(d, job, max(len(got) - 1, 0), id_of(got) if got else "") as s:
                part = s.frames(1 + step)
            expect(not got or part[0] == got[0], "another head after the kill")
            got += part if not got else part[1:]
            d.stop(signal.SIGKILL)
            if step == 5:
                shutil.rmtree(d.cache)
            d = Daemon(base, memory="24M" if step == 3 else "96M", threads=2).start()
        with Stream(d, job, len(got) - 1, id_of(got)) as s:
            got += s.frames()[1:]
        done(d, job)
        same(fetch(d, job), got, "put together")
        shown = d.ctl("show", str(job), "--json").ok().json()
        expect(digests(got) == (shown["digest"], shown["vertex_digest"]), "digests")
        d.stop(signal.SIGKILL)


def state_of(d, job):
    return d.ctl("show", str(job), "--json").ok().json()["state"]


def first_block(gate, s):
    """Opens the gate for one domain after the other until the head and a block have come; returns them."""
    got, n = [], 0
    while len(got) < 2:
        gate.wait()
        # If this is too short on a slow machine, one more than necessary passes, of many.
        while len(got) < 2 and select_ready(s.fd, 0.3):
            got.append(s.frame())
            expect(got[-1] and got[-1][0] != 3, "the stream is over: all came at the end")
        if len(got) < 2:
            n += 1
            gate.close("renameat", "/domains/", 1)
    print("     the first block is there when %d domains are stored" % n)
    return got


def live():
    """The first blocks of a running job come before it is done; all of them are those of a later fetch. A fetch of a job that was
    just submitted waits, and gets messages of progress."""
    with Folder() as base:
        gate = e2e.Gate(base)
        with Daemon(base, **SMALL, env=gate.env) as d:
            d.ctl("push", "s", survey(base, 2 * POINTS)).ok()
            # No domain is stored but by leave, one after the other, until the first block is there.
            gate.close("renameat", "/domains/")
            job = submit(d, "s")
            with Stream(d, job) as s:
                head, first = first_block(gate, s)
                first = [head, first]
                expect([k for k, _ in first] == [1, 2], "%s" % [k for k, _ in first])
                expect(s.c.ask("wait", pb.Wait(job=job)).state == "meshing", "it is not being meshed when its first blocks are here")
                e2e.until(lambda: s.c.ping() and [p for p in s.c.progress if p.phase in ("select", "mesh")], "no progress of a job that runs")
                gate.open()
                rest = s.frames()
            same(fetch(d, job), first + rest, "the live stream")
            # The job is cancelled under its reader. A view that no domain was made for.
            gate.close("renameat", "/domains/")
            third = submit(d, "s", "--zmax", "3000000")
            with Stream(d, third) as s:
                first_block(gate, s)
                d.ctl("cancel", str(third)).ok()
                gate.open()
                was = done_state(d, third)
                expect(was == "cancelled", was)
                try:
                    tail = s.frames()
                    expect(tail and tail[-1][0] == 3 and tail[-1][1][32] == 1, "%s, and its tail" % was)
                except Breach:
                    pass  # a block was under way: the reason is on the socket


def done_state(d, job):
    d.ctl("wait", str(job), timeout=600)
    return state_of(d, job)


def temporary(d):
    return [n for n in os.listdir(os.path.join(d.cache, "tmp"))]


def slow_readers():
    """Readers stop, die, or take a little at a time: other jobs end meanwhile, and slow readers get their bytes."""
    with Folder() as base, Daemon(base, memory="32M", threads=2) as d:
        d.ctl("push", "s", survey(base)).ok()
        job = submit(d, "s")
        done(d, job)
        w = fetch(d, job)
        slow = [Stream(d, job) for _ in range(4)]
        for s in slow:
            expect(s.frame() == w[0], "head")
        running = submit(d, "s", "--every", "1", "--new")
        slow.append(Stream(d, running))
        expect(slow[-1].frame()[0] == 1, "head of the live one")
        # A little at a time, so that it never stands still; others end between its bytes.
        trickle = Stream(d, job)
        came = bytearray()
        for i in range(6):
            other = submit(d, "s", "--every", str(2 + i))
            for _ in range(4):
                came += os.read(trickle.fd, 4096) if select_ready(trickle.fd) else b""
            done(d, other)
            expect(fetch(d, other)[-1][1][32] == 0, "a job beside slow readers failed")
            came += os.read(trickle.fd, 4096) if select_ready(trickle.fd) else b""
        done(d, running)
        expect(len(came) < len(b"".join(b for _, b in w)), "the slow reader has all already: nothing was tested")
        # One dies, one closes its pipe only; the others read on.
        slow[0].close()
        os.close(slow[1].fd)
        slow[1].fd = -1
        v = fetch(d, running)
        for s, want in ((slow[2], w), (slow[3], w), (slow[4], v)):
            same(want[:1] + s.frames(), want, "read at last")
            s.close()
        all_bytes = b"".join(b for _, b in w)
        came += read_all(trickle.pipe, len(all_bytes) - len(came))
        expect(bytes(came) == all_bytes and not trickle.frame(), "the trickle differs")
        trickle.close()
        slow[1].close()
        d.ctl("ping").ok()

        def held():
            ledger = d.ctl("status", "--json").ok().json()["ledger"]
            return {k: v for k, v in ledger.items() if k in ("domains", "domain", "pipe", "emitter") and v}
        e2e.until(lambda: not held() and not temporary(d), lambda: "still held: %s %s" % (held(), temporary(d)))


def many():
    """A connection may have 64 streams. One more is refused, and the others continue."""
    with Folder() as base, Daemon(base, memory="96M", threads=2) as d:
        d.ctl("push", "s", survey(base)).ok()
        job = submit(d, "s")
        done(d, job)
        with Client(d.socket) as c:
            ends = [c.ask("fetch", pb.Fetch(job=job))[1] for _ in range(64)]
            try:
                c.ask("fetch", pb.Fetch(job=job))
                raise Fault("a 65th stream")
            except Refused as e:
                expect(e.code == "busy" and "64 streams" in str(e), str(e))
            for fd in ends:
                os.close(fd)
        whole(fetch(d, job))


def select_ready(fd, seconds=e2e.PATIENCE):
    import select
    return bool(select.select([fd], [], [], seconds)[0])


def splits(d, job):
    """The number of splits in the plan's file, and its size."""
    path = os.path.join(d.state, "plans", "plan-%d" % job)
    with open(path, "rb") as f:
        data = f.read()
    n = struct.unpack_from("<Q", data, 24)[0]
    # Behind the leaves: three records a split (kinds 3, 4, 4), and one a finished domain (5).
    kinds = list(data[(n + 1) * 104 + 6::104])
    expect(len(data) % 104 == 0 and kinds.count(4) == 2 * kinds.count(3) and set(kinds) <= {3, 4, 5},
           "%d bytes of a plan of %d regions" % (len(data), n))
    return kinds.count(3), (n + 1 + 3 * kinds.count(3)) * 104


def splits_while_it_runs():
    """A plan that was made with much memory is continued with little: regions are split while the job runs and a reader follows
    it. The splits stay for all later readers."""
    with Folder() as base:
        gate = e2e.Gate(base)
        d = Daemon(base, memory="256M", threads=1, env=gate.env).start()
        d.ctl("push", "s", survey(base, 4 * POINTS)).ok()
        d.ctl("push", "t", survey(base, 1000, "small.las")).ok()
        gone = submit(d, "t")
        done(d, gone)
        d.ctl("rm", str(gone)).ok()
        # It has its plan, and no domain yet.
        gate.close("renameat", "/domains/")
        job = submit(d, "s")
        gate.wait()
        expect(os.path.exists(os.path.join(d.state, "plans", "plan-%d" % job)), "no plan")
        d.stop(signal.SIGKILL)
        shutil.rmtree(d.cache)
        # Files without a job are removed after the start.
        stray = os.path.join(d.state, "plans", "plan-%d" % gone)
        shutil.copy(os.path.join(d.state, "plans", "plan-%d" % job), stray)
        d = Daemon(base, **SMALL).start()
        e2e.until(lambda: not os.path.exists(stray), "the plan of no job stays")
        with Stream(d, job) as s:
            w = s.frames()
        done(d, job)
        n, size = splits(d, job)
        expect(n > 4, "only %d splits" % n)
        shown = d.ctl("show", str(job), "--json").ok().json()
        expect(digests(w) == (shown["digest"], shown["vertex_digest"]), "digests")
        same(fetch(d, job), w, "again")
        d.stop(signal.SIGKILL)
        shutil.rmtree(d.cache)
        with Daemon(base, memory="256M", threads=2) as other:
            blocks = len(w) - 2
            goes_on(other, job, w, [0, blocks // 2, blocks], "after a restart")
            expect(splits(other, job) == (n, size), "the plan has changed")


if __name__ == "__main__":
    e2e.main(from_every_block, what_cannot_go_on, killed_while_it_streams, live, slow_readers, many, splits_while_it_runs)
