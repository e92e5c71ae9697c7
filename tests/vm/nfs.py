"""A cluster run on a shared file system: a kernel's NFS server, and two clients of it with the default caching and caches of their
own, in the machine that `run` boots. Names as arguments run these cases only.

Tasks run by hand, phase by phase, as a scheduler would run them on two nodes. Both see work folder and outputs by the same names: the
tasks of the second have its mount in the place of the first one's. What comes out has the digests of a daemon that has the same files on
a local disk.
"""
import hashlib
import os
import random
import signal
import sys
import time

sys.path[:0] = ["/opt/acut/tree/tests/e2e"]
from cluster_tasks import CLUSTER, Tasks, stl_triangles
from e2e import ACUTCTL, SYNTH, VERIFY, expect, main, run

EXPORT, NODES, INPUTS = "/srv/export", ("/mnt/a", "/mnt/b"), "/srv/in"
SMALL = ["--task-points", "6000", "--task-memory", "64M"]
FILES = 6
# A survey whose PLY and STL have several blocks of 4 MiB, and its tasks.
WIDE, WIDE_POINTS, WIDE_TASKS = INPUTS + "/wide.las", 200000, ["--task-points", "70000", "--task-memory", "64M"]
OTHER = "/srv/other"  # exported all the time, so that the server knows its clients
# A small disk of the server, below the folder that is exported.
DISK, DISK_BYTES = EXPORT + "/disk", 32 << 20
# Kills a program at its third write.
KILL_AT_WRITE = ["strace", "-f", "-qq", "-o", "/dev/null", "--trace=pwrite64", "--inject=pwrite64:signal=KILL:when=3"]


def serve():
    for module in ("nfsd", "nfs", "nfsv4"):
        run(["modprobe", module]).ok()
    for folder in (EXPORT, OTHER, *NODES, INPUTS, "/var/lib/nfs/v4recovery", "/var/lib/nfs/rpc_pipefs", "/run/rpcbind"):
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
        run(["mount", "-t", "nfs4", "-o", "vers=4.2,nosharecache", "127.0.0.1:" + EXPORT, node]).ok()


def export():
    for folder, number in ((OTHER, 1), (EXPORT, 2), (DISK, 3)):
        run(["exportfs", "-o", "rw,no_root_squash,no_subtree_check,sync,fsid=%d" % number, "127.0.0.1:" + folder]).ok()


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


# What runs a program on the second node: a mount namespace of its own, where the folder of the first is the second's.
SECOND = ("unshare", "-m", "sh", "-c", 'mount --rbind %s %s && exec "$@"' % (NODES[1], NODES[0]), "sh")


class Survey(Tasks):
    """A run whose tasks nobody has begun; node 0 and 1 are the two mounts."""
    number = 0

    def __init__(self, *options, folder=""):
        Survey.number += 1
        self.out = "%s%s/out%d.ply" % (NODES[0], folder, Survey.number)
        self.begin([*inputs(), "-o", self.out, "--canonical", *SMALL, *options], "%s/work%d" % (folder, Survey.number))

    def begin(self, words, name):
        super().__init__(words, NODES[0] + name, "/srv/script%d" % Survey.number)

    def start(self, phase, index, node=0, prefix=()):
        return super().start(phase, index, prefix=(*(SECOND if node % 2 else ()), *prefix))

    def check(self, unnamed=False):
        expect(self.digests() == wanted(), "another mesh: %s" % (self.digests(),))
        self.check_files()
        expect(unnamed or not self.unnamed(), "no record names these files: %s" % self.unnamed())
        self.clean()
        expect(not os.path.exists(self.work[0].replace(NODES[0], EXPORT)), "clean has left something")

    def check_files(self):
        os.listdir(os.path.dirname(self.out))  # this client may remember that the file was not there
        with open(self.out, "rb") as a, open("/srv/daemon.ply", "rb") as b:
            expect(hashlib.sha256(a.read()).digest() == hashlib.sha256(b.read()).digest(), "the outputs differ")


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
    survey.check(unnamed=True)


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


