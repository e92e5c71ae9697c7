"""Faults of single tasks: one system call fails (strace), a task is killed, every task runs several times at once, files come late,
the disk is full. The run ends with the mesh of a daemon, or it refuses with a reason and goes on afterwards; no input changes,
nothing that a record does not name is left but of tasks that were killed, and nothing at all after clean.

ACUT_CLUSTER_FAULTS: how many calls fail (120); ACUT_CLUSTER_KILLS: how many tasks are killed (40); ACUT_FAULT_SEED.
"""
import hashlib
import os
import random
import shutil
import signal
import subprocess
import time

from cluster_tasks import Tasks
from e2e import ACUTCTL, SYNTH, Folder, expect, main, run, unavailable

CALLS = (("pwrite64", "ENOSPC"), ("pwrite64", "EIO"), ("pwrite64", "EDQUOT"), ("write", "ENOSPC"), ("fsync", "EIO"), ("linkat", "EIO"),
         ("unlinkat", "EIO"), ("openat", "EIO"), ("openat", "ENOENT"), ("openat", "ESTALE"), ("openat", "EMFILE"), ("pread64", "EIO"),
         ("pread64", "ESTALE"), ("mkdirat", "ENOSPC"), ("renameat,renameat2,rename", "EIO"), ("newfstatat", "ESTALE"), ("ftruncate", "EIO"))
STATUS = {1, 2, 4, 74, 75, 76, 77}
SEED = int(os.environ.get("ACUT_FAULT_SEED", "1"))
FILES = 5


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
        got = run([ACUTCTL, "mesh", *self.files, "-o", base + "/daemon.ply", "--canonical", "--json"]).ok().json()
        self.want, self.sums = (got["digest"], got["vertex_digest"]), sums(self.files)

    def begin(self, *options, points="8000", patience="0.3", folder=None):
        self.n += 1
        self.out = "%s/out%d.ply" % (self.base, self.n)
        return Tasks([*self.files, "-o", self.out, "--canonical", "--task-points", points, "--task-memory", "64M", *options],
                     "%s/work%d" % (folder or self.base, self.n), "%s/script%d" % (self.base, self.n), {"ACUT_CLUSTER_PATIENCE": patience})

    def check(self, tasks, unnamed=False):
        expect(tasks.digests() == self.want, "another mesh: %s, not %s" % (tasks.digests(), self.want))
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
        for options, points in (((), "8000"), (("--sort",), "8000"), ((), "3000")):
            tasks = surveys.begin(*options, points=points)
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


if __name__ == "__main__":
    main(several_at_once, files_come_late, killed_tasks, failing_calls, full_disk)
