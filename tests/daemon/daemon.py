"""The contract of acutd as a process: its folders and sockets are its own, it survives being killed at any moment, it
leaves clean folders, it keeps its memory, and running out of descriptors or a client who never reads harms nobody."""
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e
from e2e import Daemon, Fault, Folder, expect, main, run

try:
    import acut_wire
    from acut_wire import Client, pb
except (ImportError, FileNotFoundError) as missing:
    e2e.skip("the protocol in Python: %s" % missing)

MIB = 1 << 20


def survey(base, points, name="survey.las", seed=1):
    path = os.path.join(base, name)
    run([e2e.SYNTH, "--points", points, "--seed", seed, path]).ok()
    return path


def files_below(*tops):
    return sorted(os.path.join(d, n) for top in tops for d, _, names in os.walk(top) for n in names)


def expect_clean(d):
    """Nothing temporary: the catalogue, locks, and per dataset its manifests and sealed segments. Files are removed in the background."""
    def left():
        try:
            found = os.listdir(os.path.join(d.cache, "one-step")) + files_below(os.path.join(d.cache, "tmp"))
            for folder in os.listdir(os.path.join(d.state, "datasets")):
                names = os.listdir(os.path.join(d.state, "datasets", folder))
                found += [folder + "/" + n for n in names if n.endswith(".tmp") or ".run" in n]
                found += [] if any(n.startswith("manifest-") for n in names) else [folder + " without a manifest"]
        except FileNotFoundError as gone:
            found = [gone.filename]
        return found

    e2e.until(lambda: not left(), lambda: "left behind: %s" % left())


def digest_of(d, *args):
    return json.loads(d.ctl("submit", *args, "--wait", "--json").ok().out)["digest"]


def folders_are_locked():
    with Folder() as base, Daemon(base) as d:
        other = run([e2e.ACUTD, "--no-config", "--socket", base + "/other.sock", "--state", d.state, "--cache", base + "/c2"], timeout=100)
        expect(other.status == 75 and str(d.process.pid) in other.err, "same state: %d %s" % (other.status, other.err))
        other = run([e2e.ACUTD, "--no-config", "--socket", base + "/other.sock", "--init", "--state", base + "/s2", "--cache", d.cache], timeout=100)
        expect(other.status == 75 and str(d.process.pid) in other.err, "same cache: %d %s" % (other.status, other.err))
        other = run([e2e.ACUTD, "--no-config", "--socket", d.socket, "--init", "--state", base + "/s3", "--cache", base + "/c3"], timeout=100)
        expect(other.status == 75 and str(d.process.pid) in other.err, "same socket: %d %s" % (other.status, other.err))
        d.ctl("ping").ok()


def first_start_of_a_service():
    """--init-first makes the store once, where systemd made the folders; never where somebody chose the folder, and never
    again: an empty state folder beside a cache that has served is an unmounted disk."""
    with Folder() as base:
        state, cache, other = base + "/lib", base + "/cache", base + "/other"
        for folder in (state, cache, other):
            os.mkdir(folder)
        env = {"STATE_DIRECTORY": state, "CACHE_DIRECTORY": cache}

        def start(*args):
            d = Daemon(base)
            d.command = [e2e.ACUTD, "--socket", d.socket, "--init-first", "--memory", "64M"] + list(args)
            d.env.update(env)
            return d

        def refused(*args):
            got = run(start(*args).command, env=env, timeout=100)
            expect(got.status == 78 and "unmounted disk" in got.err, "%s: %d %s" % (args, got.status, got.err))

        refused("--state", other)
        expect(not os.listdir(other), "it was written to")
        os.environ.pop("STATE_DIRECTORY", None)
        for _ in range(2):
            with start() as d:
                d.ctl("status").ok()
                d.stop()
        os.rename(state, base + "/elsewhere")
        os.mkdir(state)
        refused()
        expect(not os.listdir(state), "it was written to")
        os.rmdir(state)
        os.rename(base + "/elsewhere", state)
        with start() as d:
            d.stop()


