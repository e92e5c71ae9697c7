"""Mounts of the tests of faults. A mount namespace that any process makes gets a copy of all mounts. Until it ends, each of its
file systems is active: `umount` succeeds here, but caches, image and loop device stay in use, and the next mount of the image
finds the same file system again. So these tests have a mount namespace of their own, and no other one gets copies of their mounts."""
import ctypes
import os
import time

from faults import e2e, expect

CLONE_NEWNS, MS_REC, MS_SLAVE, MNT_DETACH = 0x20000, 0x4000, 0x80000, 2
RELEASE = 60  # seconds until a process that had a copy for a moment has surely let go


def own_namespace():
    """A mount namespace of this process's own; False where that is not permitted. It must not hold the mounts of other tests that
    run now. Those of the system go when the system unmounts them."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(CLONE_NEWNS) or libc.mount(b"none", b"/", None, MS_REC | MS_SLAVE, None):
        return False
    with open("/proc/self/mountinfo", "rb") as f:
        places = [line.split()[4] for line in f]
    for place in reversed(places):
        if b"/" + e2e.Folder.PREFIX.encode() in place:
            libc.umount2(place, MNT_DETACH)
    return True


def unavailable_here(base):
    """Goes into a mount namespace of its own. Why it cannot mount file systems there; None if it can. Before any thread is
    started: they would stay in the old one."""
    there, image = os.path.join(base, "try"), os.path.join(base, "try.img")
    if os.geteuid():
        return "mounts need root"
    if not own_namespace():
        return "no mount namespaces here"
    os.mkdir(there)
    with open(image, "wb") as f:
        f.truncate(1 << 20)
    if e2e.run(["mkfs.ext4", "-q", image]).status or e2e.run(["mount", "-o", "loop", image, there]).status:
        return "no mounts of loop devices here"
    unmount(there, image)
    os.unlink(image)
    return None


def need(base):
    """Skips the test where it cannot mount file systems."""
    reason = unavailable_here(base)
    if reason:
        e2e.unavailable(reason)


def succeeds(args):
    """Repeats a command until it succeeds. False: it never did."""
    deadline = time.monotonic() + RELEASE
    while e2e.run(args).status:
        if time.monotonic() > deadline:
            return False
        time.sleep(0.1)
    return True


def unmount(path, image=None):
    """Unmounts, and waits until the loop device of the image is free: only then does the image have all that was written, and does
    nobody else write to it."""
    expect(succeeds(["umount", path]), "%s: the file system stays in use" % path)
    deadline = time.monotonic() + RELEASE
    while image and e2e.run(["losetup", "-j", image]).ok().out:
        expect(time.monotonic() < deadline,
               "%s is unmounted, but still has a loop device: another mount namespace has a copy of the mount" % image)
        time.sleep(0.1)
