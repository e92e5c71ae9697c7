"""Hostile files and descriptors: reads that block, closes that do not return, and a daemon that runs out of descriptors."""
import os
import shutil
import signal
import socket
import subprocess
import time

import e2e
import hostile
from e2e import Folder, expect
from hostile import others_are_served, the_whole_way_still_works
from acut_wire import Breach, Client, Gone, Refused, Wire, pb


def whole_way_as(uid):
    """The seconds that another user's push and mesh take; fails if they fail."""
    start = time.monotonic()
    pid = os.fork()
    if not pid:
        try:
            os.setgroups([])
            os.setgid(uid)
            os.setuid(uid)
            the_whole_way_still_works()
            os._exit(0)
        except BaseException as e:
            print("     user %d: %s: %s" % (uid, type(e).__name__, e), flush=True)
            os._exit(1)
    expect(os.waitpid(pid, 0)[1] == 0, "another user is not served")
    return time.monotonic() - start


def nobody_waits_for(slow, delay, alone):
    """True if the whole way of another user, beside eight who read a file that takes so many seconds for each read, takes less than
    one read more than `alone`."""
    clients = [Client(hostile.DAEMON.socket) for _ in range(8)]
    pushes = [c.ask("push_begin", pb.PushBegin()).push for c in clients]
    fds = [os.open(slow, os.O_RDONLY | os.O_DIRECT) for _ in clients]
    for c, push, fd in zip(clients, pushes, fds):
        c.send("probe", pb.Probe(push=push, name="slow"), fd)
    time.sleep(0.2)
    beside = whole_way_as(65534)
    others_are_served()
    print("     another user's push and mesh: %.2f s alone, %.2f s beside files that block" % (alone, beside))
    for c in clients:
        c.close()
    for fd in fds:
        os.close(fd)
    others_are_served()
    return beside < delay * 0.8 + alone


def files_whose_reads_block():
    """Eight regular files of one user on a file system that takes 3 s for each read. They block workers, but another user's push
    and mesh do not wait for them, and neither does the end of a connection."""
    if os.geteuid() or not all(map(shutil.which, ("nbdkit", "nbdfuse", "fusermount3"))):
        print("     not tried: needs root, nbdkit and nbdfuse")
        return
    delay = 3
    with Folder() as base:
        sock, slow = base + "/sock", base + "/slow.las"
        open(slow, "w").close()
        running = [subprocess.Popen(["nbdkit", "-f", "-U", sock, "--filter=delay", "file", hostile.LAS, "rdelay=%d" % delay],
                                    stderr=subprocess.DEVNULL)]
        try:
            wait_until(lambda: os.path.exists(sock), "nbdkit")
            running.append(subprocess.Popen(["nbdfuse", slow, "--unix", sock], stderr=subprocess.DEVNULL))
            wait_until(lambda: os.stat(slow).st_size > 0, "nbdfuse")
            os.chmod(hostile.DAEMON.socket, 0o666)
            alone = whole_way_as(65534)
            # A loaded machine may take as long as a read that blocks, but not four times.
            for _ in range(4):
                if nobody_waits_for(slow, delay, alone):
                    break
                wait_until(lambda: slow not in e2e.files_of(hostile.DAEMON.process.pid), "the close of files that block")
            else:
                raise e2e.Fault("another user waits for them each time")
        finally:
            subprocess.run(["fusermount3", "-u", "-z", slow], stderr=subprocess.DEVNULL)
            for p in reversed(running):
                p.kill()
                p.wait()


def files_that_hang():
    """A daemon with one worker, and files of one user whose reads never return: two in their header, one in its points. Each push says
    which file hangs. Another push of the same user and its mesh go on; so do those that hung, when the file system answers."""
    for reads, files in ((0, 2), (5, 1)):
        with Folder() as base:
            gate = e2e.Gate(base)
            good = shutil.copy(hostile.LAS, base + "/good.las")
            names = [shutil.copy(hostile.LAS, base + "/hangs-%d.las" % i) for i in range(files)]
            with e2e.Daemon(base, memory="64M", threads=1, env=gate.env) as d:
                gate.close("pread", "/hangs-", reads, "acutd")
                hung = [subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "push", "h%d" % i, name], stderr=subprocess.PIPE,
                                         stdout=subprocess.DEVNULL, text=True) for i, name in enumerate(names)]
                try:
                    for p, name in zip(hung, names):
                        told = next((line for line in p.stderr if "gives nothing" in line), "it ended")
                        expect(os.path.basename(name) in told, told)
                    d.ctl("push", "other", good, timeout=e2e.PATIENCE).ok()
                    d.ctl("mesh", good, "--format", "null", timeout=e2e.PATIENCE).ok()
                    expect(all(p.poll() is None for p in hung), "they did not hang")
                    gate.open()
                    for p in hung:
                        err = p.communicate(timeout=e2e.PATIENCE)[1]
                        expect(p.returncode == 0 and "gives nothing" not in err, "%d %s" % (p.returncode, err))
                    for name in ["other"] + ["h%d" % i for i in range(files)]:
                        expect(d.ctl("dataset", "show", name, "--json").ok().json()["points"] == 5000, name)
                finally:
                    gate.open()
                    for p in hung:
                        p.kill()
                        p.wait()


