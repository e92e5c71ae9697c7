"""A cluster run on a shared file system: a kernel's NFS server, and two clients of it with the default caching and caches of their
own, in the machine that `run` boots. Names as arguments run these cases only.

Tasks run by hand, phase by phase, as a scheduler would run them on two nodes: one is a mount, its tasks see the work folder
through it. What comes out has the digests of a daemon that has the same files on a local disk.
"""
import hashlib
import os
import random
import signal
import sys
import time

sys.path[:0] = ["/opt/acut/tree/tests/e2e"]
from cluster_tasks import Tasks
from e2e import ACUTCTL, SYNTH, expect, main, run

EXPORT, NODES, INPUTS = "/srv/export", ("/mnt/a", "/mnt/b"), "/srv/in"
SMALL = ["--task-points", "6000", "--task-memory", "64M"]
FILES = 6
# A small disk of the server, below the folder that is exported.
DISK, DISK_BYTES = EXPORT + "/disk", 32 << 20


def serve():
    for module in ("nfsd", "nfs", "nfsv4"):
        run(["modprobe", module]).ok()
    for folder in (EXPORT, *NODES, INPUTS, "/var/lib/nfs/v4recovery", "/var/lib/nfs/rpc_pipefs", "/run/rpcbind"):
        os.makedirs(folder, exist_ok=True)
    for name in ("/var/lib/nfs/etab", "/var/lib/nfs/rmtab", "/etc/exports"):
        open(name, "a").close()
    run(["mount", "-t", "nfsd", "nfsd", "/proc/fs/nfsd"]).ok()
    for name in ("nfsv4leasetime", "nfsv4gracetime"):
        with open("/proc/fs/nfsd/" + name, "w") as f:
            f.write("10")
    os.makedirs(DISK, exist_ok=True)
    run(["mount", "-t", "tmpfs", "-o", "size=%d" % DISK_BYTES, "tmpfs", DISK]).ok()
    export()
    run(["rpc.mountd", "-N", "2", "-N", "3", "--no-udp"]).ok()
    nfsd("4")
    for node in NODES:
        run(["mount", "-t", "nfs4", "-o", "vers=4.2,nosharecache", "127.0.0.1:/", node]).ok()


def export():
    for folder, options in ((EXPORT, "fsid=0,crossmnt"), (DISK, "fsid=1")):
        run(["exportfs", "-o", "rw,no_root_squash,no_subtree_check,sync," + options, "127.0.0.1:" + folder]).ok()


def nfsd(threads):
    run(["rpc.nfsd", "-N", "3", "-V", "4", "-V", "4.2", threads]).ok()


def stale_attributes():
    """The two mounts do not share what they remember: else this would not be two clients."""
    with open(NODES[0] + "/probe", "w") as f:
        f.write("x")
    os.stat(NODES[0] + "/probe")
    os.link(NODES[1] + "/probe", NODES[1] + "/probe2")
    links = os.stat(NODES[0] + "/probe").st_nlink
    os.unlink(NODES[1] + "/probe2")
    os.unlink(NODES[1] + "/probe")
    print("figure links that the other client sees at once: %d of 2" % links)
    expect(links == 1, "the mounts share their attributes")


def inputs():
    files = ["%s/%d.las" % (INPUTS, i) for i in range(FILES)]
    if not os.path.exists(files[-1]):
        for i, path in enumerate(files):
            run([SYNTH, "--points", "5000", "--seed", str(i + 1), "--origin", "%d,5400000" % (500000 + 20 * i), path]).ok()
    return files


def wanted():
    """The mesh of a daemon, once."""
    if not hasattr(wanted, "got"):
        got = run([ACUTCTL, "mesh", *inputs(), "-o", "/srv/daemon.ply", "--canonical", "--json"]).ok().json()
        wanted.got = got["digest"], got["vertex_digest"]
    return wanted.got


class Survey(Tasks):
    """A run whose tasks nobody has begun; node 0 and 1 are the two mounts."""
    number = 0

    def __init__(self, *options, folder=""):
        Survey.number += 1
        name = "%s/work%d" % (folder, Survey.number)
        self.out = "%s%s/out%d.ply" % (NODES[0], folder, Survey.number)
        super().__init__([*inputs(), "-o", self.out, "--canonical", *SMALL, *options], [node + name for node in NODES],
                         "/srv/script%d" % Survey.number)

    def check(self):
        expect(self.digests() == wanted(), "another mesh: %s" % (self.digests(),))
        with open(self.out, "rb") as a, open("/srv/daemon.ply", "rb") as b:
            expect(hashlib.sha256(a.read()).digest() == hashlib.sha256(b.read()).digest(), "the outputs differ")
        expect(not self.unnamed(), "no record names these files: %s" % self.unnamed())
        self.clean()
        expect(not os.path.exists(self.work[0].replace(NODES[0], EXPORT)), "clean has left something")