def state_and_cache_are_apart():
    """One folder for both, by whatever path, or one in the other where that does harm: refused before anything is made."""
    with Folder() as base:
        os.mkdir(base + "/there")
        os.symlink(base + "/there", base + "/link")
        for state, cache, words in (("there", "link", "is the state folder"), ("new", "new", "is the state folder"),
                                    ("there/s", "there", "lies in the cache folder"), ("new", "new/datasets/x", "has what was pushed")):
            folders = ["--init", "--state", base + "/" + state, "--cache", base + "/" + cache]
            got = run([e2e.ACUTD, "--no-config", "--socket", base + "/d.sock"] + folders, timeout=100)
            expect(got.status == 2 and words in got.err and base + "/" + cache in got.err, "%d %s" % (got.status, got.err))
            got = run([e2e.ACUTD, "--no-config", "--check-config", "--socket", base + "/d.sock"] + folders, timeout=100)
            expect(got.status == 2 and words in got.err and base + "/" + cache in got.err, "check: %d %s" % (got.status, got.err))
            expect(sorted(os.listdir(base)) == ["link", "there"] and not os.listdir(base + "/there"), "something was made")


def unmounted_disk_is_no_store():
    """A folder that was configured and is not there, or has no marker, is refused, and left as it is."""
    with Folder() as base:
        command = [e2e.ACUTD, "--no-config", "--socket", base + "/d.sock", "--state", base + "/mnt", "--cache", base + "/c"]
        for made in (False, True):
            if made:
                os.mkdir(base + "/mnt")
            got = run(command, timeout=100)
            expect(got.status == 78 and "unmounted disk" in got.err and "--init" in got.err and base + "/mnt" in got.err,
                   "%d %s" % (got.status, got.err))
            expect(os.path.exists(base + "/mnt") == made and not (made and os.listdir(base + "/mnt")), "it was written to")
        env = {"STATE_DIRECTORY": base + "/mnt"}
        got = run(command[:4] + command[6:], env=env, timeout=100)
        expect(got.status == 78 and "unmounted disk" in got.err, "$STATE_DIRECTORY: %d %s" % (got.status, got.err))
        # With --init it becomes a store, and is one from then on.
        d = Daemon(base, name="1")
        d.state = base + "/mnt"
        d.command = command[:1] + ["--init"] + command[1:]
        d.socket = base + "/d.sock"
        with d:
            d.ctl("ping").ok()
        d.command = command
        with d:
            d.ctl("ping").ok()
        with open(base + "/mnt/acut-state", "r+b") as f:
            f.seek(8)
            f.write(b"\x63")
        got = run(command, timeout=100)
        expect(got.status == 76 and "a newer acutd" in got.err and "version 99" in got.err, "%d %s" % (got.status, got.err))


def stale_socket_is_taken_over():
    with Folder() as base:
        d = Daemon(base).start()
        d.stop(signal.SIGKILL)
        expect(os.path.exists(d.socket), "the socket went with the process")
        with d:
            d.ctl("ping").ok()
            expect(os.stat(d.socket).st_mode & 0o777 == 0o660, "mode %o" % os.stat(d.socket).st_mode)
        d.stop()
        # What is no socket is never removed.
        if os.path.exists(d.socket):
            os.unlink(d.socket)
        with open(d.socket, "w") as f:
            f.write("precious")
        got = run(d.command, timeout=100)
        expect(got.status != 0 and open(d.socket).read() == "precious", "a file was taken for a stale socket")