def more_files_hang_than_may():
    """A daemon with one worker: `info` of a file that hangs, and pushes of three more. Another push and a mesh of the same user wait for
    none. Those that come when four files hang say why they wait. `doctor` counts none of the threads that took the places of others."""
    with Folder() as base:
        gate = e2e.Gate(base)
        names = [shutil.copy(hostile.LAS, base + "/hangs-%d.las" % i) for i in range(5)]
        with e2e.Daemon(base, memory="64M", threads=1, env=gate.env) as d:
            tasks = lambda: [c["message"] for c in d.ctl("doctor", "--json").json()["checks"] if c["name"] == "tasks"]
            before = tasks()
            gate.close("pread", "/hangs-", 0, "acutd")
            start = lambda *args: subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, *args], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL,
                                                   text=True)
            hung = [start("info", names[0])]
            try:
                d.ctl("ping").ok()
                d.ctl("mesh", hostile.LAS, "--format", "null", timeout=e2e.PATIENCE).ok()  # when the worker has another thread
                hung += [start("push", "h%d" % i, names[i]) for i in (1, 2, 3)]
                for p in hung[1:]:
                    told = next((line for line in p.stderr if "gives nothing" in line), "it ended")
                    expect("gives nothing" in told, told)
                hung.append(start("push", "h4", names[4]))
                told = next((line for line in hung[4].stderr if "this push waits" in line), "it ended")
                expect("4 other files of yours give nothing" in told, told)
                expect(before and tasks() == before, "%s, before %s" % (tasks(), before))
                gate.open()
                for p in hung:
                    err = p.communicate(timeout=e2e.PATIENCE)[1]
                    expect(p.returncode == 0, "%d %s" % (p.returncode, err))
            finally:
                gate.open()
                for p in hung:
                    p.kill()
                    p.wait()


def passes_files(path, name, uid, status):
    """A process of that user that passes files until it is disconnected, and then connects again. Writes to `status`: the number
    of files, and both reasons."""
    pid = os.fork()
    if pid:
        return pid
    said = []
    try:
        os.setgroups([])
        os.setgid(uid)
        os.setuid(uid)
        sent = 0
        client = Client(path, timeout=e2e.PATIENCE)
        try:
            while sent < 3000:
                with open(name, "rb") as f:
                    client.ask("info_request", pb.InfoRequest(name="x"), f.fileno())
                sent += 1
        except (Refused, Breach, Gone) as e:
            said.append("%s: %s" % (type(e).__name__, e))
            try:
                client.wire.recv()
                said.append("he is not cut off")
            except Gone:
                pass
            again = Wire(path, timeout=e2e.PATIENCE)
            message = again.recv()[1]
            said.append("%s: %s" % (message.error.code, message.error.message))
            again.close()
        said.insert(0, "%d" % sent)
    except BaseException as e:
        said.append("%s: %s" % (type(e).__name__, e))
    with open(status, "w") as f:
        f.write("\n".join(said))
    os._exit(0)


