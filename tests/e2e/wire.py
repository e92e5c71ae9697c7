"""The second implementation against the first, without a daemon: a stream that the C code wrote is read here, and both detect a
change of any of its bytes. STREAM_SAMPLE names the program."""
import io
import os
import random
import subprocess

from e2e import Fault, expect, main, skip

try:
    import xxhash  # noqa: F401 (acut_wire needs it)
    import acut_wire
except ImportError as e:
    skip("python3-xxhash and python3-protobuf are needed: %s" % e)

SAMPLE = os.environ["STREAM_SAMPLE"]


def sample(*args):
    return subprocess.run([SAMPLE] + list(args), stdout=subprocess.PIPE, check=True).stdout


def reads_what_c_writes():
    mesh = acut_wire.Mesh(io.BytesIO(sample()))
    expect(len(mesh.triangles) == 4 and len(mesh.positions) == 5, "counts")
    expect(mesh.k == [4000000000, -7, 0] and mesh.unit_z == "m" and mesh.view == "all", "head")
    expect(mesh.ended == {2}, "final marks: %s" % mesh.ended)
    expect(mesh.report == '{"points":5}', "report")


def error_in_the_tail():
    try:
        acut_wire.Mesh(io.BytesIO(sample("no-space")))
    except acut_wire.JobFailed as e:
        expect(e.code == "no-space", e.code)
        return
    raise Fault("the error was not seen")


def reads_changes():
    mesh = acut_wire.Mesh(io.BytesIO(sample("changes")))
    b = mesh.base
    expect((mesh.kind, b.generation, b.job, b.kept, b.kept_triangles) == (3, 3, 7, 1, 4), "base")
    expect((b.old_digest[-1], b.old_vertex_digest[-1], b.digest[-1], b.vertex_digest[-1]) == tuple("2468"), "digests")
    expect(mesh.gone == {(-1 << 63, -3, 5, 7): (4, "%032x" % ((1 << 64) + 1)),
                         (5, -3, (1 << 63) - 1, 7): (5, "%032x" % ((2 << 64) + 2))}, "gone: %s" % mesh.gone)
    expect(sum(map(len, mesh.regions.values())) == 4 and len(mesh.regions) == 2, "regions")


def every_byte_counts():
    for args in ((), ("changes",)):
        every_byte_of(sample(*args))


def every_byte_of(whole):
    random.seed(7)
    for at in range(len(whole)):
        broken = bytearray(whole)
        broken[at] ^= 1 << random.randrange(8)
        try:
            acut_wire.Mesh(io.BytesIO(bytes(broken)))
        except (acut_wire.Breach, ValueError):
            continue
        raise Fault("byte %d was changed and nobody saw it" % at)


def every_cut_counts():
    for args in ((), ("changes",)):
        every_cut_of(sample(*args))


def every_cut_of(whole):
    for n in range(len(whole)):
        try:
            acut_wire.Mesh(io.BytesIO(whole[:n]))
        except acut_wire.Breach:
            continue
        raise Fault("cut after %d bytes and nobody saw it" % n)


main(reads_what_c_writes, reads_changes, error_in_the_tail, every_byte_counts, every_cut_counts)
