"""Power cuts of a real acutd: ext4 on a block device that logs every write and flush (write_log.c). After the work, disks are
made as a cut at a random moment may leave them: with all writes up to the last flush before it, and a random half of the
512-byte sectors of each later write, in any order. Each disk is mounted and acutd started on it: all that was acknowledged by
then is there, and the rest of the work can be repeated.

Two control runs must lose data: without any fsync, and without fsync of folders (no_sync.c). There, images whose file system
does not mount are counted separately.

ACUT_FAULT_POWER: how many cuts (50), with a tenth of that for each control; ACUT_FAULT_SEED.
"""
import os
import random
import shutil
import struct
import subprocess
import tempfile
import threading
import time

import faults
import mounts
from faults import Acks, Fault, Inputs, Killed, Store, e2e, expect

BUILD = os.environ.get("ACUT_FAULT_BUILD", ".")
SIZE = 48 << 20
RECORD = struct.Struct("<IIQ")
SECTOR = 512
OPTIONS = "commit=300,noatime"
LEAST = 6  # the work is done at least this many times, also on slow machines


def make_disk(image, size):
    with open(image, "wb") as f:
        f.truncate(size)
    e2e.run(["mkfs.ext4", "-q", "-E", "lazy_itable_init=0,lazy_journal_init=0", "-m", "0", image]).ok()


