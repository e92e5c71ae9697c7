"""The same meshes and the same files on arm64 as on this machine: digests of every real file in two views, and every output format of
two of them, byte by byte. tests/platform/arm64 runs it after the suites. Environment: ACUT_ARM64 and ACUT_BUILD, the build folders."""
import hashlib
import json
import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e  # noqa: E402
import outputs  # noqa: E402
from e2e import expect  # noqa: E402

VIEWS = ((), ("--ground",), ("--planar", "--keep-withheld", "--keep-noise"))
SECOND = "las12_pdrf1_lake_103k.laz"  # beside a generated survey, in all formats


def program(build, name):
    return os.path.join(os.environ[build], name)


class Machine:
    """acutd and acutctl of one machine."""

    def __init__(self, base, build):
        self.base, self.build, self.folder = base, build, os.path.join(base, build)
        os.mkdir(self.folder)
        self.daemon = e2e.Daemon(self.folder, memory="64M")
        self.daemon.command[0] = program(build, "daemon/acutd")

    def ctl(self, *args):
        return e2e.run([program(self.build, "client/acutctl/acutctl"), *args], env={"ACUT_SOCKET": self.daemon.socket}, timeout=3600)

    def mesh(self, path, *options, out="mesh.ply"):
        """(what acutctl says of the mesh, the hash of each file of the output)"""
        folder = os.path.join(self.folder, "out")
        os.mkdir(folder)
        r = self.ctl("mesh", path, "-o", os.path.join(folder, out), "--json", "--no-progress", *options)
        said = json.loads(r.out.splitlines()[-1]) if r.out else {}
        got = {k: said.get(k) for k in ("points", "used", "vertices", "triangles", "digest", "vertex_digest")}
        files = {}
        for top, _, names in os.walk(folder, topdown=False):
            for name in names:
                with open(os.path.join(top, name), "rb") as f:
                    files[os.path.relpath(os.path.join(top, name), folder)] = hashlib.sha256(f.read()).hexdigest()
                os.unlink(os.path.join(top, name))
            os.rmdir(top)
        return r.status, got, files


def real_files():
    data = e2e.data_dir()
    if not data:
        print("skipped: real files: set ACUT_TEST_DATA")
        return
    for top, _, names in sorted(os.walk(os.path.join(data, "lidar"))):
        for name in sorted(names):
            if name.lower().endswith((".las", ".laz", ".xyz", ".txt", ".pts", ".ptx", ".csv")):
                yield os.path.join(top, name)


def machines(base):
    e2e.ACUTCTL = program("ACUT_BUILD", "client/acutctl/acutctl")  # Daemon and outputs ask with it
    return [Machine(base, build) for build in ("ACUT_BUILD", "ACUT_ARM64")]


def meshes_of_real_files():
    n = done = 0
    with e2e.Folder() as base:
        here, there = machines(base)
        with here.daemon, there.daemon:
            for path in real_files():
                for view in VIEWS:
                    want, got = here.mesh(path, *view), there.mesh(path, *view)
                    expect(got == want, "%s %s:\n%s here\n%s on arm64" % (path, " ".join(view), want, got))
                    n, done = n + 1, done + (want[0] == 0)
    expect(n > 0 or not e2e.data_dir(), "no real file was meshed")
    print("%d meshes, %d of them refused alike: digests and PLY files are the same" % (n, n - done))


def every_format():
    n = 0
    with e2e.Folder() as base:
        here, there = machines(base)
        with here.daemon, there.daemon:
            survey = os.path.join(base, "survey.las")
            e2e.run([program("ACUT_BUILD", "tools/acut-synth"), "--points", 20000, survey]).ok()
            data = e2e.data_dir()
            inputs = [survey] + ([os.path.join(data, "lidar", SECOND)] if data else [])
            for path in inputs:
                for name, words, end in outputs.formats():
                    words = [*words, *(["--assume-units", "m,m"] if path != survey else [])]
                    want, got = here.mesh(path, *words, out="m" + end), there.mesh(path, *words, out="m" + end)
                    expect(want[0] == 0, "%s of %s: status %d" % (name, path, want[0]))
                    expect(got == want, "%s of %s:\n%s here\n%s on arm64" % (name, path, want, got))
                    n += 1
    print("%d files in all formats: byte by byte the same" % n)


e2e.main(meshes_of_real_files, every_format)
