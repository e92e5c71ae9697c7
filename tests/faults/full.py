"""Disks that are full, have no inodes left, or have bad blocks: the client gets an error with the reason, the daemon goes on,
other requests succeed, and all works again when the cause is gone."""
import os
import time

import faults
import mounts
from faults import Acks, Inputs, Store, e2e, expect
from power import Disk

NOT_YET = ("--disk", "1G", "--keep-free", "0", "--space-wait", "1")


class Mount:
    """A small file system below `base`, with the state and the cache."""

    def __init__(self, base, args, grow):
        self.path, self.args, self.grow = os.path.join(base, "mnt"), args, grow
        os.mkdir(self.path)

    def __enter__(self):
        e2e.run(["mount", *self.args, self.path]).ok()
        return self

    def __exit__(self, *exc):
        mounts.unmount(self.path)


def fill(store, inputs, words):
    """Pushes and jobs until one fails: (number of datasets before, the failure). Each failure has a reason."""
    for n in range(200):
        name = "f%d" % n
        for args in (("push", name, *sum(inputs.pushed, [])), ("submit", name, "--wait", "--timeout", "5")):
            r = store.ctl(*args, timeout=300)
            # Slow commands are repeated.
            while r.status == 124 and not any(w in r.err for w in words):
                r = store.ctl(*args, timeout=300)
            if r.status:
                return n, r
    raise faults.Fault("it is never full")


def full(base, inputs, args, grow, words, status=(74, 75, 124), before=lambda m: None):
    os.makedirs(base)
    with Mount(base, args, grow) as m, \
            Store(base, state=os.path.join(m.path, "state"), cache=os.path.join(m.path, "cache"), args=NOT_YET) as store:
        before(m)
        store.start()
        n, r = fill(store, inputs, words)
        expect(r.status in status and any(w in r.err for w in words), "%d: %s" % (r.status, r.err))
        # Further attempts fail in the same way; requests are answered.
        for _ in range(3):
            r = store.ctl("push", "more", *sum(inputs.pushed, []))
            expect(r.status == 0 or any(w in r.err for w in words), r.err)
        expect(store.ctl("ping").status == 0 and store.alive(), "the daemon is gone")
        expect(len(store.rows("datasets")) >= n, "datasets are gone")
        begun = time.monotonic()
        grow(m)
        faults.work(store, inputs, Acks(), "again")
        store.stop()
        # A new daemon works, too.
        store.start()
        faults.work(store, inputs, Acks(), "again")
        left = faults.leftovers(store)
        print("%s: full after %d datasets: %s; well again in %.1f s" % (os.path.basename(base), n, r.err.splitlines()[0] if r.err else "-", time.monotonic() - begun))
        store.stop()
        expect(not [x for x in left if x.endswith(".tmp")], "left behind: %s" % left)


def filler(m):
    """A file of another program leaves 8 MB."""
    with open(os.path.join(m.path, "other"), "wb") as f:
        f.write(b"x" * (13 << 20))


def bad_blocks(base, inputs):
    """Reading the disk fails while a flag is set."""
    os.mkdir(base)
    flag = os.path.join(base, "flag")
    disk = Disk(base, size=32 << 20, plugin=["--filter=error", "file", os.path.join(base, "disk"), "error=EIO", "error-pread-rate=100%",
                                             "error-pread-file=" + flag])
    with disk, Store(base, state=os.path.join(disk.mount, "state"), cache=os.path.join(base, "cache")) as store:
        store.start()
        store.ctl("push", "bad", *sum(inputs.pushed, [])).ok()
        store.stop()
        loop = [u for u in disk.undo if isinstance(u, list) and u[0] == "losetup"][0][2]
        mounts.unmount(disk.mount)  # its cache goes
        e2e.run(["mount", loop, disk.mount]).ok()
        store.start()
        store.ctl("dataset", "log", "bad").ok()  # this loads the manifest into memory
        with open(flag, "w"):
            pass
        r = store.ctl("submit", "bad", "--wait")
        expect(r.status in (1, 74) and (".seg" in r.err or "manifest" in r.err or "lineset-" in r.err) and "byte" in r.err, "%d: %s" % (r.status, r.err))
        print("bad blocks:", r.err.splitlines()[0])
        expect(store.ctl("ping").status == 0, "the daemon is gone")
        os.unlink(flag)
        job = store.ctl("submit", "bad", "--wait", "--json").ok().json()
        expect(faults.digests(job) == inputs.want[3, ()], "another mesh")
        store.stop()


def main():
    faults.need_tools("mkfs.ext4", "mount")
    with e2e.Folder() as base:
        mounts.need(base)
        inputs = Inputs(base)
        image = os.path.join(base, "image")
        with open(image, "wb") as f:
            f.truncate(24 << 20)
        e2e.run(["mkfs.ext4", "-q", "-m", "0", image]).ok()
        space = ("space", "room", "No space")
        full(os.path.join(base, "tmpfs"), inputs, ["-t", "tmpfs", "-o", "size=3m", "tmpfs"],
             lambda m: e2e.run(["mount", "-o", "remount,size=64m", m.path]).ok(), space)
        full(os.path.join(base, "inodes"), inputs, ["-t", "tmpfs", "-o", "size=64m,nr_inodes=48", "tmpfs"],
             lambda m: e2e.run(["mount", "-o", "remount,nr_inodes=4096", m.path]).ok(), space)

        full(os.path.join(base, "ext4"), inputs, ["-o", "loop", image], lambda m: os.unlink(os.path.join(m.path, "other")), space,
             before=filler)
        faults.need_tools("nbdkit", "nbdfuse", "fusermount3")
        bad_blocks(os.path.join(base, "blocks"), inputs)


if __name__ == "__main__":
    e2e.main(main)