class OneFile(Survey):
    """A PLY and an STL of several blocks, which all tasks of gather write."""

    def __init__(self):
        Survey.number += 1
        if not os.path.exists(WIDE):
            run([SYNTH, "--points", str(WIDE_POINTS), WIDE]).ok()
        self.out, self.stl = ("%s/one%d.%s" % (NODES[0], Survey.number, end) for end in ("ply", "stl"))
        self.begin([WIDE, "-o", self.out, "-o", self.stl, "--origin", "auto", *WIDE_TASKS], "/one%d" % Survey.number)

    def check_files(self):
        """As the other node reads them."""
        run([*SECOND, VERIFY, self.out, WIDE], timeout=600).ok()
        run([ACUTCTL, "mesh", WIDE, "-o", "/srv/daemon.stl", "--origin", "auto"], timeout=600).ok()
        expect(stl_triangles(self.stl.replace(*NODES)) == stl_triangles("/srv/daemon.stl"), "the STL has other triangles than acutd's")

    def written(self):
        """Bytes that the server has of the outputs, which have no names yet."""
        names = [name for name in os.listdir(EXPORT) if name.startswith(".one%d." % Survey.number)]
        expect(len(names) == 2, "the outputs are not two files: %s" % os.listdir(EXPORT))
        return sum(os.stat(os.path.join(EXPORT, name)).st_blocks * 512 for name in names)


def one_file_by_all_tasks():
    """Each task of gather is killed while it writes, then all of them run at once, each on both clients."""
    survey, before, halves = OneFile(), 0, []
    gathers = [i for phase, i in survey.tasks if phase == "gather"]
    expect(len(gathers) >= 3, "there are %d tasks" % len(gathers))
    for n, (phase, i) in enumerate(survey.tasks):
        if phase not in ("gather", "finish"):
            survey.task(phase, i, n)
    for i in gathers:
        status, text = survey.end(survey.start("gather", i, i, prefix=KILL_AT_WRITE))
        expect(status == -signal.SIGKILL and not survey.done("gather", i), "gather %d ended with %d: %s" % (i, status, text))
        halves.append(survey.written() - before)
        before += halves[-1]
    print("figure bytes that tasks of gather had written when they were killed: %s" % halves)
    expect(all(halves), "a task was killed before it wrote: %s" % halves)
    for i, p in [(i, survey.start("gather", i, node)) for i in gathers for node in (0, 1)]:
        status, text = survey.end(p)
        expect(status == 0, "gather %d ended with %d: %s" % (i, status, text))
    survey.task("finish", 0, 1)
    survey.check_files()
    survey.clean()
    left = sorted(name for name in os.listdir(EXPORT) if "one" in name)
    expect(left == [os.path.basename(name) for name in (survey.out, survey.stl)], "what is left: %s" % left)


def cleaned_while_a_file_is_open():
    """A file that is deleted while somebody has it open on the same node keeps a name there (.nfs...): clean says which, and why. Once it is
    closed, clean removes it. What a process of the other node has open is no matter."""
    for node in NODES[::-1]:
        survey = Survey()
        for n, (phase, i) in enumerate(survey.tasks):
            survey.task(phase, i, n)
        name = next(name for name in sorted(survey.named()) if name.startswith("mesh/"))
        with open("%s/work%d/%s" % (node, Survey.number, name), "rb") as held:
            held.read(1)
            if node == NODES[0]:
                r = run([CLUSTER, "clean", survey.work[0]])
                expect(r.status == 1 and "%s/mesh/.nfs" % survey.work[0] in r.err and "fuser" in r.err, "%d %s" % (r.status, r.err))
                r = run([CLUSTER, "clean", survey.work[0]])
                expect(r.status == 1 and "/mesh/.nfs" in r.err, "again: %d %s" % (r.status, r.err))
            else:
                survey.clean()
        if node == NODES[0]:
            survey.clean()


def stale_handles():
    """The server restarts while tasks run, and for a time it does not know the handles that the clients have (ESTALE): none of the whole
    mount. Where a part of it were away, clients would take what they see there meanwhile for another file system, and mount that."""
    survey, failed = Survey("--sort"), []
    for n, (phase, i) in enumerate(survey.tasks):
        p = survey.start(phase, i, n)
        time.sleep(0.15)
        for folder in (EXPORT, DISK):
            run(["exportfs", "-u", "127.0.0.1:" + folder]).ok()
        nfsd("0")
        nfsd("4")
        time.sleep(1.5)
        export()
        status, text = survey.end(p)
        expect(status in (0, 74), "%s %d: %d %s" % (phase, i, status, text))
        if status:
            failed.append("%s: %s" % (phase, text.splitlines()[0]))
            survey.task(phase, i, n)
    print("figure tasks that failed with stale handles: %d %s" % (len(failed), failed[:3]))
    expect(any("Stale file handle" in text for text in failed), "no handle was stale: %s" % failed)
    survey.check(unnamed=True)  # what a task that failed could not remove


CASES = [two_nodes, every_task_twice, killed, the_server_restarts, a_full_disk, one_file_by_all_tasks, cleaned_while_a_file_is_open,
         stale_handles]
serve()
main(*[c for c in CASES if not sys.argv[1:] or c.__name__ in sys.argv[1:]])
