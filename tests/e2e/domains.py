"""Finished domains: what a mesh in one step writes of them, and that the number of domains in flight does not change the
result."""
import os
import re
import time

import e2e
from e2e import Daemon, Folder, expect, until

try:
    from acut_wire import Client, Mesh, PipeReader, pb
except ImportError as e:
    e2e.skip("python3-xxhash and python3-protobuf are needed: %s" % e)

SANITIZED = e2e.sanitized()
MIB = 1 << 20


def written(d):
    """The bytes that the daemon passed to write calls of any kind, including pipes."""
    with open("/proc/%d/io" % d.process.pid) as f:
        return int(re.search(r"wchar: (\d+)", f.read()).group(1))


def synth(base, name, points, *more):
    path = os.path.join(base, name)
    e2e.run([e2e.SYNTH, "--points", str(points)] + list(more) + [path]).ok()
    return path


def one_step_writes_no_domains():
    """A mesh in one step writes its points to the disk and the stream to the client, and nothing else of that size."""
    points = 200000 if SANITIZED else 600000
    with Folder() as base:
        path = synth(base, "s.las", points)
        for memory, threads in (("32M", 1), ("256M", 2)):
            with Daemon(base, memory=memory, threads=threads, name="-" + memory) as d:
                before = written(d)
                got = d.ctl("mesh", "--format", "null", "--json", path).ok().json()
                took = written(d) - before
                stream = 12 * got["vertices"] + 12 * got["triangles"]
                domains = stream // 2  # at least: positions and corners, of two bytes a number
                most = 2 * 17 * points + stream + domains // 3 + 2 * MIB  # a run may be merged once
                expect(took < most, "%s: %d bytes written of %d points, %d of the stream" % (memory, took, points, stream))
                before = written(d)
                d.ctl("push", "kept", path).ok()
                d.ctl("submit", "kept", "--wait").ok()
                kept = written(d) - before
                expect(kept > 16 * points + domains, "a submitted job wrote %d bytes: it kept no domains" % kept)
                print("%s: %.1f bytes a point of one step, %.1f of a job" % (memory, took / points, kept / points))


def a_stopped_reader_costs_no_disk():
    """While the mesh of one step fits its window, a reader that stops reading makes the daemon write nothing."""
    points = 100000 if SANITIZED else 300000
    with Folder() as base, Daemon(base, memory="256M", threads=2) as d, Client(d.socket) as c:
        path = synth(base, "s.las", points)
        want = d.ctl("mesh", "--format", "null", "--json", path).ok().json()
        job = c.ask("submit", pb.Submit(view="view 1", dataset=c.push([path]).dataset, bound=True))
        before = written(d)
        _, pipe = c.ask("fetch", pb.Fetch(job=job.id))
        until(lambda: written(d) - before > MIB // 2, "nothing is written for the pipe")
        time.sleep(8 if SANITIZED else 2)
        took = written(d) - before
        # A whole stream is 36 bytes a point; its pipe holds a MiB.
        expect(took < 2 * MIB, "%d bytes were written for a reader who does not read" % took)
        mesh = Mesh(PipeReader(pipe, e2e.PATIENCE))
        expect(str(mesh.digest) == want["digest"], "another digest: %s" % mesh.digest)
        os.close(pipe)


def many_sizes():
    """Clusters make large and small domains side by side: the window holds any number of small ones."""
    points = 60000 if SANITIZED else 400000
    with Folder() as base:
        path = synth(base, "c.las", points, "--distribution", "clustered")
        want = None
        for memory, threads in (("24M", 1), ("24M", 4), ("40M", 2), ("256M", 3)):
            with Daemon(base, memory=memory, threads=threads, name="-%s-%d" % (memory, threads)) as d:
                got = d.ctl("mesh", "--format", "null", "--json", path).ok().json()
                peak = got["peak_rss_bytes"]
                print("%s, %d threads: %d domains, VmHWM %.1f MiB" % (memory, threads, got["domains"], peak / MIB))
                got = got["digest"], got["vertex_digest"], got["triangles"], got["hull"]
                want = want or got
                expect(got == want, "%s, %d threads: %s, not %s" % (memory, threads, got, want))
                expect(SANITIZED or peak <= (int(memory[:-1]) + 32) * MIB, "VmHWM %d with %s" % (peak, memory))


def a_limit_of_file_sizes():
    """A write beyond the limit of file sizes fails that push, with a message; nobody else is affected."""
    limit = 2 * MIB
    with Folder() as base, Daemon(base, prefix=("prlimit", "--fsize=%d" % limit)) as d:
        large = synth(base, "large.las", 300000)
        small = synth(base, "small.las", 2000)
        got = d.ctl("push", "large", large)
        expect(got.status == 74 and "File too large" in got.err, "status %d: %s" % (got.status, got.err))
        expect(d.process.poll() is None, "acutd has ended\n" + d.log_text())
        d.ctl("mesh", "--format", "null", small).ok()


e2e.main(one_step_writes_no_domains, a_stopped_reader_costs_no_disk, many_sizes, a_limit_of_file_sizes)
