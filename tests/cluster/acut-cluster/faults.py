"""Faults of single tasks: one system call fails (strace), a task is killed, every task runs several times at once, files come late,
the disk is full. The run ends with the mesh of a daemon, or it refuses with a reason and goes on afterwards; no input changes,
nothing that a record does not name is left but of tasks that were killed, and nothing at all after clean.

Names as arguments run these cases only. ACUT_CLUSTER_FAULTS: how many calls fail (120); ACUT_CLUSTER_KILLS: how many tasks are killed (40); ACUT_FAULT_SEED.
"""
import errno
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import time

from cluster_tasks import Tasks, stl_triangles
from e2e import ACUTCTL, SYNTH, VERIFY, Folder, expect, main, run, unavailable

CALLS = (("pwrite64", "ENOSPC"), ("pwrite64", "EIO"), ("pwrite64", "EDQUOT"), ("write", "ENOSPC"), ("fsync", "EIO"), ("linkat", "EIO"),
         ("unlinkat", "EIO"), ("openat", "EIO"), ("openat", "ENOENT"), ("openat", "ESTALE"), ("openat", "EMFILE"), ("pread64", "EIO"),
         ("pread64", "ESTALE"), ("mkdirat", "ENOSPC"), ("renameat,renameat2,rename", "EIO"), ("newfstatat", "ESTALE"), ("ftruncate", "EIO"))
STATUS = {1, 2, 4, 74, 75, 76, 77}
SEED = int(os.environ.get("ACUT_FAULT_SEED", "1"))
FILES = 5
LATE = os.environ.get("ACUT_LATE_LIBRARY")


def number(name, preset):
    return int(os.environ.get(name, preset))


def sums(files):
    got = []
    for path in files:
        with open(path, "rb") as f:
            got.append((hashlib.sha256(f.read()).hexdigest(), os.stat(path).st_mtime_ns))
    return got


class Surveys:
    """Runs over the same inputs, with the mesh that they must have."""

    def __init__(self, base):
        self.base, self.n = base, 0
        os.mkdir(base + "/in")
        self.files = ["%s/in/%d.las" % (base, i) for i in range(FILES)]
        for i, path in enumerate(self.files):
            run([SYNTH, "--points", "6000", "--seed", str(i + 1), "--origin", "%d,5400000" % (500000 + 22 * i), path]).ok()
        run([ACUTCTL, "mesh", *self.files, "-o", base + "/daemon.stl", "--origin", "auto"]).ok()
        got = run([ACUTCTL, "mesh", *self.files, "-o", base + "/daemon.ply", "--canonical", "--json"]).ok().json()
        self.want, self.sums = (got["digest"], got["vertex_digest"]), sums(self.files)

    def begin(self, *options, points="8000", patience="0.3", folder=None, shared=False):
        """`shared`: outputs that all tasks of gather write."""
        self.n += 1
        self.out = "%s/out%d.ply" % (self.base, self.n)
        self.stl = "%s/out%d.stl" % (self.base, self.n) if shared else None
        outputs = ["-o", self.out, "-o", self.stl, "--origin", "auto"] if shared else ["-o", self.out, "--canonical"]
        return Tasks([*self.files, *outputs, "--task-points", points, "--task-memory", "64M", *options],
                     "%s/work%d" % (folder or self.base, self.n), "%s/script%d" % (self.base, self.n),
                     {"ACUT_CLUSTER_PATIENCE": patience} if patience else {})

    def check(self, tasks, unnamed=False):
        expect(tasks.digests() == self.want, "another mesh: %s, not %s" % (tasks.digests(), self.want))
        if self.stl:
            run([VERIFY, self.out, *self.files]).ok()
            expect(stl_triangles(self.stl) == stl_triangles(self.base + "/daemon.stl"), "the STL has other triangles")
        else:
            with open(self.out, "rb") as a, open(self.base + "/daemon.ply", "rb") as b:
                expect(a.read() == b.read(), "the output is another one")
        expect(sums(self.files) == self.sums, "an input has changed")
        expect(unnamed or not tasks.unnamed(), "no record names these files: %s" % tasks.unnamed())
        tasks.clean()
        left = [name for name in os.listdir(self.base) if name.startswith(".") or "acut-" in name or ".tmp" in name or ".part" in name]
        expect(not left, "left behind: %s" % left)


