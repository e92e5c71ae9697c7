"""Nights of survey ingest, one after the other: files come into two drop folders, `acutctl ingest` takes them, and in most nights
something goes wrong. After each night the datasets have exactly what a model says (nights_model.py), and each command ended with
the exit status that the night allows. State and cache are on an ext4 of their own. Their first state is of an older format.

Each week the daemon is stopped, and all that it dates is moved back by seven days, so that jobs are forgotten after 30. Each month
old generations are pruned, an old dataset is removed, and the backup is restored on another daemon; a fresh daemon gets the same
files, and all three give the same digests. At the end memory and disk are level.

ACUT_NIGHTS: how many (16); ACUT_NIGHTS_MONTH: nights in a month (30, or half of them); ACUT_FAULT_SEED. ACUT_NIGHTS_OLD: 1 builds
an older revision from the history of git, in ACUT_FAULT_BUILD; a path names its build folder. The daemon and client of these two
revisions take turns.
"""
import collections
import contextlib
import fcntl
import json
import os
import random
import shutil
import signal
import sqlite3
import statistics
import subprocess
import tarfile
import threading
import time

import faults
import mounts
import power
from faults import Fault, Killed, Store, e2e, expect
from nights_model import Drop

HERE = os.path.dirname(os.path.abspath(__file__))
FORMATS = ("-G_VERSION = ", "--", "engine", "daemon")  # changes of the versions of files
MEMORY, BEYOND = 24 << 20, 32 << 20
SETTINGS = ("--keep-removed", "1s", "--space-wait", "1", "--disk", "40M", "--keep-free", "0")
CALLS = ("pwrite64", "fsync", "fdatasync", "renameat,renameat2", "unlinkat", "openat", "linkat")
FAILING = (("pwrite64", "ENOSPC"), ("pwrite64", "EIO"), ("fsync", "EIO"), ("fdatasync", "EIO"), ("renameat,renameat2", "EIO"),
           ("mkdirat", "ENOSPC"), ("unlinkat", "EIO"))
# What may go wrong, each once, and as many nights in which nothing does.
KINDS = ("killed", "killed_at_a_call", "client_killed", "client_killed_at_a_move", "power_cut", "full_disk", "failing_calls", "upgrade", "no_daemon",
         "two_passes")
QUIET = 6
MOUNTED = ("power_cut", "full_disk")
# A fault comes at a random moment, and may come too late to meet anything. A kind that never struck in so many nights tests nothing.
ENOUGH = 20
JOB_DAYS = 30
OLD_JOBS = {1, 2, 3, 4}  # of the older state


