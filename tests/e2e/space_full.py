"""Real file systems: full ones, one that hangs, and two of them for one daemon."""
import functools
import os
import signal
import subprocess
import tempfile

import e2e
from e2e import expect
from space import digests, stat, synth, until


def with_disk_of(size, memory, *args):
    """Decorates a case that needs a daemon on a small file system: the case gets the folder of its files, the one where the file
    system is mounted, and the daemon. Skipped where nothing can be mounted."""
    def decorate(case):
        @functools.wraps(case)
        def run():
            with e2e.Folder() as base:
                at = os.path.join(base, "fs")
                os.mkdir(at)
                if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=" + size, "tmpfs", at], stderr=subprocess.DEVNULL).returncode:
                    print("skipped: nothing can be mounted here (%s)" % case.__name__)
                    return
                d = e2e.Daemon(base, memory=memory, args=args)
                for option, name in (("--state", "state"), ("--cache", "cache")):
                    d.command[d.command.index(option) + 1] = os.path.join(at, name)
                try:
                    d.start()
                    case(base, at, d)
                finally:
                    d.stop(signal.SIGKILL)
                    subprocess.run(["umount", at])
        return run
    return decorate


@with_disk_of("12m", "24M", "--disk", "100%", "--keep-free", "0%")
def a_file_system_that_is_full(base, at, d):
    """A push to a full file system fails with 74; the daemon keeps running, and works again when there is space."""
    d.ctl("push", "a", synth(os.path.join(base, "a.las"), 100000)).ok()
    want = digests(d, "a")
    # Another program takes the rest.
    hog = os.path.join(at, "hog")
    with open(hog, "wb", buffering=0) as f:
        try:
            while True:
                f.write(bytes(1 << 16))
        except OSError:
            pass
    r = d.ctl("push", "b", synth(os.path.join(base, "b.las"), 60000, 2))
    expect(r.status == 74, "%d %s" % (r.status, r.err))
    expect(d.ctl("ping").status == 0, "the daemon is gone")
    expect(digests_or_none(d, "a") in (want, None), "another mesh")
    os.remove(hog)
    expect(until(lambda: d.ctl("push", "b", os.path.join(base, "b.las")).status == 0, step=1), "no push any more")
    expect(digests(d, "a") == want, "another mesh")


@with_disk_of("32m", "64M", "--disk", "100%", "--keep-free", "2M", "--space-wait", str(e2e.PATIENCE))
def room_that_others_give_back(base, at, d):
    """A stream waits for space that another program has: the free space is measured again as long as a job waits."""
    d.ctl("push", "a", synth(os.path.join(base, "a.las"), 400000)).ok()
    job = d.ctl("submit", "a", "--every", "2", "--wait", "--json").ok().json()["job"]
    d.ctl("cache", "gc", "--all").ok()
    v = os.statvfs(at)
    hog = os.path.join(at, "hog")
    with open(hog, "wb") as f:
        f.write(bytes(v.f_bavail * v.f_frsize - (2 << 20) - (200 << 10)))
    fetch = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "fetch", str(job), "--format", "null"],
                             stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    told = fetch.stderr.readline().decode()
    expect("of disk space are lacking" in told, told)
    os.remove(hog)
    err = fetch.communicate()[1].decode()
    expect(fetch.returncode == 0, "%d %s" % (fetch.returncode, err))


@with_disk_of("12m", "24M", "--disk", "100%", "--keep-free", "0%")
def a_start_on_a_full_disk(base, at, d):
    """Other programs have filled the disk: the daemon starts, removes derived data, and loses nothing."""
    d.ctl("push", "a", synth(os.path.join(base, "a.las"), 60000)).ok()
    want = digests(d, "a")
    d.stop()
    hog = os.open(os.path.join(at, "hog"), os.O_WRONLY | os.O_CREAT)
    for size in (1 << 16, 1 << 12):
        try:
            while os.write(hog, bytes(size)):
                pass
        except OSError:
            pass
    os.close(hog)
    d.start()
    expect("the disk is full" in d.log_text(), "it is not said")
    expect(d.ctl("dataset", "show", "a", "--json").ok().json()["points"] == 60000, "points are lost")
    os.remove(os.path.join(at, "hog"))
    expect(digests(d, "a") == want, "another mesh")


def digests_or_none(d, dataset):
    r = d.ctl("submit", dataset, "--new", "--json", "--wait", "--timeout", "10")
    if r.status == 0:
        s = r.json()
        return s["digest"], s["vertex_digest"]
    expect(r.status in (74, 124), "%d %s" % (r.status, r.err))
    return None


def state_and_cache_on_two_file_systems():
    """Nothing is moved or linked between the two folders: staging, merging, meshing, backup and removal work as on one disk, also
    after a kill during a push."""
    with e2e.Folder() as base:
        memory = os.environ.get("XDG_RUNTIME_DIR") or "/dev/shm"
        if not os.path.isdir(memory) or os.stat(memory).st_dev == os.stat(base).st_dev:
            e2e.unavailable("there is no second file system")
        with tempfile.TemporaryDirectory(dir=memory) as other, e2e.Daemon(base, memory="24M") as d:
            files = [synth("%s/%d.las" % (base, i), "60k", i) for i in range(5)]
            d.ctl("push", "a", *files).ok()
            want = digests(d, "a")
            d.stop()
            d.state, d.cache = base + "/state-two", other + "/cache"
            d.command[d.command.index("--state") + 1], d.command[d.command.index("--cache") + 1] = d.state, d.cache
            d.start()
            for f in files[:4]:
                d.ctl("push", "a", f).ok()
            client = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "push", "a", files[4]], stdout=subprocess.DEVNULL,
                                      stderr=subprocess.DEVNULL)
            d.stop(signal.SIGKILL)
            client.wait(e2e.PATIENCE)
            d.start()
            d.ctl("push", "a", files[4]).ok()
            expect(digests(d, "a") == want, "another mesh")
            d.ctl("mesh", files[0], "--format", "null").ok()
            d.ctl("backup", base + "/backup").ok()
            expect("0 damaged of what was pushed" in d.ctl("cache", "verify").ok().out, "damage")
            expect(os.stat(d.state).st_dev != os.stat(d.cache).st_dev, "one file system")


def a_file_system_that_hangs():
    """Writers wait until the file system answers. Everybody else is served, with the numbers of the last measurement."""
    with e2e.Folder() as base:
        gate = e2e.Gate(base)
        with e2e.Daemon(base, memory="64M", threads=1, env=gate.env) as d:
            d.ctl("push", "a", synth(base + "/a.las", "5k")).ok()
            gate.close("fstatvfs", base)
            push = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "push", "b", synth(base + "/b.las", "5k", 2)],
                                    stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            gate.wait()
            total = [stat(d)["state_disk"]["total"] for _ in range(3)]
            for words in (("ping",), ("status",), ("datasets",), ("dataset", "chmod", "0640", "a"), ("metrics",)):
                d.ctl(*words, timeout=e2e.PATIENCE).ok()
            expect(push.poll() is None and min(total) > 0, "%s %s" % (push.poll(), total))
            gate.open()
            out = push.communicate(timeout=e2e.PATIENCE)[0]
            expect(push.returncode == 0, out)


if __name__ == "__main__":
    e2e.main(state_and_cache_on_two_file_systems, a_file_system_that_hangs, a_file_system_that_is_full, room_that_others_give_back,
             a_start_on_a_full_disk)