# ---- cases ----

def two_nodes():
    """Each phase begins on one client right after the other one has done the last task of the phase before."""
    stale_attributes()
    survey = Survey()
    print("figure tasks: %d" % len(survey.tasks))
    for n, (phase, i) in enumerate(survey.tasks):
        survey.task(phase, i, n)
    survey.check()


def every_task_twice():
    """On both clients at once, as after a node was given up that still lives."""
    survey = Survey("--sort")
    for phase, i in survey.tasks:
        for p in [survey.start(phase, i, node) for node in (0, 1)]:
            status, text = survey.end(p)
            expect(status == 0, "%s %d ended with %d: %s" % (phase, i, status, text))
    survey.check()


def killed():
    """kill -9 of tasks at random times, then the same task on the other client."""
    survey, rand, kills = Survey(), random.Random(7), 0
    for phase, i in survey.tasks:
        for turn in range(2):
            p = survey.start(phase, i, turn)
            time.sleep(rand.random() * 0.4)
            p.send_signal(signal.SIGKILL)
            kills += survey.end(p)[0] == -signal.SIGKILL
        survey.task(phase, i, rand.randrange(2))
    print("figure tasks that were killed: %d" % kills)
    expect(survey.digests() == wanted(), "another mesh: %s" % (survey.digests(),))
    survey.clean()


def the_server_restarts():
    """While tasks write: what was answered is not lost, and they go on."""
    survey = Survey()
    for n, (phase, i) in enumerate(survey.tasks):
        p = survey.start(phase, i, n)
        if n % 3 == 0:
            time.sleep(0.1)
            nfsd("0")
            time.sleep(1)
            nfsd("4")
        status, text = survey.end(p)
        expect(status == 0, "%s %d ended with %d: %s" % (phase, i, status, text))
    survey.check()


def a_full_disk():
    """The server's disk is full while a task of each phase runs; with space again, the other client goes on with what there is."""
    survey, refused = Survey(folder="/disk"), []
    for n, (phase, i) in enumerate(survey.tasks):
        free = os.statvfs(DISK)
        with open(DISK + "/other", "wb") as f:
            f.write(b"x" * max(0, free.f_bavail * free.f_frsize - 16384))
        status, text = survey.end(survey.start(phase, i, n))
        expect(status in (0, 74) and (not status or "space" in text), "%s %d: %d %s" % (phase, i, status, text))
        if status:
            refused.append(phase)
        os.unlink(DISK + "/other")
        survey.task(phase, i, n + 1)
    print("figure phases that a full disk refused: %s" % sorted(set(refused)))
    expect({"stage", "mesh", "gather"} <= set(refused), "the full disk was not felt: %s" % refused)
    survey.check()


def stale_handles():
    """The server restarts while tasks run, and for a time it does not know the handles that the clients have (ESTALE)."""
    survey, failed = Survey("--sort", folder="/disk"), []
    for n, (phase, i) in enumerate(survey.tasks):
        p = survey.start(phase, i, n)
        time.sleep(0.15)
        run(["exportfs", "-u", "127.0.0.1:" + DISK]).ok()
        nfsd("0")
        nfsd("4")
        time.sleep(1.5)
        export()
        status, text = survey.end(p)
        expect(status in (0, 4, 74), "%s %d: %d %s" % (phase, i, status, text))  # 4: the folder is not there
        if status:
            failed.append("%s: %s" % (phase, text.splitlines()[0]))
            survey.task(phase, i, n)
    print("figure tasks that failed with stale handles: %d %s" % (len(failed), failed[:3]))
    expect(survey.digests() == wanted(), "another mesh: %s" % (survey.digests(),))
    # It is not cleaned: these clients take folders of it for file systems of their own by now, and mount them.


CASES = [two_nodes, every_task_twice, killed, the_server_restarts, a_full_disk, stale_handles]
serve()
main(*[c for c in CASES if not sys.argv[1:] or c.__name__ in sys.argv[1:]])