class Disk:
    """ext4 on a loop device on nbdfuse on nbdkit with the plugin. `image`: one that is there already."""

    def __init__(self, base, size=SIZE, plugin=None, image=None):
        self.base, self.image, self.log = base, image or os.path.join(base, "disk"), os.path.join(base, "log.bin")
        self.mount, self.node = os.path.join(base, "mnt"), os.path.join(base, "node")
        self.undo = []
        if not image:
            make_disk(self.image, size)
        self.plugin = plugin or [os.path.join(BUILD, "write_log.so"), "file=" + self.image, "log=" + self.log]

    def __enter__(self):
        try:
            self.attach()
        except BaseException as e:
            self.__exit__(e)
            raise
        return self

    def attach(self):
        socket = os.path.join(self.base, "nbd.sock")
        self.spawn(["nbdkit", "-f", "-U", socket, *self.plugin], lambda: os.path.exists(socket))
        with open(self.node, "wb"):
            pass
        self.spawn(["nbdfuse", self.node, "--unix", socket], lambda: os.stat(self.node).st_size > 0)
        self.undo.append(["fusermount3", "-u", self.node])
        loop = e2e.run(["losetup", "-f", "--show", self.node]).ok().out.strip()
        self.undo.append(["losetup", "-d", loop])
        os.makedirs(self.mount, exist_ok=True)
        e2e.run(["mount", "-o", OPTIONS, loop, self.mount]).ok()
        self.undo.append(["umount", self.mount])

    def spawn(self, args, ready):
        p = subprocess.Popen(args, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.undo.append(p)
        deadline = time.monotonic() + 100
        while not ready():
            expect(p.poll() is None and time.monotonic() < deadline, "%s did not start" % args[0])
            time.sleep(0.02)

    def __exit__(self, *exc):
        stuck = []
        for step in reversed(self.undo):
            if isinstance(step, list):
                if not mounts.succeeds(step):
                    stuck.append(" ".join(step))
            else:
                step.terminate()
                try:
                    step.wait(60)
                except subprocess.TimeoutExpired:
                    step.kill()
                    step.wait()
        expect(not stuck or any(exc), "these never succeeded: %s" % ", ".join(stuck))

    def logged(self):
        return os.stat(self.log).st_size


class Timed(Acks):
    """Acknowledgements, each with the length of the log when it came."""

    def __init__(self, disk):
        super().__init__()
        self.disk, self.history = disk, []

    def note(self):
        with self.lock:
            self.history.append((self.disk.logged(), dict(self.generation), dict(self.jobs)))

    def at(self, length):
        """The acknowledgements that had come when the log had this length."""
        acks = Acks()
        for at, generation, jobs in self.history:
            if at > length:
                break
            acks.generation, acks.jobs = dict(generation), dict(jobs)
        return acks


def play(base, inputs, seconds, env=None):
    """The work on a disk. Returns the disk with its first state, the acknowledgements, and the range of the log for cuts."""
    os.mkdir(base)
    disk = Disk(base)
    shutil.copy(disk.image, disk.image + ".0")
    with disk, Store(base, state=os.path.join(disk.mount, "state"), cache=os.path.join(disk.mount, "cache")) as store:
        acks = Timed(disk)
        store.start(env=env)
        # After some time the log of the catalogue is written from its beginning again, and does not grow any more.
        for i in range(90):
            store.ctl("dataset", "create", "c%d" % i, "--scale", "0.01").ok()
        acks.note()
        begin, since, n = disk.logged(), time.monotonic(), 0
        while n < LEAST or time.monotonic() - since < seconds:
            work_noted(store, inputs, acks, "p%d" % n)
            n += 1
        store.kill()
        end = disk.logged()
    return disk, acks, begin, end


def work_noted(store, inputs, acks, name):
    plain = store.ctl

    def ctl(*args, **kw):
        acks.note()  # what the previous command got
        return plain(*args, **kw)

    store.ctl = ctl
    try:
        faults.work(store, inputs, acks, name)
    finally:
        store.ctl = plain
    acks.note()


def records(path):
    """(place in the log, kind, offset, bytes)"""
    with open(path, "rb") as f:
        data = f.read()
    at, out = 0, []
    while at + RECORD.size <= len(data):
        kind, n, offset = RECORD.unpack_from(data, at)
        out.append((at, kind, offset, data[at + RECORD.size:at + RECORD.size + n]))
        at += RECORD.size + n
    return out


class Images:
    """Disks after cuts, in the order of time: the image of flushed writes is kept, and later ones are added."""

    def __init__(self, disk):
        with open(disk.image + ".0", "rb") as f:
            self.safe = bytearray(f.read())
        self.records, self.next, self.open = records(disk.log), 0, []

    def put(self, image, offset, data):
        image[offset:offset + len(data)] = data

    def at(self, cut, rng):
        while self.next < len(self.records) and self.records[self.next][0] < cut:
            _, kind, offset, data = self.records[self.next]
            if kind == 2:
                for o, d in self.open:
                    self.put(self.safe, o, d)
                self.open = []
            elif kind == 3:
                self.put(self.safe, offset, data)
            else:
                self.open.append((offset, data))
            self.next += 1
        image = bytearray(self.safe)
        for offset, data in self.open:
            for i in range(0, len(data), SECTOR):
                if rng.random() < 0.5:
                    self.put(image, offset + i, data[i:i + SECTOR])
        return image


class Unmountable(Exception):
    pass


def one_cut(base, image, acks, inputs, name, cut, quiet):
    path, mount = os.path.join(base, "image"), os.path.join(base, "mnt")
    with open(path, "wb") as f:
        f.write(image)
    os.mkdir(mount)
    if e2e.run(["mount", "-o", "loop," + OPTIONS, path, mount]).status:
        raise Unmountable()
    try:
        with Store(base, state=os.path.join(mount, "state"), cache=os.path.join(mount, "cache")) as store:
            store.quiet = quiet
            try:
                store.start()
                then = acks.at(cut)
                then.check(store)
                last = sorted(then.generation, key=lambda n: int(n[1:]))[-1:]
                for n in last:
                    faults.work(store, inputs, then, n)
                faults.work(store, inputs, then, name)
                store.stop()
            except (Killed, subprocess.TimeoutExpired) as e:
                raise Fault("acutd ended or hangs: %s\n%s" % (e, store.log_text()))
            finally:
                store.kill()
            left = faults.leftovers(store)
            expect(not left, "left behind: %s" % left)
            return store.starts, then.checked
    finally:
        mounts.unmount(mount, path)
        shutil.rmtree(base, ignore_errors=True)


def cuts(base, played, n, rng, quiet=False):
    """Losses, images that did not mount, starts, acknowledgements checked."""
    disk, acks, begin, end = played
    images, lost, unmounted, starts, checked, made = Images(disk), 0, 0, [], 0, 0
    lock = threading.Lock()
    points = iter(sorted(rng.randrange(begin, end + 1) for _ in range(n)))

    def some():
        nonlocal lost, unmounted, checked, made
        while True:
            with lock:
                cut = next(points, None)
                if cut is None:
                    return
                image = images.at(cut, rng)
            where = tempfile.mkdtemp(prefix="cut-", dir=base)
            try:
                s, c = one_cut(where, image, acks, inputs_of(played), "z", cut, quiet)
                with lock:
                    starts.extend(s)
                    checked += c
            except Unmountable:
                with lock:
                    unmounted += 1
            except Fault as e:
                with lock:
                    lost += 1
                if not quiet:
                    print("cut at %d of %d: %s" % (cut, end, e), flush=True)
            with lock:
                made += 1

    threads = [threading.Thread(target=some) for _ in range(2)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    # An exception in a thread does not fail the test by itself.
    expect(made == n, "%d of %d cuts were made" % (made, n))
    return lost, unmounted, starts, checked


def inputs_of(played):
    return played[1].inputs


def main():
    faults.need_tools("nbdkit", "nbdfuse", "fusermount3", "mkfs.ext4", "losetup")
    if not os.path.exists(os.path.join(BUILD, "write_log.so")):
        faults.unavailable("the plugin was not built (nbdkit-plugin-dev)")
    n, rng = faults.setting("ACUT_FAULT_POWER", 50), random.Random(faults.setting("ACUT_FAULT_SEED", 1))
    seconds = faults.setting("ACUT_FAULT_POWER_SECONDS", 4)
    begun = time.monotonic()
    os.environ.setdefault("ACUT_TEST_TMP", "/dev/shm" if os.access("/dev/shm", os.W_OK) else "/tmp")
    with e2e.Folder() as base:
        mounts.need(base)
        inputs = Inputs(base)
        bad = 0
        for name, env, share in (("all as it is", None, n), ("without fsync", {"ACUT_NO_SYNC": "all"}, max(n // 10, 10)),
                                 ("without fsync of folders", {"ACUT_NO_SYNC": "folders"}, max(n // 5, 20))):
            if env:
                env["LD_PRELOAD"] = os.path.join(BUILD, "no_sync.so")
            where = os.path.join(base, name.replace(" ", "-"))
            played = play(where, inputs, seconds, env)
            played[1].inputs = inputs
            lost, unmounted, starts, checked = cuts(where, played, share, rng, quiet=bool(env))
            # The file system often writes folders to disk by itself, so losses without fsync of folders are rare.
            made = share
            while env and not lost and made < 10 * share:
                more = cuts(where, played, share, rng, quiet=True)
                lost, unmounted, starts, checked = lost + more[0], unmounted + more[1], starts + more[2], checked + more[3]
                made += share
            print("%s%s: %d cuts, %d losses, %d not mountable, %d acknowledgements checked, start p99 %.0f ms, %.1f s" %
                  ("control, " if env else "", name, made, lost, unmounted, checked, faults.percentile(starts, .99) * 1000,
                   time.monotonic() - begun), flush=True)
            bad += (lost + unmounted > 0 or not checked) if not env else (lost == 0)
            shutil.rmtree(where, ignore_errors=True)
        expect(not bad, "losses, or controls that lose nothing")


if __name__ == "__main__":
    e2e.main(main)