def usage():
    with Folder() as base:
        common = ["--no-config", "--init", "--state", base + "/s", "--cache", base + "/c"]
        for args, word in ((["--memory", "23M"], "24"), (["--memory", "lots"], "size"), (["--threads", "0"], "threads"),
                           (["--log-level", "loud"], "level"), (["stray"], "stray"), ([], "listen")):
            more = [] if args == [] else ["--socket", base + "/x.sock"]
            got = run([e2e.ACUTD] + common + more + args, timeout=100)
            expect(got.status == 2 and word in got.err, "%s: %d %s" % (args, got.status, got.err))
        got = run([e2e.ACUTD, "--version"])
        expect(got.status == 0 and got.out.startswith("acutd "), got.out)
        expect("--idle-exit" in run([e2e.ACUTD, "--help"]).ok().out, "--help")


def clients_hear_why_not():
    """Who waits in a socket that was handed over is told why nobody serves it; a service manager would start acutd again for him."""
    with Folder() as base:
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(base + "/a.sock")
        listener.listen(64)
        os.mkdir(base + "/state")
        open(base + "/state/stranger", "w").close()
        waiting = [socket.socket(socket.AF_UNIX) for _ in range(20)]
        for s in waiting:
            s.connect(base + "/a.sock")
            s.settimeout(100)
        pid = hand_over(base, listener)
        expect(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 78, "the status is another one")
        for s in waiting:
            got = s.recv(4096)
            expect(b"stranger" in got and s.recv(1) == b"", "told: %r" % got)
        listener.setblocking(False)
        try:
            listener.accept()
            expect(False, "one still waits")
        except BlockingIOError:
            pass


def hand_over(base, sock, *args):
    """acutd with `sock` as descriptor 3, as the service manager starts it. Its process."""
    fd = sock.fileno()

    def prepare():
        os.dup2(fd, 3)
        os.set_inheritable(3, True)
        os.environ["LISTEN_PID"] = str(os.getpid())
        os.environ["LISTEN_FDS"] = "1"
        os.execv(e2e.ACUTD, [e2e.ACUTD, "--no-config", "--init", "--state", base + "/state", "--cache", base + "/cache", "--memory", "64M"] + list(args))

    pid = os.fork()
    if pid == 0:
        try:
            prepare()
        finally:
            os._exit(127)
    return pid


def wait_exit(pid, seconds=100):
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        got, status = os.waitpid(pid, os.WNOHANG)
        if got:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    raise Fault("acutd did not end within %s s" % seconds)


def socket_is_handed_over():
    """A blocking listening socket, with a client that connected before the daemon was there; the end by idleness."""
    with Folder() as base:
        path = base + "/h.sock"
        listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        listening.bind(path)
        listening.listen(8)
        early = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        early.connect(path)
        pid = hand_over(base, listening, "--idle-exit", "1")
        listening.close()
        with Client(path) as c:
            c.ping()
            # Connected means not idle, however quiet.
            time.sleep(2.5)
            c.ping()
        early.close()
        expect(wait_exit(pid) == 0, "status at the idle end")
        expect(not os.path.exists(path), "the socket of a daemon that ended by itself stays")


def socket_pair_is_handed_over():
    """A connected socket: one client, and the end with it."""
    with Folder() as base:
        mine, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        pid = hand_over(base, theirs, "--idle-exit", "30")
        theirs.close()
        mine.settimeout(100)
        mine.sendall(acut_wire.pack(1, pb.Message(hello=pb.Hello(version_min=1, version_max=1))))
        expect(len(mine.recv(1000)) > 16, "no Hello")
        mine.close()
        expect(wait_exit(pid) == 0, "status")


def staged(d):
    """Bytes below the datasets: what is committed, and what a push has written so far."""
    total = 0
    for path in files_below(os.path.join(d.state, "datasets")):
        try:
            total += os.stat(path).st_size
        except FileNotFoundError:
            pass
    return total