def files_that_never_close():
    """A file system does not answer when files are closed. A client that passes such files is disconnected, with the reason,
    after a number of them; files of others are closed meanwhile; once it answers, the client is served again. If it is only slow,
    only that client waits."""
    if os.geteuid():
        print("     not tried: needs root")
        return
    with Folder() as base:
        os.chmod(base, 0o777)
        gate = e2e.Gate(base)
        hangs, plain, status = base + "/hangs.las", base + "/plain.las", base + "/status"
        shutil.copy(hostile.LAS, hangs)
        shutil.copy(hostile.LAS, plain)
        with e2e.Daemon(base, memory="64M", threads=1, env=gate.env,
                        prefix=("sh", "-c", 'ulimit -n 1024; exec "$@"', "sh")) as few:
            os.chmod(few.socket, 0o666)
            gate.close("close", "/hangs.las")
            os.waitpid(passes_files(few.socket, hangs, 65534, status), 0)
            with open(status) as f:
                said = f.read().split("\n")
            expect(len(said) == 3, "%s" % said)
            held = e2e.files_of(few.process.pid).count(hangs)
            expect(64 <= held <= 66, "%d descriptors of them are open: %s" % (held, said))
            for why in said[1:]:
                expect("busy" in why and "a file system does not answer" in why, "why he is refused: %s" % said)
            with Client(few.socket, timeout=e2e.PATIENCE) as other, open(plain, "rb") as f:
                other.ask("info_request", pb.InfoRequest(name="y"), f.fileno())
            wait_until(lambda: plain not in e2e.files_of(few.process.pid), "the close of another user's file")
            gate.open()
            wait_until(lambda: hangs not in e2e.files_of(few.process.pid), "the close of all")
            os.waitpid(passes_files(few.socket, plain, 65534, status), 0)
            with open(status) as f:
                expect(f.read() == "3000", "he is not served again")
            told = few.log_text().count("is cut off")
            gone = slow_close(few, gate, hangs, status)
            os.kill(gone, signal.SIGKILL)
            os.waitpid(gone, 0)
            with Client(few.socket, timeout=e2e.PATIENCE) as other:
                e2e.until(lambda: other.ask("status_request", pb.StatusRequest()).connections == 1, "who is gone while he waits stays connected")
            expect(few.log_text().count("is cut off") == told, "who is gone while he waits stays until he is cut off")
            gate.open()
            wait_until(lambda: hangs not in e2e.files_of(few.process.pid), "the close of all")
            # Where the gate is opened too late he is cut off, as above.
            e2e.until(lambda: goes_on_after(few, gate, hangs, status), "who had to wait for the close of his files is cut off each time")


def goes_on_after(few, gate, hangs, status):
    """True if a process that had to wait for a moment has passed all of its files."""
    slow = slow_close(few, gate, hangs, status)
    gate.open()
    os.waitpid(slow, 0)
    wait_until(lambda: hangs not in e2e.files_of(few.process.pid), "the close of all")
    with open(status) as f:
        return f.read() == "3000"


def slow_close(few, gate, hangs, status):
    """Starts a process that passes files until it has to wait. The gate is closed."""
    gate.close("close", "/hangs.las")
    pid = passes_files(few.socket, hangs, 65534, status)
    try:
        wait_until(lambda: e2e.files_of(few.process.pid).count(hangs) >= 64, "files that wait for their close")
        time.sleep(0.2)
        held = e2e.files_of(few.process.pid).count(hangs)
        expect(64 <= held <= 66, "%d descriptors of them are open" % held)
    except BaseException:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        raise
    return pid


def wait_until(cond, what):
    e2e.until(cond, "%s does not come up" % what)


def descriptors_run_out():
    """A daemon with few descriptors: excess clients wait in the queue of the socket, nothing spins, and connected clients are
    served."""
    with Folder() as base, e2e.Daemon(base, memory="64M", threads=1,
                                      prefix=("sh", "-c", 'ulimit -n 32; exec "$@"', "sh")) as few:
        with Client(few.socket) as inside:
            crowd = []
            for _ in range(60):
                s = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
                s.settimeout(e2e.PATIENCE)
                s.connect(few.socket)
                crowd.append(s)
            pid = few.process.pid
            time.sleep(0.3)
            inside.ping()
            start = e2e.cpu_of(pid)
            time.sleep(2)
            used = (e2e.cpu_of(pid) - start) / 2
            expect(used < 0.05, "%.0f %% CPU while no descriptor is left" % (100 * used))
            with open(hostile.LAS, "rb") as f:
                try:
                    inside.ask("info_request", pb.InfoRequest(name="x"), f.fileno())
                except Refused as e:
                    expect(e.code == "busy", "no room for a descriptor: %s" % e)
            for s in crowd:
                s.close()

        def let_in():
            try:
                with Client(few.socket, timeout=e2e.PATIENCE) as fresh:
                    return fresh.ping() >= 0
            except (Gone, Breach, OSError):
                return False
        e2e.until(let_in, "nobody is let in afterwards")
    others_are_served()


if __name__ == "__main__":
    hostile.whole(files_whose_reads_block, files_that_hang, more_files_hang_than_may, files_that_never_close, descriptors_run_out)