def failing_calls():
    if not shutil.which("strace") or subprocess.run(["strace", "-qq", "-o", "/dev/null", "true"]).returncode:
        unavailable("strace does not work here")
    felt = {}
    with Folder() as base:
        surveys, rand, left = Surveys(base), random.Random(SEED), number("ACUT_CLUSTER_FAULTS", 120)
        while left > 0:
            tasks, removed = surveys.begin(*rand.choice(((), ("--sort",)))), True
            for phase, i in tasks.tasks:
                for _ in range(2 if left > 0 else 0):
                    left -= 1
                    call, error = rand.choice(CALLS)
                    first = rand.choice((1, 1, 2, 2, 3, 4, 5, 7, 10, 14, 20))
                    inject = "inject=%s:error=%s:when=%d%s" % (call, error, first, rand.choice(("", "+", "..%d" % (first + 3))))
                    status, text = tasks.end(tasks.start(phase, i, prefix=["strace", "-f", "-qq", "-o", "/dev/null", "-e", "trace=" + call,
                                                                           "-e", inject]))
                    if status == 127 and "loading shared libraries" in text:
                        continue  # before it began
                    lines = [line for line in text.splitlines() if not line.startswith("hint: ")]
                    expect(status == 0 or (status in STATUS and lines and lines[-1].startswith("acut-task: ")),
                           "%s %d, %s: %d %s" % (phase, i, inject, status, text))
                    if status:
                        felt[call] = felt.get(call, 0) + 1
                    removed = removed and call not in ("unlinkat", "linkat")
                tasks.task(phase, i)
            surveys.check(tasks, not removed)
    print("     tasks that failed with an error, by call: %s" % felt)
    expect(len(felt) >= 4, "few calls were felt: %s" % felt)


def killed_tasks():
    with Folder() as base:
        surveys, rand, left, killed = Surveys(base), random.Random(SEED), number("ACUT_CLUSTER_KILLS", 40), 0
        while left > 0:
            tasks = surveys.begin(*rand.choice(((), ("--sort",))))
            for phase, i in tasks.tasks:
                for _ in range(2):
                    left -= 1
                    p = tasks.start(phase, i)
                    time.sleep(rand.random() ** 2 * 0.15)
                    p.send_signal(signal.SIGKILL)
                    killed += tasks.end(p)[0] == -signal.SIGKILL
                tasks.task(phase, i)
            surveys.check(tasks, True)
    print("     %d tasks were killed" % killed)
    expect(killed > 5, "only %d tasks were killed" % killed)


def several_at_once():
    with Folder() as base:
        surveys = Surveys(base)
        for options, points in ((("--sort",), "8000"), ((), "3000")):
            tasks = surveys.begin(*options, points=points, patience=None)
            for phase, i in tasks.tasks:
                for p in [tasks.start(phase, i) for _ in range(4)]:
                    status, text = tasks.end(p)
                    expect(status == 0, "%s %d ended with %d: %s" % (phase, i, status, text))
            surveys.check(tasks)


def files_come_late():
    """A record and its files appear while the task that needs them waits."""
    with Folder() as base:
        surveys = Surveys(base)
        tasks = surveys.begin(patience="60")
        before, last = None, None
        for phase, i in tasks.tasks:
            if before and before != phase:
                away = "%s/done/%s" % (base, last)
                os.makedirs(os.path.dirname(away), exist_ok=True)
                os.rename("%s/done/%s" % (tasks.work[0], last), away)
                p = tasks.start(phase, i)
                time.sleep(0.5)
                os.rename(away, "%s/done/%s" % (tasks.work[0], last))
                status, text = tasks.end(p)
                expect(status == 0, "%s %d ended with %d: %s" % (phase, i, status, text))
            else:
                tasks.task(phase, i)
            before, last = phase, "%s-%d" % (phase, i)
        surveys.check(tasks)


KINDS = {"inputs": "/in/", "records": "/done/", "segments": ".seg", "packs": "/mesh/pack-", "heads": "/head-", "plans": "/plan-",
         "lists": "/gather-", "manifests": "/dataset/manifest"}


SHARED = {"PLY": ".ply.", "STL": ".stl."}


def felt(path):
    """The kinds of files of which calls have failed."""
    if not os.path.exists(path):
        return set()
    with open(path) as f:
        paths = f.read().split()
    os.unlink(path)
    return {kind for kind, text in {**KINDS, **SHARED}.items() if any(text in p for p in paths)}


def files_fail(surveys, call, errors, text, count=0, seconds=0.0, patience=None, shared=False):
    """A run of which each task feels that first, the tasks of a phase at once; those that fail run again without. Returns which kinds of
    files were felt, and what was said: {(phase, message)}."""
    tasks, said, log = surveys.begin("--sort", patience=patience, shared=shared), set(), surveys.base + "/felt"
    usual = tasks.env
    for phase in dict.fromkeys(phase for phase, _ in tasks.tasks):
        begun = []
        for i in (i for p, i in tasks.tasks if p == phase):
            tasks.env = {**usual, "LD_PRELOAD": LATE, "ACUT_LATE_FELT": log,
                         "ACUT_LATE": "%s %d %d %g %s" % (call, errors[i % len(errors)], count, seconds, text)}
            begun.append((i, tasks.start(phase, i)))
        tasks.env = usual
        for i, p in begun:
            status, out = tasks.end(p)
            if status:
                expect(status in STATUS and "acut-task: " in out, "%s %d: %d %s" % (phase, i, status, out))
                said.add((phase, out))
                tasks.task(phase, i)
    surveys.check(tasks)
    return felt(log), said