def out_of_descriptors():
    """With all descriptors taken, accept pauses without spinning, clients that are there are served, and the others get
    their turn when there is room."""
    with Folder() as base:
        d = Daemon(base, prefix=["prlimit", "--nofile=48", "--"])
        with d, Client(d.socket) as first:
            more = []
            for _ in range(80):
                s = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
                s.connect(d.socket)
                more.append(s)
            time.sleep(0.5)
            first.ping()

            before = e2e.cpu_of(d.process.pid)
            time.sleep(2)
            used = e2e.cpu_of(d.process.pid) - before
            expect(used < 0.2, "it spins: %.2f s of CPU in 2 s" % used)
            first.ping()
            last = more[-1]
            for s in more[:-1]:
                s.close()
            last.settimeout(100)
            last.sendall(acut_wire.pack(1, pb.Message(hello=pb.Hello(version_min=1, version_max=1))))
            expect(len(last.recv(1000)) > 16, "the last client was forgotten")
            last.close()


def killed_at_any_moment():
    """kill -9 while a push, its commit, or a job is under way; each time the next start has what was committed, nothing
    half done, says what was lost, and ends at the same mesh."""
    with Folder() as base:
        d = Daemon(base, memory="32M")
        first, second = survey(base, 150000), survey(base, 1500000, "second.las", 2)
        with d:
            d.ctl("push", "a", first).ok()
            whole = digest_of(d, "a")
        lost = False
        for more in (1, 1 << 20, 8 << 20, 20 << 20):
            with d:
                committed = staged(d)
                push = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "push", "a", second],
                                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                e2e.until(lambda: staged(d) >= committed + more or push.poll() is not None, "the push writes %d bytes" % more)
                d.stop(signal.SIGKILL)
                push.wait(100)
            with d:
                lost |= "was interrupted: nothing of it was durable yet" in d.log_text()
                row = json.loads(d.ctl("datasets", "--json").ok().out.splitlines()[0])
                if row["generation"] == 1:
                    expect(row["points"] == 150000, "points: %s" % row)
                    expect(digest_of(d, "a", "--new") == whole, "the mesh changed by a push that was not committed")
                    expect_clean(d)
                else:
                    break
        expect(lost or row["generation"] > 1, "no push was ever under way")
        with d:
            job = json.loads(d.ctl("submit", "a", "--new", "--json").ok().out)["job"]
            d.stop(signal.SIGKILL)
        with d:
            expect(d.ctl("wait", str(job)).status == 0, "the job did not go on")


def stopped_while_busy():
    """SIGTERM in the middle of a push and a job: the end within ten seconds, clean folders, and the job goes on."""
    with Folder() as base:
        d = Daemon(base, memory="32M")
        path = survey(base, 1500000)
        with d:
            d.ctl("push", "a", path).ok()
            job = json.loads(d.ctl("submit", "a", "--json").ok().out)["job"]
            before = staged(d)
            push = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "push", "a", path], stdout=subprocess.DEVNULL,
                                    stderr=subprocess.DEVNULL)
            mesh = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "mesh", path, "-o", base + "/m.ply"],
                                    stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

            def meshing():
                rows = [json.loads(line) for line in d.ctl("jobs", "--json").ok().out.splitlines()]
                return any(r["dataset"].startswith(".one-step") and r["state"] == "meshing" and
                           r["progress"]["domains"] < r["progress"]["domains_total"] for r in rows)

            # It has begun, and will not end: its client takes nothing any more.
            e2e.until(lambda: meshing() or mesh.poll() is not None, "the mesh begins")
            mesh.send_signal(signal.SIGSTOP)
            cut = meshing()
            e2e.until(lambda: staged(d) > before or push.poll() is not None, "the push begins")
            status, took = e2e.worked(lambda: d.stop(signal.SIGTERM, 100), d.process)
            expect(status == 0, "status")
            expect(took < 10, "it worked for %.1f s" % took)
            mesh.send_signal(signal.SIGCONT)
            push.wait(100)
            # The rest is for a machine that stood still between the two looks.
            expect((mesh.wait(100) != 0) == (not os.path.exists(base + "/m.ply")), "a mesh that is not whole")
            expect(mesh.returncode != 0 or not cut, "a mesh that was cut off is done")
            expect_clean(d)
            expect(not os.path.exists(d.socket), "the socket stays")
        with d:
            expect(d.ctl("wait", str(job)).status == 0, "the job did not go on")


