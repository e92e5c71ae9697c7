"""The digest and the vertex digest do not depend on the memory, the threads, or the order of points and files."""
import os
import struct

import e2e
from e2e import expect

POINTS = int(os.environ.get("ACUT_TEST_POINTS", "2000000"))
OVER = 32 << 20  # what VmHWM may exceed `memory` by


def las_parts(path):
    """Header bytes, offset of the points, record length, all records."""
    with open(path, "rb") as f:
        data = f.read()
    offset, = struct.unpack_from("<I", data, 96)
    length, = struct.unpack_from("<H", data, 105)
    count, = struct.unpack_from("<I", data, 107)
    return bytearray(data[:offset]), length, data[offset:offset + length * count], count


def las_write(path, head, length, records):
    head = bytearray(head)
    struct.pack_into("<I", head, 107, len(records) // length)
    with open(path, "wb") as f:
        f.write(head)
        f.write(records)


def shuffled(records, length, count):
    """The records in another order: with a stride, so that no neighbours stay neighbours."""
    step = 1000003
    out = bytearray(len(records))
    at = 0
    for i in range(count):
        out[i * length:(i + 1) * length] = records[at * length:(at + 1) * length]
        at = (at + step) % count
    return bytes(out)


def digests(base, inputs, memory, threads, view=()):
    with e2e.Daemon(base, memory=memory, threads=threads, name="-%s-%d" % (memory, threads)) as daemon:
        out = os.path.join(base, "out.obj")
        got = daemon.ctl("mesh", "--json", *view, "-o", out, *inputs).ok().json()
        os.unlink(out)
        limit = {"24M": 24 << 20, "64M": 64 << 20, "256M": 256 << 20, "1G": 1 << 30}[memory] + OVER
        peak = daemon.vmhwm()
        expect(peak <= limit, "VmHWM %d over %d with memory=%s" % (peak, limit, memory))
        print("%-5s %d threads: %s %s, %d domains, VmHWM %.1f MiB" % (memory, threads, got["digest"],
              got["vertex_digest"], got["domains"], peak / 2**20), flush=True)
        return got["digest"], got["vertex_digest"], got["triangles"]


def one_digest():
    with e2e.Folder() as base:
        survey = os.path.join(base, "survey.las")
        e2e.run([e2e.SYNTH, "--points", POINTS, "--seed", 7, survey]).ok()
        head, length, records, count = las_parts(survey)
        expect(count == POINTS, "%d points were generated" % count)
        expect(count % 1000003 != 0, "the stride must not divide the count")
        strided = os.path.join(base, "strided.las")
        las_write(strided, head, length, shuffled(records, length, count))
        parts = []
        for i in range(3):
            cut = [count * j // 3 * length for j in (i, i + 1)]
            parts.append(os.path.join(base, "part%d.las" % i))
            las_write(parts[-1], head, length, records[cut[0]:cut[1]])
        want = None
        for memory in ("24M", "64M", "256M", "1G"):
            for threads in (1, 2, 4):
                got = digests(base, [survey], memory, threads)
                want = want or got
                expect(got == want, "%s, %d threads: %s, not %s" % (memory, threads, got, want))
        for inputs, memory in (([strided], "64M"), (parts, "64M"), (parts[::-1], "24M"), ([parts[1], parts[2], parts[0]], "256M")):
            got = digests(base, inputs, memory, 2)
            expect(got == want, "%s: %s, not %s" % (inputs, got, want))
        # The ground alone, too: another view of the same points.
        ground = {digests(base, [survey], m, 2, ["--ground"]) for m in ("24M", "256M")}
        expect(len(ground) == 1 and want not in ground, "--ground: %s" % ground)


e2e.main(one_digest)