def late_or_stale():
    """A file that cannot be opened at first is waited for, with the preset patience. One that is stale while it is read, or is away for
    longer than the patience, fails the task, which names it. ACUT_CLUSTER_LATE: for how many seconds (0: once)."""
    with Folder() as base:
        surveys, seconds = Surveys(base), float(os.environ.get("ACUT_CLUSTER_LATE", "0"))
        for errors in ((errno.ESTALE, errno.ENOENT), (errno.ENOENT, errno.ESTALE)) if seconds else ((errno.ESTALE, errno.ENOENT), ):
            kinds, said = files_fail(surveys, "open", errors, "/in/|/work", 1, seconds)
            expect(not said, "opening fails for a time: %s" % said)
            expect(kinds == set(KINDS), "only these files were late: %s" % kinds)
        for kind, text in KINDS.items() if seconds else (("segments", ".seg"), ("packs", "/mesh/pack-")):
            kinds, said = files_fail(surveys, "read", (errno.ESTALE, ), text, 1)
            expect(kind in kinds, "%s are not read" % kind)
            expect(all(text.strip("/-") in out for _, out in said), "%s: %s" % (kind, said))
            print("     %s that are stale while they are read: %s" % (kind, sorted({phase for phase, _ in said})))
        kinds, said = files_fail(surveys, "open", (errno.ESTALE, ), "/mesh/pack-", 1 << 29, patience=None if seconds else "0.2")
        expect({phase for phase, _ in said} >= {"gather"} and all("pack-" in out for _, out in said), "packs: %s" % said)


def one_file_late():
    """Files that all tasks of gather write and finish gives their names, and that other nodes see late: they are waited for. One that is away for longer than the
    patience fails the task, which says so, and the next attempt goes on. ACUT_CLUSTER_LATE as above."""
    with Folder() as base:
        surveys, seconds = Surveys(base), float(os.environ.get("ACUT_CLUSTER_LATE", "0"))
        for errors in ((errno.ESTALE, errno.ENOENT), (errno.ENOENT, errno.ESTALE)) if seconds else ((errno.ESTALE, errno.ENOENT), ):
            kinds, said = files_fail(surveys, "open", errors, ".ply.|.stl.", 3, seconds, shared=True)
            expect(not said, "opening fails for a time: %s" % said)
            expect(kinds == set(SHARED), "only these files were late: %s" % kinds)
        for error in (errno.ENOENT, errno.ESTALE):
            kinds, said = files_fail(surveys, "open", (error, ), ".ply.", 1 << 29, patience=None if seconds else "0.2", shared=True)
            expect(kinds == {"PLY"} and {phase for phase, _ in said} == {"gather", "finish"}, "%s %s" % (kinds, said))
            expect(all(".ply" in out for _, out in said), "%s" % said)
            print("     files of several nodes that are away (%s): %s" % (errno.errorcode[error], sorted({phase for phase, _ in said})))


def full_disk():
    """The work folder is on a small file system, which is full in each phase once; what is there is not lost."""
    with Folder() as base:
        surveys, small = Surveys(base), base + "/small"
        os.mkdir(small)
        if os.getuid() or run(["mount", "-t", "tmpfs", "-o", "size=64M", "tmpfs", small]).status:
            unavailable("a small file system cannot be mounted here")
        try:
            tasks, refused = surveys.begin(folder=small), 0
            for phase, i in tasks.tasks:
                free = os.statvfs(small)
                with open(small + "/other", "wb") as f:
                    f.write(b"x" * max(0, free.f_bavail * free.f_frsize - 16384))
                status, text = tasks.end(tasks.start(phase, i))
                expect(status in (0, 74), "%s %d: %d %s" % (phase, i, status, text))
                expect(status == 0 or "space" in text, text)
                refused += status != 0
                os.unlink(small + "/other")
                tasks.task(phase, i)
            expect(refused >= 3, "the full disk was felt %d times" % refused)
            surveys.check(tasks)
        finally:
            run(["umount", small])


CASES = [several_at_once, files_come_late, late_or_stale, one_file_late, killed_tasks, failing_calls, full_disk]
if __name__ == "__main__":
    main(*[c for c in CASES if not sys.argv[1:] or c.__name__ in sys.argv[1:]])