def never_read_stream():
    """A client that asks for its mesh and never reads it: other jobs go on within the budget, and when it reads at last,
    its mesh is whole."""
    with Folder() as base, Daemon(base, memory="24M") as d:
        path = survey(base, 250000)
        with Client(d.socket) as slow:
            done = slow.push([path])
            job = slow.ask("submit", pb.Submit(dataset=done.dataset, bound=True))
            _, pipe = slow.ask("fetch", pb.Fetch(job=job.id))
            time.sleep(1.0)
            fast = d.ctl("mesh", path, "-o", base + "/fast.ply", "--json", timeout=e2e.PATIENCE).ok().json()
            expect(d.vmhwm() <= (24 + 32) * MIB, "VmHWM %.1f MiB" % (d.vmhwm() / MIB))
            mesh = acut_wire.Mesh(acut_wire.PipeReader(pipe, e2e.PATIENCE))
            os.close(pipe)
            expect(slow.wait(job.id).report.digest == fast["digest"], "the slow reader's mesh differs")
            del mesh


def memory_is_kept():
    """Several clients at once in the least memory there may be."""
    with Folder() as base, Daemon(base, memory="24M", threads=4) as d:
        path = survey(base, 400000)
        results = []

        def held(c):
            return {e.name: e.bytes for e in c.ask("status_request", pb.StatusRequest()).ledger if e.bytes}

        with Client(d.socket) as c:
            kept = held(c).get("jobs", 0)  # tables of stored domains (daemon/plan), from the start

        def mesh(i):
            results.append(d.ctl("mesh", path, "-o", "%s/%d.ply" % (base, i), "--json", timeout=300))

        threads = [threading.Thread(target=mesh, args=(i,)) for i in range(5)]
        for t in threads:
            t.start()
        for t in threads:
            t.join()
        digests = {r.ok().json()["digest"] for r in results}
        expect(len(digests) == 1, "digests: %s" % digests)
        expect(d.vmhwm() <= (24 + 32) * MIB, "VmHWM %.1f MiB" % (d.vmhwm() / MIB))
        print("     VmHWM %.1f MiB with five jobs in 24 MiB" % (d.vmhwm() / MIB))
        # Everything was given back: only what is there from the start, and this connection, are left.
        with Client(d.socket) as c:
            def given_back():
                now = held(c)
                return set(now) <= {"catalogue", "message", "thread", "jobs"} and now.get("jobs", 0) <= kept

            e2e.until(given_back, "held: %s" % held(c))
        expect_clean(d)


def mixed_units_are_refused():
    """Two files of different coordinate systems in one push: refused, both named."""
    with Folder() as base, Daemon(base) as d:
        paths = []
        for name, epsg in (("a.las", 32633), ("b.las", 32632)):
            path = survey(base, 1000, name)
            with open(path, "r+b") as f:
                data = f.read()
                key = struct.pack("<HHHH", 3072, 0, 1, 32633)
                expect(data.count(key) == 1, "the survey's CRS is not where it was")
                f.seek(data.index(key))
                f.write(struct.pack("<HHHH", 3072, 0, 1, epsg))
            paths.append(path)
        got = d.ctl("mesh", "-o", base + "/m.ply", *paths)
        expect(got.status == 1 and "a.las" in got.err and "b.las" in got.err, "%d %s" % (got.status, got.err))


main(folders_are_locked, unmounted_disk_is_no_store, state_and_cache_are_apart, first_start_of_a_service, stale_socket_is_taken_over, usage, clients_hear_why_not, socket_is_handed_over, socket_pair_is_handed_over,
     out_of_descriptors, killed_at_any_moment, stopped_while_busy, never_read_stream, memory_is_kept,
     mixed_units_are_refused)