def older_program():
    """The build folder of the older revision, or None. It is the oldest one that reads all files of this one: the last change of a
    version on the way of first parents. Behind it no version changes, which is not so of the last change by date, on any branch."""
    wish = os.environ.get("ACUT_NIGHTS_OLD")
    if not wish:
        return None
    if wish != "1":
        return wish
    git = ["git", "-C", os.path.join(HERE, "..", "..")]
    older = subprocess.run([*git, "log", "-1", "--first-parent", "-m", "--format=%h", *FORMATS], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    name = older.stdout.decode().strip()
    archive = subprocess.run([*git, "archive", name], stdout=subprocess.PIPE, stderr=subprocess.PIPE) if name else older
    if not name or archive.returncode:
        print("skipped: upgrades from an older revision: the history of git is not here: %s" % archive.stderr.decode(errors="replace").strip())
        return None
    to = os.path.join(power.BUILD, "acut-" + name)
    if not os.path.exists(to + "/b/daemon/acutd"):
        shutil.rmtree(to, ignore_errors=True)
        os.makedirs(to)
        subprocess.run(["tar", "-x", "-C", to], input=archive.stdout, check=True)
        e2e.run(["meson", "setup", to + "/b", to, "-Dtests=false", "-Dscanner=disabled", "-Dsystemd=false"]).ok()
        e2e.run(["ninja", "-C", to + "/b", "daemon/acutd", "client/acutctl/acutctl"], timeout=3600).ok()
    return to + "/b"


def may_mount(base):
    """Why file systems cannot be mounted here; None if they can."""
    for tool in ("nbdkit", "nbdfuse", "fusermount3", "mkfs.ext4", "losetup"):
        if not shutil.which(tool):
            return "%s is not installed" % tool
    if not os.path.exists(os.path.join(power.BUILD, "write_log.so")):
        return "the plugin of nbdkit was not built"
    return mounts.unavailable_here(base)


class Place:
    """The disk of state and cache. `mounted` False: a folder."""

    def __init__(self, base, mounted):
        self.base, self.mount, self.mounted, self.image = base, os.path.join(base, "mnt"), mounted, os.path.join(base, "disk.image")
        os.mkdir(self.mount)
        if mounted:
            power.make_disk(self.image, 80 << 20)

    def up(self):
        if self.mounted:
            e2e.run(["mount", "-o", "loop," + power.OPTIONS, self.image, self.mount]).ok()

    def down(self):
        if self.mounted and os.path.ismount(self.mount):
            mounts.unmount(self.mount, self.image)


class World:
    def __init__(self, base, nights, month, rng):
        self.base, self.nights, self.month, self.rng = base, nights, month, rng
        self.statuses, self.kinds, self.struck = collections.Counter(), collections.Counter(), collections.Counter()
        self.deck, self.figures, self.took = [], [], collections.deque(maxlen=9)
        self.jobs, self.aged, self.peak, self.cuts, self.drills, self.upgrades = {}, 0, 0, 0, 0, 0
        reason = may_mount(base)
        if reason:
            print("skipped: nights of power cuts and full disks: %s" % reason)
            expect(not os.environ.get("ACUT_TEST_PRIVILEGED"), "they must be possible here: %s" % reason)
        self.possible = [k for k in KINDS if not reason or k not in MOUNTED]
        self.place = Place(base, not reason)
        self.place.up()
        with tarfile.open(os.path.join(HERE, "..", "fixtures", "state-8.tar.gz")) as tar:
            tar.extractall(os.path.join(base, "fixture"))
        shutil.copytree(os.path.join(base, "fixture", "state"), os.path.join(self.place.mount, "state"))
        with open(os.path.join(base, "fixture", "expected.json")) as f:
            self.expected = json.load(f)
        self.store = Store(base, state=os.path.join(self.place.mount, "state"), cache=os.path.join(self.place.mount, "cache"), args=SETTINGS)
        self.programs = [(e2e.ACUTD, e2e.ACUTCTL)]
        older = older_program()
        if older:
            self.programs.append((older + "/daemon/acutd", older + "/client/acutctl/acutctl"))
        self.bin = os.path.join(base, "bin")
        os.mkdir(self.bin)
        self.store.acutd, self.store.acutctl = self.bin + "/acutd", self.bin + "/acutctl"
        self.install(0)
        self.year, self.drops = Drop(base, rng, "year"), {}
        self.store.start()

    def install(self, program):
        """As dpkg does it: another file of the same name, while the daemon runs."""
        for path in self.programs[program]:
            to = os.path.join(self.bin, os.path.basename(path))
            shutil.copy(path, to + ".dpkg-new")
            os.rename(to + ".dpkg-new", to)
        self.program = program

    # ---- commands ----

    def ctl(self, *args, status=(0,)):
        r = self.store.ctl(*args)
        self.judge(args[0], r.status, status, r.out + r.err)
        return r

    def judge(self, what, got, allowed, said=""):
        expect(got in allowed, "%s: exit status %d, not %s\n%s" % (what, got, sorted(allowed), said))
        self.statuses[got] += 1
        return got

    def command(self, drop):
        return ["ingest", drop.dataset, drop.folder, "--settle", "0", "--json", *(["--replace"] if drop.replace else [])]

    def passes(self, also=()):
        """One over each folder. `also`: statuses that the fault of this night allows. Returns the statuses."""
        ended = set()
        for drop in self.today:
            begun = time.monotonic()
            ended.add(self.ctl(*self.command(drop), status={drop.status(), *also}).status)
            self.took.append(time.monotonic() - begun)
        return ended

    def moment(self):
        """Seconds until a fault comes. Most come while a pass runs, on fast machines and on busy ones."""
        return self.rng.uniform(0, 1.5 * statistics.median(self.took or [.04]))

    def start_pass(self, drop, prefix=()):
        want = drop.status()
        p = subprocess.Popen([*prefix, self.store.acutctl, *self.command(drop)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                             stderr=subprocess.DEVNULL, env=dict(os.environ, ACUT_SOCKET=self.store.socket))
        return p, want

    def note_job(self, job):
        """Once a job is acknowledged it is there until it is too old. Those of the older state have dates of their own."""
        if job["job"] not in OLD_JOBS:
            self.jobs.setdefault(job["job"], (self.aged, job["dataset"], job["digest"]))

    def note_memory(self):
        if self.store.alive() and not e2e.sanitized():
            with open("/proc/%d/status" % self.store.pid()) as f:
                self.peak = max([self.peak, *(int(line.split()[1]) << 10 for line in f if line.startswith("VmHWM:"))])

    def restart(self):
        self.note_memory()
        self.store.kill()
        self.store.start()

    def stop(self):
        self.note_memory()
        self.judge("acutd", self.store.stop(), (0,))

    # ---- nights: each returns whether its fault struck ----

    def quiet(self):
        return True

    def killed(self):
        timer = threading.Timer(self.moment() * len(self.today), self.store.kill_inner)
        timer.start()
        self.passes((69, 74))
        struck = not self.store.alive()
        timer.join()
        return struck

    def killed_at_a_call(self):
        self.stop()
        call, when = self.rng.choice(CALLS), self.rng.randrange(1, 25)
        try:
            self.store.start(prefix=["strace", "-f", "-qq", "-o", "/dev/null", "-e", "trace=" + call, "-e",
                                     "inject=%s:signal=KILL:when=%d" % (call, when)])
        except Killed:
            pass
        self.passes((69, 74))
        return not self.store.alive()

    def client_killed(self):
        ended = set()
        for drop in self.today:
            p, want = self.start_pass(drop)
            time.sleep(self.moment())
            p.kill()
            ended.add(self.judge("ingest", p.wait(), (want, -signal.SIGKILL)))
        return -signal.SIGKILL in ended

    def client_killed_at_a_move(self):
        ended = set()
        for drop in self.today:
            inject = "inject=renameat2:signal=KILL:when=%d" % self.rng.randrange(1, 4)
            p, want = self.start_pass(drop, ["strace", "-f", "-qq", "-o", "/dev/null", "-e", "trace=renameat2", "-e", inject])
            ended.add(self.judge("ingest", p.wait(e2e.PATIENCE), (want, -signal.SIGKILL, 128 + signal.SIGKILL)))
        return bool(ended & {-signal.SIGKILL, 128 + signal.SIGKILL})

    def power_cut(self):
        """Daemon and client stop at one moment, and the disk has what it had then: all up to its last flush, and of later writes
        any half of the sectors. What the drop folder shows as done was acknowledged by then; it is on another disk."""
        self.stop()
        self.place.down()
        shutil.copyfile(self.place.image, self.place.image + ".0")
        folder = os.path.join(self.base, "cut")
        os.mkdir(folder)
        disk = power.Disk(folder, image=self.place.image)
        disk.mount = self.place.mount
        with disk:
            self.store.start(env={})
            for drop in self.today:
                p, want = self.start_pass(drop)
                if drop is self.today[-1]:
                    time.sleep(self.moment())
                    p.send_signal(signal.SIGSTOP)
                    os.kill(self.store.pid(), signal.SIGSTOP)
                    cut = disk.logged()
                    p.kill()
                ended = self.judge("ingest", p.wait(e2e.PATIENCE), (want, -signal.SIGKILL))
            self.store.kill()
        image = power.Images(disk).at(cut, self.rng)
        with open(self.place.image, "wb") as f:
            f.write(image)
        shutil.rmtree(folder)
        self.cuts += 1
        self.place.up()
        return ended == -signal.SIGKILL

    def full_disk(self):
        """Often without a cache from which room could be made."""
        if self.rng.randrange(4):
            self.ctl("cache", "gc", "--all")
        s = os.statvfs(self.place.mount)
        other = os.path.join(self.place.mount, "other")
        with open(other, "wb", buffering=0) as f:
            with contextlib.suppress(OSError):  # the file system needs some of it itself
                os.posix_fallocate(f.fileno(), 0, max(s.f_bavail * s.f_bsize - (1 << 20), 4096))
            with contextlib.suppress(OSError):
                f.seek(0, os.SEEK_END)
                while f.write(bytes(4096)):
                    pass
            f.truncate(max(f.tell() - self.rng.randrange(40 << 10), 0))
        # The older revision may be ended by SIGBUS.
        ended = self.passes((69, 74) if self.program else (74,))
        expect(self.program or self.store.alive(), "acutd ended")
        os.unlink(other)
        return 74 in ended

    def failing_calls(self):
        self.stop()
        call, error = self.rng.choice(FAILING)
        inject = "inject=%s:error=%s:when=%d%s" % (call, error, self.rng.randrange(1, 25), self.rng.choice(["", "+"]))
        trace = os.path.join(self.base, "trace")
        try:
            self.store.start(prefix=["strace", "-f", "-qq", "-o", trace, "-e", "trace=" + call, "-e", inject])
        except Fault:
            # The older revision took some errors of the disk for damage.
            self.judge("acutd", self.store.process.returncode, (74, 78) if self.program else (74,), self.store.log_text())
        self.passes((69, 74, 75))
        with open(trace, errors="replace") as f:
            return "(INJECTED)" in f.read()

    def upgrade(self):
        """Another program in the place of this one, in the middle of a pass; its client may be the first that is used."""
        p, want = self.start_pass(self.today[0])
        time.sleep(self.moment())
        self.install((self.program + 1) % len(self.programs))
        struck = p.poll() is None
        self.stop()
        self.judge("ingest", p.wait(e2e.PATIENCE), (want, 69, 74, 75))
        self.store.start()
        self.upgrades += 1
        return struck

    def no_daemon(self):
        self.stop()
        return 69 in {self.ctl(*self.command(drop), status=(69,) if drop.waiting else (0,)).status for drop in self.today}

    def two_passes(self):
        ended = set()
        for drop in self.today:
            fd = os.open(drop.folder, os.O_RDONLY)
            fcntl.flock(fd, fcntl.LOCK_EX)
            ended.add(self.ctl(*self.command(drop), status=(75,)).status)
            os.close(fd)
        return ended == {75}

    def night(self, n):
        name = "month%02d" % (n // self.month + 1)
        if name not in self.drops:
            self.drops[name] = Drop(self.base, self.rng, name)
        self.today = [self.year, self.drops[name]]
        for drop in self.today:
            drop.deliver(n)
        if not self.deck:
            self.deck = self.possible + ["quiet"] * QUIET
            self.rng.shuffle(self.deck)
        kind = self.deck.pop()
        try:
            struck = getattr(self, kind)()
            if kind in ("killed", "killed_at_a_call", "power_cut", "failing_calls", "no_daemon") or not self.store.alive():
                self.restart()
            self.passes()  # the morning: nothing is wrong any more
            for drop in self.today:
                drop.settle()
                drop.check(self.ctl)
                if drop.live:
                    job = self.ctl("submit", drop.dataset, "--wait", "--json").json()
                    expect(job["points"] == drop.points(), "%d points are meshed, not %d" % (job["points"], drop.points()))
                    self.note_job(job)
            self.note_memory()
            if (n + 1) % 7 == 0:
                self.week()
            if (n + 1) % self.month == 0:
                self.end_of_month(n // self.month + 1)
        except Exception as e:
            raise Fault("night %d (%s): %s: %s\n%s" % (n + 1, kind, type(e).__name__, e, e2e.where(e)))
        self.kinds[kind] += 1
        self.struck[kind] += struck

    def check_struck(self):
        idle = ["%s in %d nights" % (k, n) for k, n in sorted(self.kinds.items()) if n >= ENOUGH and not self.struck[k]]
        expect(not idle, "faults that never struck: %s" % ", ".join(idle))

    # ---- weeks ----

    def week(self):
        """Seven days pass for all that has a date."""
        self.stop()
        left = [x for x in faults.leftovers(self.store) if x.endswith(".tmp")]
        expect(not left, "left behind: %s" % left)
        db = sqlite3.connect(os.path.join(self.store.state, "catalogue.db"))
        by = 7 * 86400 * 10**6
        db.execute("UPDATE job SET submitted_us = submitted_us - ?, finished_us = finished_us - ? * (finished_us > 0), sum = NULL", (by, by))
        db.commit()
        db.close()
        for top, _, names in os.walk(self.store.cache):
            for name in names:
                s = os.stat(os.path.join(top, name))
                os.utime(os.path.join(top, name), ns=(s.st_atime_ns - by * 1000, s.st_mtime_ns - by * 1000))
        self.aged += 7
        self.store.start()
        young = {j for j, (aged, _, _) in self.jobs.items() if self.aged - aged < JOB_DAYS}
        there = lambda: {row["job"] for row in map(json.loads, self.ctl("jobs", "--json").out.splitlines())}
        e2e.until(lambda: there() - young <= OLD_JOBS, lambda: "jobs that are too old: %s" % sorted(there() - young))
        expect(young <= there(), "jobs are lost: %s" % sorted(young - there()))
        self.jobs = {j: x for j, x in self.jobs.items() if j in young}
        number = self.rng.choice(sorted(young)) if young else None
        if number:
            got = self.ctl("show", str(number), "--json").json()
            expect(got["digest"] == self.jobs[number][2], "job %d has another mesh" % number)

    # ---- months ----

    def digests(self, ctl):
        jobs = [ctl("submit", d.dataset, "--new", "--wait", "--json").ok().json() for d in self.present()]
        if ctl == self.ctl:
            for job in jobs:
                self.note_job(job)
        return {job["dataset"]: faults.digests(job) for job in jobs}

    def present(self):
        return [d for d in (self.year, *self.drops.values()) if d.live]

    def end_of_month(self, month):
        gone = self.drops.get("month%02d" % (month - 3))
        if gone and gone.live:
            self.ctl("dataset", "rm", gone.dataset)
            self.jobs = {j: x for j, x in self.jobs.items() if x[1] != gone.dataset}
            gone.live = {}
        for drop in self.present():
            self.ctl("dataset", "prune", drop.dataset, "--keep", "5")
        removed = lambda: self.ctl("cache", "stat", "--json").json()["kinds"]["removed"]["entries"]
        e2e.until(lambda: removed() == 0, "removed datasets stay")
        self.ctl("cache", "verify")
        for drop in self.present():
            drop.check(self.ctl)
        want = self.digests(self.ctl)
        for name in ("valley", "ridge"):
            got = self.ctl("submit", name, "--wait", "--json").json()
            expect(got["digest"] == self.expected[name]["digest"], "%s of the older state has another mesh" % name)
            self.note_job(got)
        self.drill(want)
        self.measure(month)

    def drill(self, want):
        """A restore of the backup, and a daemon that gets the files for the first time."""
        backup, there = os.path.join(self.base, "backup"), os.path.join(self.base, "there")
        self.ctl("backup", backup)
        os.mkdir(there)
        shutil.copytree(backup, os.path.join(there, "state"))
        with Store(there, args=SETTINGS) as other:
            other.start()
            for drop in self.present():
                drop.check(other.ctl)
            expect(self.digests(other.ctl) == want, "the restored daemon has other meshes")
            self.judge("acutd", other.stop(), (0,))
        shutil.rmtree(there)
        os.mkdir(there)
        with Store(there) as other:
            other.start()
            for drop in self.present():
                other.ctl("push", drop.dataset, *drop.paths()).ok()
            expect(self.digests(other.ctl) == want, "a fresh daemon has other meshes")
            self.judge("acutd", other.stop(), (0,))
        shutil.rmtree(there)
        self.drills += 1

    def bytes_below(self, folder, begin=""):
        return sum(os.lstat(os.path.join(top, name)).st_size for top, _, names in os.walk(folder) for name in names if name.startswith(begin))

    def measure(self, month):
        """With the same program at all times."""
        self.install(0)
        self.stop()
        self.store.start()
        self.ctl("cache", "gc", "--all")
        self.digests(self.ctl)
        status, rows = self.ctl("status", "--json").json(), self.store.rows("datasets")
        state, manifests = (self.bytes_below(self.store.state, begin) for begin in ("", "manifest-"))
        self.figures.append({
            "points": sum(d["points"] for d in rows), "files": sum(d["files"] for d in rows), "datasets": sum(d["bytes"] for d in rows),
            "segments": sum(d["segments"] for d in rows), "manifests": manifests, "state": state, "cache": self.bytes_below(self.store.cache),
            "resident": status["rss_bytes"], "peak": self.peak, "descriptors": len(os.listdir("/proc/%d/fd" % self.store.pid()))})
        self.peak = 0
        print("month %2d: " % month + ", ".join("%s %d" % x for x in self.figures[-1].items()), flush=True)

    def level(self):
        """No growth from the second month on but by the points: 16 bytes each, half of that again for points that no
        generation has any more and no prune has taken, and 24 KB a segment at most; 500 bytes a file in a manifest, with its share of the log;
        20 bytes of finished domains a point."""
        f = self.figures
        for n, now in enumerate(f):
            expect(now["peak"] <= MEMORY + BEYOND, "month %d: %d bytes were resident" % (n + 1, now["peak"]))
            expect(now["datasets"] <= 24 * now["points"] + 24000 * now["segments"], "month %d: more in segments than points explain" % (n + 1))
            expect(now["manifests"] <= 500 * now["files"], "month %d: more in manifests than files explain" % (n + 1))
            expect(now["cache"] <= 20 * now["points"] + (256 << 10), "month %d: more in the cache than points explain" % (n + 1))
        others = [x["state"] - x["datasets"] - x["manifests"] for x in f]
        # The peak is that of meshes, which grow until they fill a part of the memory that is the same for all.
        for what, slack, values in (("state beside points and files", 256 << 10, others), ("descriptors", 24, [x["descriptors"] for x in f]),
                                    ("resident memory", 2 << 20, [x["resident"] for x in f]), ("peak memory", 6 << 20, [x["peak"] for x in f])):
            expect(max(values[2:], default=0) <= values[min(1, len(f) - 1)] + slack, "%s grows: %s" % (what, values))


def nights():
    faults.need_tools("strace")
    n, seed = faults.setting("ACUT_NIGHTS", 16), faults.setting("ACUT_FAULT_SEED", 1)
    month = faults.setting("ACUT_NIGHTS_MONTH", min(30, max(n // 2, 1)))
    print("%d nights, %d in a month, seed %d" % (n, month, seed), flush=True)
    begun = time.monotonic()
    os.environ.setdefault("ACUT_TEST_TMP", "/dev/shm" if os.access("/dev/shm", os.W_OK) else "/tmp")
    with e2e.Folder() as base:
        world = World(base, n, month, random.Random(seed))
        try:
            for i in range(n):
                world.night(i)
            world.level()
            world.check_struck()
            world.stop()
        except Exception:
            print(world.store.log_text())
            raise
        finally:
            world.store.kill()
            world.place.down()
        print("nights in which the fault struck: " + ", ".join("%s %d of %d" % (k, world.struck[k], n) for k, n in sorted(world.kinds.items())
                                                               if k != "quiet"))
        print("%d exit statuses as expected: %s" % (sum(world.statuses.values()), dict(sorted(world.statuses.items()))))
        print("%d files taken, %d refused; 0 lost, 0 doubled; %d power cuts, %d upgrades between %d programs, %d restores; %d points; %.0f s" %
              (sum(d.taken for d in [world.year, *world.drops.values()]), sum(d.refused for d in [world.year, *world.drops.values()]), world.cuts,
               world.upgrades, len(world.programs), world.drills, sum(d.points() for d in world.present()), time.monotonic() - begun))


if __name__ == "__main__":
    e2e.main(nights)
